"""Rows that give a point of a body as a combination of its rest vertices, whatever the shape."""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls
from scipy.spatial import KDTree

Array = NDArray[np.float64]

_NEIGHBOURS = 80
_TEMPLATE_WEIGHT = 3.0  # the mean place matters more than one standard deviation of one shape direction
_SUM_WEIGHT = 10.0
_SPREAD_WEIGHT = 2e-3  # prefers many small entries to a few large ones


def fit_regressor(vertices: Array, directions: Array, points: Array, point_directions: Array, *, convex: bool) -> Array:
    """Least squares over the nearest vertices, so that each row follows the shape directions too.

    Args:
        vertices: (V, 3) mean rest vertices, metres.
        directions: (V, 3, K) metres per unit of beta.
        points: (n, 3) where the points are in the mean.
        point_directions: (n, 3, K).
        convex: only non-negative entries, for points that are skinned like vertices. Joints do better without: those
            of the spine do not move with shape as any mean of the flesh around them does.

    Returns:
        (n, V) rows, each summing to 1.
    """
    regressor = np.zeros((len(points), len(vertices)))
    neighbours = np.asarray(KDTree(vertices).query(points, k=_NEIGHBOURS)[1])
    for row, near, point, moves in zip(regressor, neighbours, points, point_directions, strict=True):
        system = np.concatenate(
            [
                _TEMPLATE_WEIGHT * (vertices[near] - point).T,
                (directions[near] - moves).transpose(1, 2, 0).reshape(-1, len(near)),
                np.full((1, len(near)), _SUM_WEIGHT),
                _SPREAD_WEIGHT * np.eye(len(near)),
            ]
        )
        goal = np.zeros(len(system))
        goal[-len(near) - 1] = _SUM_WEIGHT
        solution = (
            nnls(system, goal, maxiter=100 * len(near))[0] if convex else np.linalg.lstsq(system, goal, rcond=None)[0]
        )
        row[near] = solution / solution.sum()
    return regressor


def symmetrise_rows(rows: Array, mirror_row: NDArray[np.int_], mirror_vertex: NDArray[np.int_]) -> Array:
    """Average each row (n, V) with the mirrored row of the other side."""
    return (rows + rows[mirror_row][:, mirror_vertex]) / 2
