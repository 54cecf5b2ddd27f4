"""Robust kernels: quadratic near zero, gentle to outliers."""

import torch
from torch import Tensor


def charbonnier(squared: Tensor) -> Tensor:
    """Twice the smooth absolute value: r^2 for small r, 2 |r| for large r.

    Args:
        squared: any shape, squared residuals in units of the inlier's standard deviation.

    Returns:
        The same shape, 2 (sqrt(1 + r^2) - 1).
    """
    return 2 * (torch.sqrt(1 + squared) - 1)


def geman_mcclure(squared: Tensor) -> Tensor:
    """r^2 / (1 + r^2): an outlier's pull fades to nothing.

    Args:
        squared: any shape, squared residuals in units of the inlier's standard deviation.
    """
    return squared / (1 + squared)
