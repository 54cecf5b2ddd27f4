"""Rotations in numpy: rotation vectors (axis-angle), matrices and quaternions (w, x, y, z)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_SMALL_ANGLE = 1e-8


def skew(vectors: ArrayLike) -> Array:
    """Cross-product matrices: `skew(a) @ b == cross(a, b)`.

    Args:
        vectors: (..., 3).

    Returns:
        (..., 3, 3).
    """
    x, y, z = np.moveaxis(np.asarray(vectors, float), -1, 0)
    zero = np.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return np.stack(rows, -1).reshape(*x.shape, 3, 3)


def matrix_from_rotvec(rotvec: ArrayLike) -> Array:
    """Rodrigues' formula, exact to rounding down to zero angle.

    Args:
        rotvec: (..., 3) axis times angle in radians.

    Returns:
        (..., 3, 3) rotation matrices.
    """
    rotvec = np.asarray(rotvec, float)
    angle = np.linalg.norm(rotvec, axis=-1)[..., None, None]
    K = skew(rotvec)
    # sin(a)/a and (1-cos(a))/a^2 by numpy's sinc, which is finite at zero.
    first = np.sinc(angle / np.pi)
    second = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * K + second * (K @ K)


def quaternion_from_matrix(matrix: ArrayLike) -> Array:
    """Unit quaternions (w, x, y, z) with w >= 0, by the largest of the four candidates (Shepperd).

    Args:
        matrix: (..., 3, 3) rotation matrices.

    Returns:
        (..., 4).
    """
    m = np.asarray(matrix, float)
    trace = np.trace(m, axis1=-2, axis2=-1)
    diagonal = np.diagonal(m, axis1=-2, axis2=-1)
    # Row k of the 4x4 symmetric matrix is 4 q_k q: the row with the largest diagonal is best conditioned.
    outer = np.empty((*m.shape[:-2], 4, 4))
    outer[..., 0, 0] = 1 + trace
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        outer[..., i + 1, i + 1] = 1 + 2 * diagonal[..., i] - trace
        outer[..., 0, i + 1] = outer[..., i + 1, 0] = m[..., k, j] - m[..., j, k]
        outer[..., j + 1, k + 1] = outer[..., k + 1, j + 1] = m[..., j, k] + m[..., k, j]
    best = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(outer, best[..., None, None], axis=-2)[..., 0, :]
    q = q / np.linalg.norm(q, axis=-1, keepdims=True)
    return np.where(q[..., :1] < 0, -q, q)


def quaternion_from_rotvec(rotvec: ArrayLike) -> Array:
    """Unit quaternions (w, x, y, z).

    Args:
        rotvec: (..., 3) radians.

    Returns:
        (..., 4).
    """
    rotvec = np.asarray(rotvec, float)
    half = np.linalg.norm(rotvec, axis=-1, keepdims=True) / 2
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec], axis=-1)


def rotvec_from_matrix(matrix: ArrayLike) -> Array:
    """Rotation vectors with angle in [0, pi], stable at both ends.

    Args:
        matrix: (..., 3, 3).

    Returns:
        (..., 3) radians.
    """
    q = quaternion_from_matrix(matrix)
    w, v = q[..., :1], q[..., 1:]
    sine = np.linalg.norm(v, axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, w)
    factor = np.where(sine > _SMALL_ANGLE, angle / np.maximum(sine, _SMALL_ANGLE), 2.0)
    return factor * v


def align_vectors(source: ArrayLike, target: ArrayLike) -> Array:
    """The smallest rotations that turn `source` into the direction of `target`.

    Args:
        source: (..., 3) any length.
        target: (..., 3) any length.

    Returns:
        (..., 3, 3); for opposite vectors a half turn about some axis across them.
    """
    a, b = np.broadcast_arrays(_unit(source), _unit(target))
    # Half a turn about `a` and then about the direction midway from a to b: together twice the angle between them.
    middle = a + b
    length = np.linalg.norm(middle, axis=-1, keepdims=True)
    across = np.cross(a, np.eye(3)[np.argmin(np.abs(a), axis=-1)])
    middle = np.where(length > _SMALL_ANGLE, middle, across)
    return _half_turn(_unit(middle)) @ _half_turn(a)


def _half_turn(axes: Array) -> Array:
    return 2 * axes[..., :, None] * axes[..., None, :] - np.eye(3)


def _unit(vectors: ArrayLike) -> Array:
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
