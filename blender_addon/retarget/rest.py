# SPDX-License-Identifier: GPL-3.0-or-later
"""One pose for all rigs: how each bone of a rest pose, T or A or any other, lies in the pose that all bodies share.

In the shared pose a body stands upright, its arms stretched to the sides and its feet pointing to the front. Frames are
columns (left, back, up) of a body or of a part of it; in the shared pose all parts have the frame of the whole body.
They come from the places of joints: how a rig's bones are rolled says nothing about its body.
"""

import math

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import align_vectors

from .bone_map import BoneMap
from .roles import SIDES
from .skeleton import Skeleton

Array = NDArray[np.float64]

LEFT, BACK, UP = 0, 1, 2

# Within so many degrees a body's directions are those of its armature: a rest pose is made along the axes, joints lie
# where anatomy wants them.
_ALONG_AXIS = math.cos(math.radians(20.0))
_BELOW = 0.5  # cosine of the angle between a leg that is stood on and the vertical
_LEVEL = 1e-6  # cosine of what is at right angles
# The limb that the bone of a limb points to. The hand goes on from the forearm and the toes from the foot.
_POINTS_TO = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shin", "shin": "foot"}
_FRAMED = ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")
_GOES_ON = {"hand": "forearm", "toe": "foot"}


def body_frame(skeleton: Skeleton, bone_map: BoneMap) -> Array:
    """(3, 3) columns left, back and up of a whole body at rest, world.

    Raises:
        ValueError: the map has no hips, head or thighs.
    """
    own = skeleton.to_world.rotation
    upward = _head(skeleton, bone_map, "head") - _head(skeleton, bone_map, "hips")
    across = _head(skeleton, bone_map, "left_thigh") - _head(skeleton, bone_map, "right_thigh")
    up = _along_axis(upward, own)
    # A rig that leans at rest has no axes of its own that are level with it.
    level = own[:, np.abs(up @ own) < _LEVEL]
    left = _along_axis(across - (across @ up) * up, level)
    back = np.cross(up, left)
    return np.stack([left, back / np.linalg.norm(back), up], axis=1)


def stands(skeleton: Skeleton, bone_map: BoneMap) -> bool:
    """Whether a body at rest has its legs below it: some motion files rest in a pose that nobody could be in."""
    up = body_frame(skeleton, bone_map)[:, UP]
    legs = [_head(skeleton, bone_map, f"{side}_foot") - _head(skeleton, bone_map, f"{side}_thigh") for side in SIDES]
    return all(leg @ up < -_BELOW * np.linalg.norm(leg) for leg in legs)


def rest_frames(skeleton: Skeleton, bone_map: BoneMap) -> Array:
    """(B, 3, 3) the frames of all parts of a body at rest, world; bones without a role have that of what they hang on.

    Raises:
        ValueError: the map has no hips, head, thighs, or a limb without its next joint.
    """
    body = body_frame(skeleton, bone_map)
    frames = np.tile(body, (len(skeleton.names), 1, 1))
    for bone, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        side, _, limb = (bone_map.role_of(name) or "").partition("_")
        if side in SIDES and limb in _FRAMED:
            frames[bone] = _limb_frame(skeleton, bone_map, side, limb, body)
        elif not side and parent >= 0:
            frames[bone] = frames[parent]
    return frames


def _limb_frame(skeleton: Skeleton, bone_map: BoneMap, side: str, limb: str, body: Array) -> Array:
    limb = _GOES_ON.get(limb, limb)
    along = _direction(skeleton, bone_map, side, limb)
    if limb == "foot":
        return _heading_frame(along, body)
    sideways = body[:, LEFT] if side == "left" else -body[:, LEFT]
    shared = sideways if limb in ("upper_arm", "forearm") else -body[:, UP]
    # The shortest turn out of the shared pose: an arm that hangs in an A pose was lowered, not twisted.
    return align_vectors(shared, along) @ body


def _heading_frame(along: Array, body: Array) -> Array:
    """The frame of a foot: upright, since soles are level at rest, and turned to where it points."""
    up = body[:, UP]
    back = -(along - (along @ up) * up)
    if np.linalg.norm(back) < 0.2 * np.linalg.norm(along):
        return body
    back = back / np.linalg.norm(back)
    return np.stack([np.cross(back, up), back, up], axis=1)


def _direction(skeleton: Skeleton, bone_map: BoneMap, side: str, limb: str) -> Array:
    """From a limb's joint to its next one, or to the end of its bone where that is missing."""
    bone = skeleton.index(bone_map.needed(f"{side}_{limb}"))
    following = bone_map.bone(f"{side}_{'toe' if limb == 'foot' else _POINTS_TO[limb]}")
    end = skeleton.heads[skeleton.index(following)] if following else skeleton.end(bone)
    return end - skeleton.heads[bone]


def _along_axis(direction: Array, axes: Array) -> Array:
    """A direction as a unit vector; that of the axis, either way, which it nearly has."""
    direction = direction / np.linalg.norm(direction)
    agreement = direction @ axes
    if not len(agreement):
        return direction
    nearest = int(np.argmax(np.abs(agreement)))
    if abs(agreement[nearest]) > _ALONG_AXIS:
        return np.sign(agreement[nearest]) * axes[:, nearest]
    return direction


def _head(skeleton: Skeleton, bone_map: BoneMap, role: str) -> Array:
    return skeleton.heads[skeleton.index(bone_map.needed(role))]
