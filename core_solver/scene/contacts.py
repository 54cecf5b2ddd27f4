"""Which foot stands on the ground: first from the picture alone, then from the solved motion."""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core_solver.body.skeleton import keypoint_index

Array = NDArray[np.float64]

_FEET = [[keypoint_index(f"{side}_{part}") for part in ("heel", "toe", "ankle")] for side in ("left", "right")]
_WINDOW_S = 0.12
_STILL_SIZES_PER_S = 0.35
_SOLE_HEIGHT_M = 0.08
_SOLE_HEIGHT_PER_M = 0.025


def still_feet(pixels: Array, confidence: Array, size: Array, times: Array) -> Array:
    """Probability that a foot rests in the picture: a static camera shows a planted foot as a still one.

    Args:
        pixels: (N, T, 25, 2).
        confidence: (N, T, 25).
        size: (N, T) extent of the person in pixels.
        times: (T,) seconds.

    Returns:
        (N, T, 2) for the left and the right foot; 0 where the foot is not seen. A raised foot may be still too.
    """
    result = np.zeros((*size.shape, 2))
    for side, points in enumerate(_FEET):
        speed = _windowed_speed(np.median(pixels[:, :, points], axis=2), times) / size
        seen = np.median(confidence[:, :, points], axis=2)
        result[..., side] = expit((_STILL_SIZES_PER_S - speed) / 0.1) * np.clip(2 * seen, 0, 1) * (seen > 0.1)
    return result


def contact_probability(sole_heights: Array, still: Array, distance: Array) -> Array:
    """Probability that a sole stands on its support: low in the world and still in the picture.

    The picture is the better witness of rest: solved depth trembles by more than a foot creeps.

    Args:
        sole_heights: (N, T, 2) metres of each foot's lowest point above its support.
        still: (N, T, 2) from `still_feet`.
        distance: (N, T) metres from the camera: the height of far feet is known less well.

    Returns:
        (N, T, 2).
    """
    tolerance = np.maximum(_SOLE_HEIGHT_M, _SOLE_HEIGHT_PER_M * distance)[..., None]
    return expit(5 * (1 - np.abs(sole_heights) / tolerance)) * still


def _windowed_speed(points: Array, times: Array) -> Array:
    """Speed of (N, T, D) points over a short window around each frame, which averages detector noise."""
    count = len(times)
    if count == 1:
        return np.zeros(points.shape[:2])
    half = max(1, round(_WINDOW_S / 2 / np.median(np.diff(times))))
    before, after = np.maximum(np.arange(count) - half, 0), np.minimum(np.arange(count) + half, count - 1)
    return np.linalg.norm(points[:, after] - points[:, before], axis=-1) / (times[after] - times[before])
