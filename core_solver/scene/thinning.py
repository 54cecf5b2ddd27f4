"""Fewer points, spread evenly through space."""

import numpy as np
from numpy.typing import NDArray

_STEPS = 14  # halvings of the interval that holds the voxel's size


def thin_evenly(points: NDArray, most: int) -> NDArray[np.int64]:
    """Choose points spread evenly through space, where a depth map crowds them near the camera.

    One point a voxel, that nearest its centre; the voxels as small as `most` allows.

    Args:
        points: (P, 3) metres.
        most: points at most.

    Returns:
        Increasing indices of the chosen ones: all when they are few enough.
    """
    if len(points) <= most:
        return np.arange(len(points))
    origin = points.min(axis=0)
    extent = float((points.max(axis=0) - origin).max())
    # In the logarithm of the size; a voxel larger than everything leaves one point.
    small, large = np.log(max(extent, 1e-9) * np.array([1e-6, 1.001]))
    for _ in range(_STEPS):
        middle = (small + large) / 2
        fits = len(np.unique(_voxels(points - origin, np.exp(middle)))) <= most
        small, large = (small, middle) if fits else (middle, large)
    return voxel_representatives(points, float(np.exp(large)))


def voxel_representatives(points: NDArray, size: float) -> NDArray[np.int64]:
    """Increasing indices of one of (P, 3) points a voxel of this size (metres): the one nearest its centre."""
    relative = points - points.min(axis=0)
    voxel = _voxels(relative, size)
    off_centre = np.linalg.norm(relative / size % 1 - 0.5, axis=1)
    order = np.lexsort((off_centre, voxel))
    _, first = np.unique(voxel[order], return_index=True)
    return np.sort(order[first])


def _voxels(points: NDArray, size: float) -> NDArray[np.int64]:
    """A number for each point's voxel."""
    column, row, layer = np.floor(points / size).astype(np.int64).T
    return (column << 42) + (row << 21) + layer
