# SPDX-License-Identifier: GPL-3.0-or-later
"""Write whole animation curves at once, on the legacy actions of Blender 4.2 and the slotted ones since 4.4."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Curves:
    """One animated property.

    Attributes:
        path: data path from the owner of the action.
        values: (T, C) one column per array index; a plain number has one column.
        group: name of the channel group.
        interpolation: "LINEAR" or "CONSTANT".
    """

    path: str
    values: NDArray[np.float64]
    group: str
    interpolation: str = "LINEAR"


def write_action(owner: bpy.types.ID, name: str, frames: NDArray[np.float64], curves: Iterable[Curves]) -> None:
    """Give `owner` a new action with one key per frame.

    Args:
        owner: an object, or any datablock that can be animated.
        name: of the action.
        frames: (T,) scene frames of the keys.
        curves: the animated properties.
    """
    bag = new_action(owner, name)
    groups: dict[str, Any] = {}
    for curve in curves:
        if curve.group not in groups:
            groups[curve.group] = bag.groups.new(curve.group)
        for index in range(curve.values.shape[1]):
            f_curve = bag.fcurves.new(curve.path, index=index)
            f_curve.group = groups[curve.group]
            fill(f_curve, frames, curve.values[:, index], curve.interpolation)


def new_action(owner: bpy.types.ID, name: str) -> Any:
    """Give `owner` a new, empty action; returns what holds its curves and groups.

    Args:
        owner: an object, or any datablock that can be animated.
        name: of the action.
    """
    action = bpy.data.actions.new(name)
    animation = owner.animation_data_create()
    animation.action = action
    bag = _curve_container(action, owner)
    if hasattr(animation, "action_slot"):
        animation.action_slot = action.slots[0]
    return bag


def _curve_container(action: Any, owner: bpy.types.ID) -> Any:
    """What holds curves and groups: since 4.4 a channel bag of the owner's slot, before that the action."""
    if not hasattr(action, "slots"):
        return action
    slot = action.slots.new(id_type=owner.id_type, name=owner.name)
    strip = action.layers.new("Layer").strips.new(type="KEYFRAME")
    return strip.channelbag(slot, ensure=True)


def fill(f_curve: Any, frames: NDArray[np.float64], values: NDArray[np.float64], interpolation: str) -> None:
    """Give a new curve its keys: (T,) frames and values, all with one interpolation."""
    points = f_curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack([frames, values], axis=1).astype(np.float32).ravel())
    kinds = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items
    points.foreach_set("interpolation", np.full(len(frames), kinds[interpolation].value, np.int32))
    f_curve.update()
