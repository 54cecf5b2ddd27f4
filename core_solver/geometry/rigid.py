"""Rigid and similarity transforms of point sets."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Similarity:
    """x -> scale * rotation @ x + translation.

    Attributes:
        rotation: (3, 3).
        translation: (3,) metres.
        scale: positive number; 1 for a rigid motion.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    scale: float = 1.0

    def apply(self, points: ArrayLike) -> NDArray[np.float64]:
        """Transform (..., 3) points."""
        return self.scale * np.asarray(points, float) @ self.rotation.T + self.translation


def fit_similarity(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, with_scale: bool = False
) -> Similarity:
    """The least-squares motion from `source` to `target` (Kabsch; with scale Umeyama 1991), never a reflection.

    Args:
        source: (n, 3) points.
        target: (n, 3) points.
        weights: (n,) non-negative; equal when left out.
        with_scale: also fit one scale.

    Returns:
        The transform that minimises the weighted sum of squared distances. Points that fix no scale, as when they all
        lie in one place, leave it at 1.
    """
    a, b = np.asarray(source, float), np.asarray(target, float)
    w = np.ones(len(a)) if weights is None else np.asarray(weights, float)
    w = w / w.sum()
    mean_a, mean_b = w @ a, w @ b
    U, singular, Vt = np.linalg.svd((b - mean_b).T @ (w[:, None] * (a - mean_a)))
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(U @ Vt)) or 1.0])
    rotation = U @ np.diag(signs) @ Vt
    covariance = float(singular @ signs)
    # The means are rounded, so that points in one place differ from theirs by a last digit: that is no size.
    rounding = 1e-14 * float(np.abs(a).max() * np.abs(b).max())
    spread = float(w @ np.sum((a - mean_a) ** 2, axis=1))
    scale = covariance / spread if with_scale and covariance > rounding else 1.0
    return Similarity(rotation, mean_b - scale * rotation @ mean_a, scale)
