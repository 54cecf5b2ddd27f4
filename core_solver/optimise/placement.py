"""Where a body of known pose stands: a closed form that works from 1 m to 50 m."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def place(points: Array, rays: Array, weights: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The translation that puts body points onto viewing rays, by linear least squares.

    A point p + t on the ray (x, y, 1) satisfies p_x + t_x = x (p_z + t_z), likewise in y: two equations that are linear
    in t. Their residual is the image error times depth, hence the second pass divides by the depths of the first.

    Args:
        points: (..., K, 3) metres, body-centred, camera axes.
        rays: (..., K, 2) x and y of the rays with z = 1.
        weights: (..., K) non-negative.

    Returns:
        (..., 3) metres, and (...) whether the solution is well-determined and in front of the camera.
    """
    depth = np.ones(points.shape[:-1])
    translation = np.zeros((*points.shape[:-2], 3))
    for _ in range(3):
        translation = _solve(points, rays, weights / depth**2)
        depth = np.maximum(points[..., 2] + translation[..., 2:], 0.1)
    in_front = np.all((points[..., 2] + translation[..., 2:] > 0.1) | (weights <= 0), axis=-1)
    enough = np.sum(weights > 0, axis=-1) >= 3
    return translation, in_front & enough & np.all(np.isfinite(translation), axis=-1)


def _solve(points: Array, rays: Array, weights: Array) -> Array:
    x, y = rays[..., 0], rays[..., 1]
    right = np.stack([x * points[..., 2] - points[..., 0], y * points[..., 2] - points[..., 1]], -1)

    def total(values: Array) -> Array:
        return np.sum(weights * values, axis=-1)

    one, zero = total(np.ones_like(x)), np.zeros(x.shape[:-1])
    normal = np.stack(
        [
            np.stack([one, zero, -total(x)], -1),
            np.stack([zero, one, -total(y)], -1),
            np.stack([-total(x), -total(y), total(x**2 + y**2)], -1),
        ],
        -2,
    )
    rhs = np.stack([total(right[..., 0]), total(right[..., 1]), -total(x * right[..., 0] + y * right[..., 1])], -1)
    # A trace of regularisation keeps frames without evidence solvable; they are marked, not used.
    return np.linalg.solve(normal + 1e-12 * np.eye(3), rhs[..., None])[..., 0]
