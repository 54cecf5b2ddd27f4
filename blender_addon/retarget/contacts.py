# SPDX-License-Identifier: GPL-3.0-or-later
"""Which foot stands when, for motions that do not say: low and slow."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .bone_map import BoneMap
from .landmarks import soles
from .skeleton import Motion, Skeleton

Array = NDArray[np.float64]

# A sole stands that is so near to its lowest, in parts of the hips' height at rest, and no faster than this.
_LOW = 0.05
_SLOW = 0.35  # metres per second for an adult: what is slower has arrived
_SHORTEST = 0.08  # seconds that a foot stands, and that it is away
_ADULT = 0.9  # metres from the ground to an adult's hips


def detect_contacts(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Array:
    """(T, 2) 1 where the left and the right foot stand, else 0; on level ground.

    Args:
        skeleton: of who moves.
        bone_map: its roles.
        motion: at even times.
    """
    if len(motion.times) < 2:
        return np.ones((len(motion.times), 2))
    ends = [np.stack([s.heel.positions(motion), s.ball.positions(motion)]) for s in soles(skeleton, bone_map)]
    floor = float(np.percentile(np.stack(ends)[..., 2].min(axis=(0, 1)), 5))
    hips = skeleton.heads[skeleton.index(bone_map.needed("hips")), 2]
    tall = float(hips - min(sole.min() for sole in (skeleton.heads[:, 2], skeleton.tails[:, 2])))
    feet = [_stands(end, floor, motion.times, tall) for end in ends]
    return np.stack(feet, axis=1).astype(float)


def _stands(ends: Array, floor: float, times: Array, tall: float) -> NDArray[np.bool_]:
    """(T,) whether heel or ball (2, T, 3) rests."""
    speed = np.linalg.norm(np.gradient(ends, times, axis=1), axis=-1)
    rests = (ends[..., 2] - floor < _LOW * tall) & (speed < _SLOW * tall / _ADULT)
    frames = max(round(_SHORTEST / float(np.median(np.diff(times)))), 1)
    return _without_short(_without_short(rests.any(axis=0), frames, value=False), frames, value=True)


def _without_short(flags: NDArray[np.bool_], shortest: int, *, value: bool) -> NDArray[np.bool_]:
    """Flags whose runs of `value` last at least so long, save at either end of time; shorter ones are turned over."""
    edges = np.flatnonzero(np.diff(flags.astype(int))) + 1
    result = flags.copy()
    for start, stop in pairwise(edges):
        if flags[start] == value and stop - start < shortest:
            result[start:stop] = not value
    return result
