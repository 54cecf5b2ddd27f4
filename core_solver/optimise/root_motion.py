"""People have mass: roots accelerate little, so a trembling depth can be told from a real motion."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from core_solver.energy.weights import ROOT_ACCELERATION

Array = NDArray[np.float64]

_LOG_DEPTH_SIGMA = 0.04  # of one frame's depth from the size of a skeleton
_PASSES = 4


def smooth_depths(depths: Array, known: NDArray[np.bool_], times: Array) -> Array:
    """Robust smoothing of one person's depths: the Whittaker smoother with an acceleration prior, reweighted.

    Args:
        depths: (T,) metres, > 0.
        known: (T,) frames whose depth was measured.
        times: (T,) seconds.

    Returns:
        (T,) metres: smooth where measured and in the gaps between, constant before the first and after the last.
    """
    frames = np.flatnonzero(known)
    if len(frames) < 3:
        return depths.copy()
    inside = slice(frames[0], frames[-1] + 1)
    smooth = depths.copy()
    smooth[inside] = np.exp(
        _smooth_logs(np.log(depths[inside]), known[inside], times[inside], float(np.median(depths)))
    )
    smooth[: frames[0]], smooth[frames[-1] :] = smooth[frames[0]], smooth[frames[-1]]
    return smooth


def _smooth_logs(logs: Array, known: NDArray[np.bool_], times: Array, distance: float) -> Array:
    rows = _second_differences(times) * (distance / ROOT_ACCELERATION)
    penalty = _banded_gram(rows, len(logs))
    weights = known / _LOG_DEPTH_SIGMA**2
    smooth = logs
    for _ in range(_PASSES):
        system = penalty.copy()
        system[-1] += weights + 1e-9
        smooth = solveh_banded(system, weights * logs)
        residual = (logs - smooth) / _LOG_DEPTH_SIGMA
        weights = known / (_LOG_DEPTH_SIGMA**2 * (1 + residual**2))
    return smooth


def _second_differences(times: Array) -> Array:
    """Coefficients (T - 2, 3) that turn values at three times into their second derivative."""
    before, after = times[1:-1] - times[:-2], times[2:] - times[1:-1]
    span = before + after
    return np.stack([2 / (before * span), -2 / (before * after), 2 / (after * span)], axis=-1)


def _banded_gram(rows: Array, size: int) -> Array:
    """D^T D of the band matrix with these rows, in the upper form that `solveh_banded` takes."""
    bands = np.zeros((3, size))
    for i in range(3):
        for j in range(i, 3):
            offset = j - i
            bands[2 - offset, j : j + len(rows)] += rows[:, i] * rows[:, j]
    return bands
