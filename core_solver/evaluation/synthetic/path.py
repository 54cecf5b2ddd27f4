"""What somebody does, as a list of moves, and the smooth path over the ground that follows from it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GESTURES = ("wave", "talk", "cheer", "dance")
GRAVITY = 9.81

_RATE = 240  # path samples a second
_BLEND_S = 0.45  # over which one move passes into the next
_PUSH_S, _CUSHION_S = 0.22, 0.16  # from deepest crouch to take-off, from landing to deepest crouch


@dataclass(frozen=True)
class Move:
    """A while of doing one thing.

    Attributes:
        seconds: how long.
        speed: forwards over the ground, metres a second.
        turn: radians by which the heading changes meanwhile, anticlockwise seen from above.
        crouch: share of the leg's length by which the pelvis sinks.
        gesture: one of GESTURES, or nothing.
        jumps: seconds in the air of a jump in the middle of the move; 0 for none.
    """

    seconds: float
    speed: float = 0.0
    turn: float = 0.0
    crouch: float = 0.0
    gesture: str = ""
    jumps: float = 0.0


@dataclass(frozen=True)
class Script:
    """Where somebody starts and what follows; afterwards they stand.

    Attributes:
        start: (x, y) world metres.
        heading: radians from the world's x axis.
        moves: one after the other.
    """

    start: tuple[float, float]
    heading: float
    moves: tuple[Move, ...]


@dataclass(frozen=True)
class RootPath:
    """A script in time, sampled densely.

    Attributes:
        times: (K,) seconds, from before the first frame to after the last.
        position: (K, 2) world metres.
        heading: (K,) radians.
        crouch: (K,) share of the leg's length.
        gestures: (K, G) how much of each of GESTURES.
        jumps: (take-off, landing) seconds.
    """

    times: Array
    position: Array
    heading: Array
    crouch: Array
    gestures: Array
    jumps: tuple[tuple[float, float], ...]

    def at(self, values: Array, times: Array | float) -> Array:
        """Linear interpolation of (K, ...) samples at (...) times."""
        times = np.asarray(times, float)
        place = np.clip((times - self.times[0]) * _RATE, 0, len(self.times) - 1.001)
        low = place.astype(int)
        share = (place - low).reshape(times.shape + (1,) * (values.ndim - 1))
        return values[low] * (1 - share) + values[low + 1] * share

    def velocity(self, times: Array | float) -> Array:
        """(..., 2) metres a second."""
        step = 0.02
        times = np.asarray(times, float)
        return (self.at(self.position, times + step) - self.at(self.position, times - step)) / (2 * step)


def root_path(script: Script, seconds: float, lead: float = 2.0) -> RootPath:
    """The path of a script.

    Args:
        script: what to do, from time 0 on.
        seconds: length of the clip.
        lead: seconds by which the first move is extended backwards and the end forwards.
    """
    times = np.arange(round(-lead * _RATE), round((seconds + lead) * _RATE) + 1) / _RATE
    ends = np.cumsum([move.seconds for move in script.moves])
    after = Move(1.0)
    rows = np.searchsorted(ends, np.maximum(times, 0), side="right")
    moves = (*script.moves, after)

    def channel(value: list[float]) -> Array:
        return _blended(np.array(value)[rows])

    speed = channel([move.speed for move in moves])
    heading = script.heading + _integral(channel([move.turn / move.seconds for move in moves]), times)
    steps = speed[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
    position = np.asarray(script.start) + np.stack([_integral(axis, times) for axis in steps.T], axis=1)
    jumps = tuple(
        (float(end - move.seconds / 2 - move.jumps / 2), float(end - move.seconds / 2 + move.jumps / 2))
        for move, end in zip(script.moves, ends, strict=True)
        if move.jumps
    )
    crouch = channel([move.crouch for move in moves])
    for takeoff, landing in jumps:
        depth = 0.5 * (landing - takeoff)
        crouch = crouch + depth * (_bump(times, takeoff - _PUSH_S, 0.16) + _bump(times, landing + _CUSHION_S, 0.14))
    gestures = np.stack([channel([float(move.gesture == name) for move in moves]) for name in GESTURES], axis=1)
    return RootPath(times, position, heading, crouch, gestures, jumps)


def _blended(values: Array) -> Array:
    """Steps become smooth ramps: two box filters make a quadratic one."""
    width = max(1, round(_BLEND_S * _RATE / 2))
    kernel = np.convolve(np.full(width, 1 / width), np.full(width, 1 / width))
    padded = np.pad(values, (len(kernel) // 2, len(kernel) - 1 - len(kernel) // 2), mode="edge")
    return np.convolve(padded, kernel, mode="valid")


def _integral(values: Array, times: Array) -> Array:
    """Integral of samples, 0 at time 0."""
    total = np.concatenate([[0.0], np.cumsum((values[1:] + values[:-1]) / 2) / _RATE])
    return total - np.interp(0.0, times, total)


def _bump(times: Array, centre: float, width: float) -> Array:
    """A smooth hill of height 1 that ends `width` seconds to both sides."""
    near = np.clip(np.abs(times - centre) / width, 0, 1)
    return (1 - near**2) ** 2
