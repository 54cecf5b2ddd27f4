# SPDX-License-Identifier: GPL-3.0-or-later
"""Actions with few keys: Bezier curves with handles that make them the cubics that were reckoned with."""

from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..clean.key_reduction import FewKeys, channel_count
from ..retarget.rotation_modes import property_of
from ..retarget.skeleton import Skeleton
from ..scene_import.actions import Curves, fill, new_action
from .reading import location_axes

Array = NDArray[np.float64]


_STAYS = 1e-6  # metres: a bone that leaves its place by less only turns


def rotation_modes(obj: bpy.types.Object, skeleton: Skeleton) -> tuple[str, ...]:
    """The rotation mode of each bone, in the skeleton's order."""
    return tuple(obj.pose.bones[name].rotation_mode for name in skeleton.names)


def write_few_keys(
    obj: bpy.types.Object, skeleton: Skeleton, few: FewKeys, name: str, frames: Array, others: Sequence[Curves] = ()
) -> int:
    """Give a rig a new action, which becomes the active one.

    Args:
        obj: the armature object.
        skeleton: the same one.
        few: channels and the frames to key.
        name: of the action.
        frames: (T,) scene frames, evenly spaced.
        others: further properties, with a key only where a value changes.

    Returns:
        The number of keys on bones.
    """
    bag = new_action(obj, name)
    step = float(frames[1] - frames[0]) if len(frames) > 1 else 1.0
    axes = location_axes(obj, skeleton)
    count = 0
    for index, bone_name in enumerate(skeleton.names):
        bone, keyed = obj.pose.bones[bone_name], few.keyed[:, index]
        group = bag.groups.new(bone_name)
        width = channel_count(few.modes[index])
        channels = [
            (property_of(few.modes[index]), few.rotations[:, index, :width], few.rotation_slopes[:, index, :width])
        ]
        if skeleton.to_world.scale * np.abs(few.locations[:, index]).max() > _STAYS:
            channels.append(
                ("location", few.locations[:, index] @ axes[index].T, few.location_slopes[:, index] @ axes[index].T)
            )
        for path, values, slopes in channels:
            for channel in range(values.shape[1]):
                curve = bag.fcurves.new(bone.path_from_id(path), index=channel)
                curve.group = group
                _fill_cubic(curve, frames[keyed], values[keyed, channel], slopes[keyed, channel] / step)
                count += int(keyed.sum())
    _add_others(bag, others, frames)
    return count


def _fill_cubic(curve: Any, frames: Array, values: Array, slopes: Array) -> None:
    """Keys with handles a third of the way to the neighbours, along the slopes: there a Bezier is a cubic of time."""
    gaps = np.diff(frames)
    before, after = (np.concatenate(pair) / 3 for pair in (([1.0], gaps), (gaps, [1.0])))
    points = curve.keyframe_points
    points.add(len(frames))
    for name, times in (("co", frames), ("handle_left", frames - before), ("handle_right", frames + after)):
        places = np.stack([times, values + slopes * (times - frames)], axis=1)
        points.foreach_set(name, places.astype(np.float32).ravel())
    kinds = bpy.types.Keyframe.bl_rna.properties
    bezier = kinds["interpolation"].enum_items["BEZIER"].value
    free = kinds["handle_left_type"].enum_items["FREE"].value
    points.foreach_set("interpolation", np.full(len(frames), bezier, np.int32))
    for side in ("handle_left_type", "handle_right_type"):
        points.foreach_set(side, np.full(len(frames), free, np.int32))
    curve.update()


def _add_others(bag: Any, others: Sequence[Curves], frames: Array) -> None:
    for other in others:
        for index, values in enumerate(other.values.T):
            curve = bag.fcurves.new(other.path, index=index)
            kept = _turning(values)
            fill(curve, frames[kept], values[kept], other.interpolation)


def _turning(values: Array) -> NDArray[np.bool_]:
    """(T,) where a polygon has a corner, and its ends: the other values say nothing new."""
    kept = np.ones(len(values), bool)
    if len(values) > 2:
        kept[1:-1] = np.abs(np.diff(values, 2)) > 1e-6
    return kept
