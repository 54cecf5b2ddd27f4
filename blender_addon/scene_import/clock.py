# SPDX-License-Identifier: GPL-3.0-or-later
"""Time: which moments of a take the scene's frames show. numpy only."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from core_solver.take import Take

Array = NDArray[np.float64]

FIRST_FRAME = 1
"""Where a take begins unless the user says otherwise."""

# Containers round time stamps to a millisecond. What lies further off is a video whose rate really varies.
_ROUNDED_STAMPS = 1e-3


@dataclass(frozen=True)
class Clock:
    """The scene's frames that show a take.

    Attributes:
        start: scene frame of the take's first moment.
        rate: the scene's frames per second.
        moments: (N,) frames of the take, counted from 0, one for each scene frame from `start` on; not whole where the
            scene's frame lies between two of the take's.
    """

    start: int
    rate: Fraction
    moments: Array

    @property
    def frames(self) -> Array:
        """(N,) scene frames."""
        return np.arange(len(self.moments), dtype=np.float64) + float(self.start)

    @property
    def end(self) -> int:
        """The last scene frame."""
        return self.start + len(self.moments) - 1

    def seconds(self, frame: int) -> float:
        """Time of the take's frame `frame` of this clock, counted from scene frame 0 as exported animations are."""
        return float((self.start + frame) / self.rate)


def clock_of_take(take: Take, start: int) -> Clock:
    """The scene runs at the take's rate and shows every frame of it."""
    return Clock(start, take.meta.frame_rate, np.arange(take.frame_count, dtype=np.float64))


def clock_of_scene(take: Take, start: int, rate: Fraction) -> Clock:
    """The scene keeps its own rate and shows the take at its true speed.

    With an even frame rate the moments are exact fractions: two seconds of 30000/1001 stay two seconds at 24. A video
    whose rate varies goes by its time stamps.
    """
    last = take.frame_count - 1
    seconds = take.times - take.times[0]
    nominal = np.arange(take.frame_count) / float(take.meta.frame_rate)
    if np.abs(seconds - nominal).max() > _ROUNDED_STAMPS:
        count = math.floor(seconds[-1] * rate) + 1
        return Clock(start, rate, np.interp(np.arange(count) / float(rate), seconds, np.arange(last + 1)))
    step = take.meta.frame_rate / rate
    count = math.floor(last / step) + 1
    return Clock(start, rate, np.arange(count) * float(step.numerator) / float(step.denominator))
