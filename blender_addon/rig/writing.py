# SPDX-License-Identifier: GPL-3.0-or-later
"""A `Motion` as a new action on an armature; nothing else of the rig changes."""

from collections.abc import Collection, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..retarget.rotation_modes import QUATERNION, channels_from_matrices, matrices_from_channels, property_of
from ..retarget.skeleton import Channels, Motion, Skeleton, channels_of
from ..scene_import.actions import Curves, write_action
from .reading import location_axes

Array = NDArray[np.float64]

# A bone that leaves its parent's carrying by less than this fraction of the rig's size only turns.
_NEGLIGIBLE = 1e-6


def write_motion(
    obj: bpy.types.Object,
    skeleton: Skeleton,
    motion: Motion,
    name: str,
    bones: Sequence[str],
    frames: NDArray[np.float64],
    moved: Collection[str] = (),
    others: Sequence[Curves] = (),
) -> bpy.types.Action:
    """Give a rig a new action that shows a motion.

    Rotations are keyed in each bone's own rotation mode. The rig's former action is kept in the file. Bones without
    curves stay as they are posed: name all whose pose matters, the parents of mapped bones too.

    Args:
        obj: the armature object.
        skeleton: the same one, read by `read_skeleton`.
        motion: of all its bones.
        name: of the action.
        bones: those to be keyed.
        frames: (T,) scene frames of the keys.
        moved: bones of `bones` whose location is keyed even if they never leave their place; others get it only when
            they leave it, or are not in their place now.
        others: further properties of the object that the action shall key.

    Returns:
        The new action, active on the rig.

    Raises:
        UserError: the rig cannot be animated, or something else rules the bones. Nothing has changed then.
    """
    check_writable(obj, bones)
    channels = channels_of(skeleton, motion)
    leaves = _leaving(skeleton, channels)
    _refuse_torn(obj, skeleton, bones, leaves)
    to_keyed_axes = location_axes(obj, skeleton)
    rotations = _rotations(obj, skeleton, channels, bones)
    curves: list[Curves] = []
    for bone_name in bones:
        index, bone = skeleton.index(bone_name), obj.pose.bones[bone_name]
        curves.append(Curves(bone.path_from_id(property_of(bone.rotation_mode)), rotations[bone_name], bone_name))
        if not bone.bone.use_connect and (leaves[index] or bone_name in moved or any(bone.location)):
            location = channels.locations[:, index] @ to_keyed_axes[index].T
            curves.append(Curves(bone.path_from_id("location"), location, bone_name))
        if not np.allclose(bone.scale, 1.0):
            curves.append(Curves(bone.path_from_id("scale"), np.ones((len(frames), 3)), bone_name))
    former = obj.animation_data.action if obj.animation_data else None
    write_action(obj, name, np.asarray(frames, float), [*curves, *others])
    if former is not None and former.users == 0:
        former.use_fake_user = True  # else Blender would forget the action when the file is closed
    return obj.animation_data.action


def check_writable(obj: bpy.types.Object, bones: Sequence[str]) -> None:
    """Raise UserError unless an action on the rig would move these bones as it says."""
    rig = f"the rig '{obj.name}'"
    if obj.type != "ARMATURE":
        raise UserError(f"'{obj.name}' is no armature: choose the armature that moves it")
    if not obj.is_editable:
        raise UserError(
            f"{rig} is linked from another file and cannot be animated here: append it, or make a library override"
        )
    override = obj.override_library
    if override is not None and override.is_system_override:
        raise UserError(f"{rig} is a library override that is not editable: make it editable in the Outliner first")
    missing = [name for name in bones if name not in obj.pose.bones]
    if missing:
        raise UserError(f"{rig} has no bone {_listed(missing)}: detect its bone map again")
    _refuse_other_animation(obj, rig, bones)
    locked = [name for name in bones if all(obj.pose.bones[name].lock_rotation)]
    if locked:
        raise UserError(f"{rig} locks the rotation of {_listed(locked)}: unlock it, or choose other bones")


def _refuse_other_animation(obj: Any, rig: str, bones: Sequence[str]) -> None:
    """Drivers and NLA settings that would overrule the keys, or keep the action from being set."""
    animation = obj.animation_data
    if animation is None:
        return
    if animation.use_tweak_mode:
        raise UserError(f"{rig} is being edited in an NLA strip: leave the strip's tweak mode first")
    if animation.action_influence < 1 or animation.action_blend_type != "REPLACE":
        raise UserError(f"{rig} blends its action: set Replace and full influence in the NLA editor first")
    if any(track.is_solo for track in animation.nla_tracks):
        raise UserError(f"{rig} plays one NLA track alone: switch that track's star off first")
    starts = {obj.pose.bones[name].path_from_id() + "." + channel: name for name in bones for channel in _CHANNELS}
    driven = {starts[s] for d in animation.drivers for s in starts if d.data_path.startswith(s)}
    if driven:
        raise UserError(f"drivers move {_listed(sorted(driven))} of {rig}: choose other bones, or remove the drivers")


_CHANNELS = ("location", "rotation_", "scale")


def _rotations(obj: Any, skeleton: Skeleton, channels: Channels, bones: Sequence[str]) -> dict[str, Array]:
    """(T, 4 or 3) of each bone in its own rotation mode; all bones of one mode at once."""
    by_mode: dict[str, list[str]] = {}
    for name in bones:
        by_mode.setdefault(obj.pose.bones[name].rotation_mode, []).append(name)
    rotations: dict[str, Array] = {}
    for mode, names in by_mode.items():
        turns = matrices_from_channels(channels.quaternions[:, [skeleton.index(name) for name in names]], QUATERNION)
        rotations |= zip(names, np.moveaxis(channels_from_matrices(turns, mode), 1, 0), strict=True)
    return rotations


def _leaving(skeleton: Skeleton, channels: Channels) -> NDArray[np.bool_]:
    """(B,) which bones leave the place where their parents carry them."""
    size = float(np.ptp(np.concatenate([skeleton.heads, skeleton.tails]), axis=0).max()) / skeleton.to_world.scale
    return np.abs(channels.locations).max(axis=(0, 2)) > _NEGLIGIBLE * size


def _refuse_torn(obj: Any, skeleton: Skeleton, bones: Sequence[str], leaves: NDArray[np.bool_]) -> None:
    torn = [name for name in bones if leaves[skeleton.index(name)] and obj.data.bones[name].use_connect]
    if torn:
        raise UserError(
            f"{_listed(torn)} of the rig '{obj.name}' must leave the parent but is connected to it: choose another bone"
        )


def _listed(names: Sequence[str]) -> str:
    shown = ", ".join(f"'{name}'" for name in names[:3])
    return shown if len(names) <= 3 else f"{shown} and {len(names) - 3} more"
