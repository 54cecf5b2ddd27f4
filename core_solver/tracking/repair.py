"""Small mendings of one person's keypoints that need the neighbouring frames."""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES, keypoint_index
from core_solver.tracking.sights import OTHER_SIDE

Array = NDArray[np.float64]

_OUTLIER = 0.15  # sizes away from the middle of the neighbours
_FLIP_GAIN = 0.4  # a swap of sides must bring the keypoints this much nearer to be believed
_FLIP_DISTANCE = 0.06  # sizes: below this left and right lie so close that a swap means nothing
_FLIP_SECONDS = 1.0  # a longer stretch is somebody who really turned round
_COMPARED_SECONDS = 0.25  # sights further apart say nothing about swaps: limbs move

_UPPER = ("eye", "ear", "shoulder", "elbow", "wrist", "index", "pinky")
_LOWER = ("hip", "knee", "ankle", "heel", "toe")


def _both_sides(parts: tuple[str, ...]) -> NDArray[np.int64]:
    return np.array([keypoint_index(f"{side}_{part}") for side in ("left", "right") for part in parts])


_HALVES = (_both_sides(_UPPER), _both_sides(_LOWER))


def swap_flipped_sides(keypoints: Array, confidence: Array, sizes: Array, times: Array) -> NDArray[np.int64]:
    """Find short stretches in which the sides of the upper or the lower body are exchanged.

    Args:
        keypoints: (n, 25, 2) pixels, of the sights in order of time.
        confidence: (n, 25).
        sizes: (n,) pixels.
        times: (n,) seconds.

    Returns:
        (n, 25) for each sight the index of the keypoint to take instead: the identity where all is well.
    """
    order = np.tile(np.arange(len(KEYPOINT_NAMES)), (len(keypoints), 1))
    for half in _HALVES:
        for start, stop in _flipped_runs(_changes_of_side(keypoints, confidence, sizes, times, half), times):
            order[start:stop, half] = OTHER_SIDE[half]
    return order


def _changes_of_side(
    keypoints: Array, confidence: Array, sizes: Array, times: Array, half: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Sights that fit the one before them only with the sides exchanged."""
    before, weight_before = keypoints[:-1, half], confidence[:-1, half]

    def step(indices: NDArray[np.int64]) -> Array:
        weight = weight_before * confidence[1:, indices] + 1e-9
        apart = np.linalg.norm(keypoints[1:, indices] - before, axis=-1)
        return (apart * weight).sum(1) / weight.sum(1) / sizes[1:]

    kept, exchanged = step(half), step(OTHER_SIDE[half])
    close_in_time = np.diff(times) <= _COMPARED_SECONDS
    return np.flatnonzero(close_in_time & (kept > _FLIP_DISTANCE) & (exchanged < _FLIP_GAIN * kept)) + 1


def _flipped_runs(changes: NDArray[np.int64], times: Array) -> list[tuple[int, int]]:
    """Stretches (start, stop) between a change of side and the change back soon after."""
    runs: list[tuple[int, int]] = []
    start = 0
    while start + 1 < len(changes):
        first, back = int(changes[start]), int(changes[start + 1])
        if times[back] - times[first] <= _FLIP_SECONDS:
            runs.append((first, back))
            start += 2
        else:
            start += 1
    return runs


def outlier_factor(keypoints: Array, sizes: Array, adjacent: NDArray[np.bool_]) -> Array:
    """(n, 25) factor in (0, 1] for the confidences: small where a keypoint jumps away for one frame and comes back."""
    away = np.linalg.norm(keypoints - neighbour_middle(keypoints), axis=-1) / sizes[:, None]
    before, after = np.roll(keypoints, 1, axis=0), np.roll(keypoints, -1, axis=0)
    travelled = np.linalg.norm(after - before, axis=-1) / sizes[:, None]
    allowed = np.maximum(_OUTLIER, travelled)
    # The neighbours of a wild frame lie away from their own middles by half as much: they are not to blame.
    worst = (away >= np.roll(away, 1, axis=0)) & (away >= np.roll(away, -1, axis=0))
    wild = adjacent[:, None] & worst & (away > allowed)
    return np.where(wild, (allowed / np.where(wild, away, 1)) ** 2, 1.0)


def neighbour_middle(keypoints: Array) -> Array:
    """(n, 25, 2) mean of the sights before and after; meaningless at both ends."""
    return (np.roll(keypoints, 1, axis=0) + np.roll(keypoints, -1, axis=0)) / 2
