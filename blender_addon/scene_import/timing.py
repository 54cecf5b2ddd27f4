# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's clock: frame rate and range of a take."""

import math
from fractions import Fraction

import bpy

from .world import FIRST_FRAME

# Blender shows whole rates up to this; larger numerators are such as 30000/1001.
_LARGEST_WHOLE_RATE = 240


def set_clock(scene: bpy.types.Scene, rate: Fraction, frame_count: int) -> None:
    """Make the scene run at the take's rate, from its first frame to its last.

    Where things moved before, the range grows to hold them too.
    """
    start, end = FIRST_FRAME, FIRST_FRAME + frame_count - 1
    if _has_motion(scene):
        start, end = min(start, scene.frame_start), max(end, scene.frame_end)
    scene.render.fps, scene.render.fps_base = split_rate(rate)
    scene.frame_start, scene.frame_end = start, end
    scene.frame_set(FIRST_FRAME)


def clock_notes(scene: bpy.types.Scene, rate: Fraction) -> list[str]:
    """What to tell a user whose scene moves at another rate than a take's; to be asked before `set_clock`."""
    old = scene.render.fps / scene.render.fps_base
    if not _has_motion(scene) or math.isclose(old, rate, rel_tol=1e-6):
        return []
    change = f"The scene ran at {old:.6g} frames per second and now runs at the take's {float(rate):.6g}"
    return [f"{change}: its older motion plays at the new rate."]


def _has_motion(scene: bpy.types.Scene) -> bool:
    return any(obj.animation_data and obj.animation_data.action for obj in scene.objects)


def split_rate(rate: Fraction) -> tuple[int, float]:
    """Blender's two numbers: frames per second = fps / base.

    30000/1001 becomes 30 / 1.001, 25/2 becomes 25 / 2: the quotient is the rate to within single precision.
    """
    if rate.numerator <= _LARGEST_WHOLE_RATE:
        return rate.numerator, float(rate.denominator)
    fps = max(round(rate), 1)
    return fps, float(fps / rate)
