"""Small mendings of one person's keypoints that need the neighbouring frames."""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES, keypoint_index

Array = NDArray[np.float64]

_OUTLIER = 0.15  # sizes away from the middle of the neighbours
_FLIP_GAIN = 0.4  # a swap of sides must bring the keypoints this much nearer to be believed
_FLIP_DISTANCE = 0.06  # sizes: below this left and right lie so close that a swap means nothing

_LEGS = ("hip", "knee", "ankle", "heel", "toe")
_ARMS = ("shoulder", "elbow", "wrist", "index", "pinky")


def _sides(parts: tuple[str, ...]) -> tuple[list[int], list[int]]:
    left = [keypoint_index(f"left_{part}") for part in parts]
    right = [keypoint_index(f"right_{part}") for part in parts]
    return left + right, right + left


_LIMBS = (_sides(_LEGS), _sides(_ARMS))


def swap_flipped_sides(
    keypoints: Array, confidence: Array, sizes: Array, adjacent: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Find single frames whose left and right legs or arms are exchanged.

    Args:
        keypoints: (n, 25, 2) pixels, of the sights in order of time.
        confidence: (n, 25).
        sizes: (n,) pixels.
        adjacent: (n,) whether the sights before and after are in the neighbouring frames.

    Returns:
        (n, 25) for each sight the index of the keypoint to take instead: the identity where all is well.
    """
    order = np.tile(np.arange(len(KEYPOINT_NAMES)), (len(keypoints), 1))
    middle = neighbour_middle(keypoints)
    for own, other in _LIMBS:
        weight = confidence[:, own] + 1e-9

        def mean_distance(indices: list[int], weight: Array = weight, own: list[int] = own) -> Array:
            apart = np.linalg.norm(keypoints[:, indices] - middle[:, own], axis=-1)
            return (apart * weight).sum(1) / weight.sum(1) / sizes

        kept, swapped = mean_distance(own), mean_distance(other)
        flipped = adjacent & (kept > _FLIP_DISTANCE) & (swapped < _FLIP_GAIN * kept)
        # Beside a flipped frame the middle is wrong too; only the frame that gains most is the flipped one.
        gain = np.where(flipped, kept - swapped, 0)
        flipped &= (gain >= np.roll(gain, 1)) & (gain >= np.roll(gain, -1))
        order[np.flatnonzero(flipped)[:, None], own] = other
    return order


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
