"""Which way the surfaces of a depth map face."""

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera

Array = NDArray[np.float64]

_SAME_SURFACE = 3.0  # how much steeper than the gentler neighbour the steeper one may be and still belong to it


def grid_points(depth: NDArray[np.float32], camera: Camera) -> Array:
    """Points (h, w, 3) of a depth map laid over the whole image, metres, camera frame; NaN where unknown."""
    return camera.grid_rays(*depth.shape) * depth[..., None]


def depth_normals(points: Array) -> Array:
    """Unit normals of the surface through a grid of points, by differences that do not reach across depth edges.

    Along a plane the inverse depth changes linearly over the picture. So of a pixel's two neighbours in a row those
    belong to its surface by which the inverse depth changes about alike; with an edge on one side it changes much more
    there, and only the other side is used.

    Args:
        points: (h, w, 3) metres, camera frame, NaN where unknown; from `grid_points`.

    Returns:
        (h, w, 3) towards the camera; NaN where there is no neighbour in a row or in a column.
    """
    inverse = 1 / points[..., 2]
    across, down = _tangent(points, inverse), _tangent(points.swapaxes(0, 1), inverse.T).swapaxes(0, 1)
    normals = np.cross(across, down)
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    normals /= np.where(length > 0, length, np.nan)
    faces_away = np.einsum("hwc,hwc->hw", normals, points) > 0
    return np.where(faces_away[..., None], -normals, normals)


def _tangent(points: Array, inverse: Array) -> Array:
    """Direction (h, w, 3) of the surface along the rows of the grid."""
    after, before = np.full_like(points, np.nan), np.full_like(points, np.nan)
    after[:, :-1] = np.diff(points, axis=1)
    before[:, 1:] = np.diff(points, axis=1)
    change = np.full_like(inverse, np.inf)
    forth, back = change.copy(), change.copy()
    forth[:, :-1] = np.diff(inverse, axis=1)
    back[:, 1:] = np.diff(inverse, axis=1)
    forth, back = (np.where(np.isfinite(x), np.abs(x), np.inf) for x in (forth, back))
    floor = 1e-6 * inverse  # rounding
    use_after, use_before = forth <= _SAME_SURFACE * back + floor, back <= _SAME_SURFACE * forth + floor
    total = np.where(use_after[..., None], after, 0) + np.where(use_before[..., None], before, 0)
    known = np.isfinite(np.minimum(forth, back))
    return np.where(known[..., None], total, np.nan)
