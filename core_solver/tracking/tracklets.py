"""A tracklet is a run of sights of one person; its motion at either end says where the person went or came from."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.sights import Sight

Array = NDArray[np.float64]

_MOTION_WINDOW = 0.6  # seconds: long enough to average a step, short enough to follow a turn
_MOTION_TRUST = 0.05  # seconds: a slope over a shorter stretch is mostly noise and is shrunk towards rest
_TOP_SPEED = 4.0  # sizes a second; a sprinter covers five
APPEARANCE_SIGHTS = 12


@dataclass(frozen=True, eq=False)
class End:
    """A tracklet's state at its first or last sight.

    Attributes:
        sight: the sight there.
        velocity: (2,) pixels a second, in forward time.
        size: pixels, robust over the nearest sights.
        appearance: (D,) unit vector, mean over the nearest sights, each as far as its looks can be trusted.
        looks: in [0, 1], how far that can be trusted.
    """

    sight: Sight
    velocity: Array
    size: float
    appearance: Array
    looks: float

    def centre_at(self, time: float) -> Array:
        """Where the person is at `time` if the motion goes on."""
        return self.sight.centre + self.velocity * (time - self.sight.time)


@dataclass(frozen=True, eq=False)
class Tracklet:
    """Sights of one person in order of time."""

    sights: tuple[Sight, ...]

    @cached_property
    def first(self) -> End:
        """The state where the tracklet starts."""
        return state_at_start(self.sights)

    @cached_property
    def last(self) -> End:
        """The state where the tracklet ends."""
        return state_at_end(self.sights)


def state_at_start(sights: Sequence[Sight]) -> End:
    """Where a person with these sights came from."""
    count = 1
    while count < len(sights) and sights[count].time - sights[0].time <= _MOTION_WINDOW:
        count += 1
    return _end(sights[0], sights[:count], sights[:APPEARANCE_SIGHTS])


def state_at_end(sights: Sequence[Sight]) -> End:
    """Where a person with these sights is going."""
    count = 1
    while count < len(sights) and sights[-1].time - sights[-1 - count].time <= _MOTION_WINDOW:
        count += 1
    return _end(sights[-1], sights[-count:], sights[-APPEARANCE_SIGHTS:])


def mean_appearance(sights: Sequence[Sight]) -> Array:
    """(D,) unit vector: the looks in these sights, each as far as they can be trusted."""
    trust = np.array([s.looks for s in sights], float) ** 2
    looks = np.stack([s.detection.appearance for s in sights]).astype(float)
    appearance: Array = np.einsum("s,sd->d", trust, looks)
    length = float(np.linalg.norm(appearance))
    return appearance / length if length > 0 else appearance


def _end(sight: Sight, moving: Sequence[Sight], looking: Sequence[Sight]) -> End:
    size = sorted(s.size for s in moving)[len(moving) // 2]
    looks = float(np.mean([s.looks for s in looking]))
    return End(sight, _velocity(moving, size), size, mean_appearance(looking), looks)


def _velocity(sights: Sequence[Sight], size: float) -> Array:
    """Slope between the medians of the earlier and the later half: one wild sight cannot turn it."""
    if len(sights) < 2:
        return np.zeros(2)
    times = np.array([s.time for s in sights])
    centres = np.stack([s.centre for s in sights])
    half = len(sights) // 2
    elapsed = times[-half:].mean() - times[:half].mean()
    if elapsed <= 0:
        return np.zeros(2)
    step = _middle(centres[-half:]) - _middle(centres[:half])
    span = times[-1] - times[0]
    velocity = step / elapsed * span / (span + _MOTION_TRUST)
    speed = np.linalg.norm(velocity)
    return velocity * min(1.0, _TOP_SPEED * size / speed) if speed > 0 else velocity


def _middle(values: Array) -> Array:
    """The upper median along the first axis; `np.median` costs ten times as much on a handful of numbers."""
    return np.sort(values, axis=0)[len(values) // 2]
