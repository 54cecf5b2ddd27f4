"""Residuals for least squares that outliers do not rule; numpy twins of the kernels, which take squares."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def softened(residual: Array) -> Array:
    """Residuals whose squares grow like the residuals themselves where these are large.

    Args:
        residual: any shape, in units of the inlier's standard deviation.

    Returns:
        The same shape and signs; the squares are those of `kernels.charbonnier`.
    """
    size: Array = np.sqrt(2 * (np.sqrt(1 + residual**2) - 1))
    return np.sign(residual) * size


def saturated(residual: Array, limit: float) -> Array:
    """Residuals that grow to the limit and no further: what lies that far off may lie anywhere.

    Args:
        residual: any shape, in units of the inlier's standard deviation.
        limit: in the same units.
    """
    return limit * residual / np.sqrt(limit**2 + residual**2)
