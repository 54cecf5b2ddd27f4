# SPDX-License-Identifier: GPL-3.0-or-later
"""An armature object as a `Skeleton`, and its animation as a `Motion`."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.geometry import Similarity

from ..retarget.rotation_modes import matrices_from_channels, property_of
from ..retarget.skeleton import Motion, Skeleton, pose
from .curves import Curves, curves_of, key_values, sample

Array = NDArray[np.float64]

# Scales and angles that differ by less come from rounding, as in an armature of scale (100, 99.99999, 99.99999).
_UNEVEN = 1e-3
_TRANSFORMS = ("location", "rotation_", "scale", "delta_", "parent", "matrix")


def read_skeleton(obj: bpy.types.Object) -> Skeleton:
    """The armature at rest, where its object stands at the scene's present frame.

    Args:
        obj: an armature object of the scene, of any size, however it is turned and parented.

    Raises:
        UserError: it is no armature, has no bones, or is stretched, sheared or mirrored.
    """
    if obj.type != "ARMATURE":
        raise UserError(f"'{obj.name}' is no armature: choose the armature that moves it")
    if not obj.data.bones:
        raise UserError(f"the armature '{obj.name}' has no bones: choose another one")
    to_world = _to_world(obj)
    bones = list(obj.data.bones)  # Blender lists parents before their children
    places = {bone.name: number for number, bone in enumerate(bones)}
    rest = np.array([bone.matrix_local for bone in bones], float)
    return Skeleton(
        names=tuple(places),
        parents=tuple(places[bone.parent.name] if bone.parent else -1 for bone in bones),
        heads=to_world.apply(rest[:, :3, 3]),
        axes=to_world.rotation @ _orthonormal(rest[:, :3, :3]),
        lengths=to_world.scale * np.array([bone.length for bone in bones], float),
        to_world=to_world,
        turns_with_parent=np.array([bone.use_inherit_rotation for bone in bones]),
    )


def read_motion(obj: bpy.types.Object, skeleton: Skeleton, frames: NDArray[np.float64]) -> Motion:
    """Where the bones are at some frames of the present scene; the scene is left at the frame it shows.

    Rigs that move by their own keys alone are read from their curves; all others are evaluated frame by frame.

    Args:
        obj: an armature object.
        skeleton: the same one, read by `read_skeleton`.
        frames: (T,) scene frames, fractions allowed.
    """
    scene = bpy.context.scene
    frames = np.asarray(frames, float)
    times = frames * scene.render.fps_base / scene.render.fps
    curves = curves_of(obj.animation_data)
    if _moves_by_keys_alone(obj, curves):
        return _keyed_motion(obj, skeleton, curves, frames, times)
    return _evaluated_motion(obj, skeleton, frames, times)


def location_axes(obj: bpy.types.Object, skeleton: Skeleton) -> Array:
    """(B, 3, 3) from a bone's rest axes to the axes in which its location is keyed.

    They are the same unless the bone's "local location" is off: then its parent's axes are used, or the armature's.
    """
    result = np.tile(np.eye(3), (len(skeleton.names), 1, 1))
    for index, name in enumerate(skeleton.names):
        bone = obj.data.bones[name]
        if not bone.use_local_location:
            parent = _orthonormal(np.array(bone.parent.matrix_local, float)[:3, :3]) if bone.parent else np.eye(3)
            result[index] = (skeleton.to_world.rotation @ parent).T @ skeleton.axes[index]
    return result


def _to_world(obj: bpy.types.Object) -> Similarity:
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    matrix = np.array(evaluated.matrix_world, float)
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    if scale <= 0:
        raise UserError(f"'{obj.name}' is mirrored or of no size: apply its scale (Object > Apply > Scale) first")
    rotation = matrix[:3, :3] / scale
    if np.abs(rotation.T @ rotation - np.eye(3)).max() > _UNEVEN:
        raise UserError(f"'{obj.name}' is stretched unevenly: apply its scale (Object > Apply > Scale) first")
    return Similarity(_orthonormal(rotation), matrix[:3, 3], scale)


def _orthonormal(matrices: Array) -> Array:
    """(..., 3, 3) the nearest rotations."""
    u, _, vt = np.linalg.svd(matrices)
    return np.asarray(u @ vt, float)


# --- rigs that move by their own keys -------------------------------------------------------------------------------


def _moves_by_keys_alone(obj: Any, curves: Curves) -> bool:
    return (
        obj.data.pose_position == "POSE"
        and not any(path.startswith(_TRANSFORMS) for path, _ in curves)
        and not any(path.endswith(".rotation_mode") for path, _ in curves)
        and _is_unruled(obj)
        and not any(bone.constraints for bone in obj.pose.bones)
        and all(_stays(above) for above in _ancestors(obj))
        and _keeps_size(obj, curves)
    )


def _is_unruled(owner: Any) -> bool:
    """Whether nothing but the active action moves an object: no constraints, drivers or NLA."""
    animation = owner.animation_data
    if owner.constraints:
        return False
    return animation is None or not (
        len(animation.drivers)
        or any(not track.mute for track in animation.nla_tracks)
        or animation.action_influence < 1
        or animation.action_blend_type != "REPLACE"
    )


def _stays(obj: Any) -> bool:
    """Whether an object above the armature stands still; one that is parented to a bone or a vertex may not."""
    return _is_unruled(obj) and obj.type != "ARMATURE" and not curves_of(obj.animation_data)


def _ancestors(obj: Any) -> list[Any]:
    above = []
    while obj.parent:
        obj = obj.parent
        above.append(obj)
    return above


def _keeps_size(obj: Any, curves: Curves) -> bool:
    """Whether no bone is scaled, by the value it has or by keys."""
    scales = np.empty(3 * len(obj.pose.bones), np.float32)
    obj.pose.bones.foreach_get("scale", scales)
    keyed = [key_values(curve) for (path, _), curve in curves.items() if path.endswith(".scale")]
    return all(bool(np.allclose(values, 1.0, atol=1e-6)) for values in (scales, *keyed))


def _keyed_motion(obj: Any, skeleton: Skeleton, curves: Curves, frames: Array, times: Array) -> Motion:
    bones = [obj.pose.bones[name] for name in skeleton.names]
    turns = np.empty((len(frames), len(bones), 3, 3))
    locations = np.empty((len(frames), len(bones), 3))
    to_rest_axes = np.swapaxes(location_axes(obj, skeleton), -1, -2)
    for index, bone in enumerate(bones):
        turns[:, index] = matrices_from_channels(
            _channel(bone, property_of(bone.rotation_mode), curves, frames), bone.rotation_mode
        )
        location = _channel(bone, "location", curves, frames)
        # Blender ignores the location of a bone that hangs together with its parent.
        locations[:, index] = 0.0 if bone.bone.use_connect else location @ to_rest_axes[index].T
    return pose(skeleton, times, turns, locations)


def _channel(bone: Any, name: str, curves: Curves, frames: Array) -> Array:
    """(T, C) a property of a pose bone over time: its curves, else the value it has."""
    path = bone.path_from_id(name)
    values = np.tile(np.array(getattr(bone, name), float), (len(frames), 1))
    for index in range(values.shape[1]):
        if (path, index) in curves:
            values[:, index] = sample(curves[path, index], frames)
    return values


# --- all others -----------------------------------------------------------------------------------------------------


def _evaluated_motion(obj: Any, skeleton: Skeleton, frames: Array, times: Array) -> Motion:
    scene = bpy.context.scene
    shown = scene.frame_current_final
    rotations = np.empty((len(frames), len(skeleton.names), 3, 3))
    heads = np.empty((len(frames), len(skeleton.names), 3))
    try:
        for number, frame in enumerate(frames):
            _show(scene, float(frame))
            matrices = _world_matrices(obj, skeleton)
            rotations[number] = _along_bones(matrices[:, :3, :3])
            heads[number] = matrices[:, :3, 3]
    finally:
        _show(scene, shown)
    return Motion(times, rotations, heads)


def _show(scene: bpy.types.Scene, frame: float) -> None:
    whole = int(frame // 1)
    scene.frame_set(whole, subframe=frame - whole)


def _world_matrices(obj: Any, skeleton: Skeleton) -> Array:
    """(B, 4, 4) as evaluated at the present frame."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    bones = evaluated.pose.bones
    local = np.array([bones[name].matrix for name in skeleton.names], float)
    return np.asarray(np.array(evaluated.matrix_world, float) @ local, float)


def _along_bones(matrices: Array) -> Array:
    """(..., 3, 3) rotations from axes that may be stretched: y stays along the bone, x as near as it can."""
    y = matrices[..., 1] / np.linalg.norm(matrices[..., 1], axis=-1, keepdims=True)
    x = matrices[..., 0] - np.sum(matrices[..., 0] * y, axis=-1, keepdims=True) * y
    x = x / np.linalg.norm(x, axis=-1, keepdims=True)
    return np.stack([x, y, np.cross(x, y)], axis=-1)
