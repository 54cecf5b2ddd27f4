# SPDX-License-Identifier: GPL-3.0-or-later
"""Where the bones of a person rest: heads, tails and the direction of each bone's z axis. numpy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.take import Person

from .world import FRONT, UP, rest_from_body

Array = NDArray[np.float64]

# A bone points to this child when a joint has several.
_MAIN_CHILD = {"pelvis": "spine1", "spine3": "neck"}
# Lengths of the bones after the last joints, in body heights: such that they end within the skin or hardly beyond.
_HEAD, _FOOT, _HAND = 0.085, 0.035, 0.02
# Shorter bones would be lost: Blender removes bones without length.
_SHORTEST = 0.005


@dataclass(frozen=True)
class RestPose:
    """A person's rest pose in Blender's axes (upright, facing -y), soles on z = 0, pelvis above the origin, metres.

    Attributes:
        heads: (24, 3) where the bones begin: the joints.
        tails: (24, 3) where they end.
        z_axes: (24, 3) the direction each bone's z axis is turned to.
        offset: (3,) what was added to the scaled rest joints; the skin needs the same.
    """

    heads: Array
    tails: Array
    z_axes: Array
    offset: Array


def rest_pose(person: Person, names: tuple[str, ...], parents: tuple[int, ...]) -> RestPose:
    """Lay out a person's bones."""
    joints = rest_from_body(person.rest_joints, person.scale)
    skin = rest_from_body(person.rest_vertices, person.scale)
    lowest = min(float(points[:, 2].min()) for points in (joints, skin) if len(points))
    offset = np.array([-joints[0, 0], -joints[0, 1], -lowest])
    heads = joints + offset
    return RestPose(heads, _tails(heads, names, parents), _z_axes(names), offset)


def _tails(heads: Array, names: tuple[str, ...], parents: tuple[int, ...]) -> Array:
    """Each bone ends at its main child; a last bone goes on: the head up, the feet to the front, the hands along."""
    size = float(np.ptp(heads[:, 2]))
    tails = heads.copy()
    for joint, name in enumerate(names):
        children = [j for j, parent in enumerate(parents) if parent == joint]
        if children:
            main = [j for j in children if names[j] == _MAIN_CHILD.get(name)]
            tails[joint] = heads[(main or children)[0]]
        elif name.endswith("foot"):
            tails[joint] += _FOOT * size * np.array(FRONT)
        elif name.endswith("hand"):
            along = heads[joint] - heads[parents[joint]]
            tails[joint] += _HAND * size * along / max(float(np.linalg.norm(along)), _SHORTEST)
        else:
            tails[joint] += _HEAD * size * np.array(UP)
    too_short = np.linalg.norm(tails - heads, axis=1) < _SHORTEST
    tails[too_short] = heads[too_short] + 2 * _SHORTEST * np.array(UP)
    return tails


def _z_axes(names: tuple[str, ...]) -> Array:
    """To the front, and up for the feet, which themselves point to the front.

    Both directions lie in the plane of symmetry, so left and right bones are mirror images; knees, elbows, fingers and
    spine then all bend about their bone's x axis.
    """
    return np.array([UP if name.endswith(("ankle", "foot")) else FRONT for name in names])
