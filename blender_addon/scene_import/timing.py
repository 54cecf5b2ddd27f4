# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's clock: frame rate and range of a take."""

import math
from fractions import Fraction

import bpy
import numpy as np

from .clock import Clock

# Blender shows whole rates up to this; larger numerators are such as 30000/1001.
_LARGEST_WHOLE_RATE = 240
# Largest denominator of the bases that rates are split into: 1001/1000, 1000/999, ...
_FINEST_BASE = 10_000


def set_clock(scene: bpy.types.Scene, clock: Clock) -> None:
    """Make the scene run at a clock's rate, from its first frame to its last.

    Where things moved before, the range grows to hold them too.
    """
    start, end = clock.start, clock.end
    if _has_motion(scene):
        start, end = min(start, scene.frame_start), max(end, scene.frame_end)
    if rate_of(scene) != clock.rate:
        scene.render.fps, scene.render.fps_base = split_rate(clock.rate)
    scene.frame_start, scene.frame_end = start, end
    scene.frame_set(clock.start)


def clock_notes(scene: bpy.types.Scene, rate: Fraction) -> list[str]:
    """What to tell a user whose scene moves at another rate than a take's; to be asked before `set_clock`."""
    old = float(rate_of(scene))
    if not _has_motion(scene) or math.isclose(old, rate, rel_tol=1e-6):
        return []
    change = f"The scene ran at {old:.6g} frames per second and now runs at the take's {float(rate):.6g}"
    return [f"{change}: its older motion plays at the new rate."]


def rate_of(scene: bpy.types.Scene) -> Fraction:
    """Frames per second of a scene, as the fraction that was meant: Blender keeps 1001/1000 in single precision."""
    base = scene.render.fps_base
    meant = Fraction(base).limit_denominator(_FINEST_BASE)
    return scene.render.fps / (meant if np.float32(float(meant)) == np.float32(base) else Fraction(base))


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
