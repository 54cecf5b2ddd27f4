# SPDX-License-Identifier: GPL-3.0-or-later
"""The scene's clock: frame rate and range of a take."""

from fractions import Fraction

import bpy

from .world import FIRST_FRAME

# Blender shows whole rates up to this; larger numerators are such as 30000/1001.
_LARGEST_WHOLE_RATE = 240


def set_clock(scene: bpy.types.Scene, rate: Fraction, frame_count: int) -> None:
    """Make the scene run at the take's rate, from its first frame to its last."""
    scene.render.fps, scene.render.fps_base = split_rate(rate)
    scene.frame_start = FIRST_FRAME
    scene.frame_end = FIRST_FRAME + frame_count - 1
    scene.frame_set(FIRST_FRAME)


def split_rate(rate: Fraction) -> tuple[int, float]:
    """Blender's two numbers: frames per second = fps / base.

    30000/1001 becomes 30 / 1.001, 25/2 becomes 25 / 2: the quotient is the rate to within single precision.
    """
    if rate.numerator <= _LARGEST_WHOLE_RATE:
        return rate.numerator, float(rate.denominator)
    fps = max(round(rate), 1)
    return fps, float(fps / rate)
