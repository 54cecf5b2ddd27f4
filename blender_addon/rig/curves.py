# SPDX-License-Identifier: GPL-3.0-or-later
"""Read animation curves, on the legacy actions of Blender 4.2 and the slotted ones since 4.4."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Curves = dict[tuple[str, int], Any]
"""F-curves by data path and array index."""


def curves_of(animation: Any) -> Curves:
    """The curves of the active action that play on the owner of some animation data (or None)."""
    action = animation.action if animation else None
    if action is None:
        return {}
    return {(c.data_path, c.array_index): c for c in _all_curves(action, animation) if not c.mute}


def _all_curves(action: Any, animation: Any) -> list[Any]:
    if not hasattr(action, "slots"):
        return list(action.fcurves)
    slot = animation.action_slot
    bags = [strip.channelbag(slot) for layer in action.layers for strip in layer.strips] if slot else []
    return [curve for bag in bags if bag for curve in bag.fcurves]


def sample(curve: Any, frames: Array) -> Array:
    """(T,) the values of a curve at scene frames, fractions allowed."""
    if _is_polygon(curve):
        keys = _keys(curve)
        return np.interp(frames, keys[:, 0], keys[:, 1])
    return np.array([curve.evaluate(frame) for frame in frames])


def key_values(curve: Any) -> Array:
    """(K,) the values of a curve's keys."""
    return _keys(curve)[:, 1]


def _keys(curve: Any) -> Array:
    """(K, 2) frame and value."""
    keys = np.empty(2 * len(curve.keyframe_points), np.float32)
    curve.keyframe_points.foreach_get("co", keys)
    return keys.astype(float).reshape(-1, 2)


def _is_polygon(curve: Any) -> bool:
    """Whether a curve is straight between its keys and level beyond them: numpy then evaluates all frames at once."""
    points = curve.keyframe_points
    if not len(points) or curve.modifiers or curve.extrapolation != "CONSTANT":
        return False
    kinds = np.empty(len(points), np.int32)
    points.foreach_get("interpolation", kinds)
    linear = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items["LINEAR"].value
    return bool(np.all(kinds == linear))
