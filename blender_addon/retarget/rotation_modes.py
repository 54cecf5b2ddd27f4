# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations as the numbers a bone is keyed with: quaternions, axis and angle, or Euler angles in six orders.

Euler angles of order "XYZ" turn about x first, then about the fixed y, then about the fixed z: R = Rz Ry Rx.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec, quaternion_from_matrix

from .skeleton import without_flips

Array = NDArray[np.float64]

QUATERNION, AXIS_ANGLE = "QUATERNION", "AXIS_ANGLE"
PROPERTIES = {QUATERNION: "rotation_quaternion", AXIS_ANGLE: "rotation_axis_angle"}
"""The pose bone's property of each mode; all others are orders of `EULER_PROPERTY`."""
EULER_PROPERTY = "rotation_euler"

_TURN = 2 * np.pi
_SMALL = 1e-7


def property_of(mode: str) -> str:
    """The pose bone's property that a rotation mode reads."""
    return PROPERTIES.get(mode, EULER_PROPERTY)


def matrices_from_channels(values: Array, mode: str) -> Array:
    """(..., 3, 3) what Blender makes of keyed numbers.

    Args:
        values: (..., 4) quaternions (w, x, y, z) of any length or (angle, x, y, z), (..., 3) Euler angles; radians.
        mode: "QUATERNION", "AXIS_ANGLE", or an order of axes such as "XYZ".
    """
    if mode == QUATERNION:
        return _matrix_from_quaternion(values)
    if mode == AXIS_ANGLE:
        length = np.linalg.norm(values[..., 1:], axis=-1, keepdims=True)
        axes = np.where(length > 0, values[..., 1:] / np.where(length > 0, length, 1.0), 0.0)
        return matrix_from_rotvec(axes * values[..., :1])
    turns = [matrix_from_rotvec(values[..., axis, None] * np.eye(3)[axis]) for axis in _axes(mode)]
    return turns[2] @ turns[1] @ turns[0]


def channels_from_matrices(matrices: Array, mode: str) -> Array:
    """(T, N, 4 or 3) numbers that Blender can be keyed with: neighbours in time are as alike as their rotations.

    Args:
        matrices: (T, N, 3, 3) rotations of N bones over time.
        mode: as in `matrices_from_channels`, which is the inverse.
    """
    quaternions = without_flips(quaternion_from_matrix(matrices))
    if mode == QUATERNION:
        return quaternions
    if mode == AXIS_ANGLE:
        return _axis_angles(quaternions)
    return _followed(_euler(matrices, mode), lambda now, before: _nearest_euler(now, before, _axes(mode)))


def _axes(mode: str) -> list[int]:
    return ["XYZ".index(letter) for letter in mode]


def _matrix_from_quaternion(quaternions: Array) -> Array:
    # Twice the half angle is right for any length; Blender, too, takes a quaternion without length for no rotation.
    sine = np.linalg.norm(quaternions[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, quaternions[..., :1])
    return matrix_from_rotvec(angle * quaternions[..., 1:] / np.where(sine > 0, sine, 1.0))


def _euler(matrices: Array, mode: str) -> Array:
    """(..., 3) angles about x, y, z with the middle one in [-pi/2, pi/2]; where that is upright the last one is 0."""
    i, j, k = _axes(mode)
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    m = matrices
    cosine = np.hypot(m[..., i, i], m[..., j, i])
    free = cosine > _SMALL
    angles = np.empty(m.shape[:-1])
    angles[..., j] = np.arctan2(-sign * m[..., k, i], cosine)
    angles[..., i] = np.where(
        free, np.arctan2(sign * m[..., k, j], m[..., k, k]), np.arctan2(-sign * m[..., j, k], m[..., j, j])
    )
    angles[..., k] = np.where(free, np.arctan2(sign * m[..., j, i], m[..., i, i]), 0.0)
    return angles


def _nearest_euler(now: Array, before: Array, axes: list[int]) -> Array:
    """Of all angles that give one rotation, those nearest to the ones before.

    The first and last turned by half a turn, with the middle one mirrored about a quarter turn, is the same rotation.
    """
    other = now + np.pi
    other[..., axes[1]] = np.pi - now[..., axes[1]]
    near, far = (angles + _TURN * np.round((before - angles) / _TURN) for angles in (now, other))
    is_near = np.abs(near - before).sum(-1) <= np.abs(far - before).sum(-1)
    return np.where(is_near[..., None], near, far)


def _axis_angles(quaternions: Array) -> Array:
    sine = np.linalg.norm(quaternions[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, quaternions[..., :1])
    # A rotation by nothing has no axis: zeros, which _nearest_axis_angle replaces.
    axis = np.where(sine > _SMALL, quaternions[..., 1:] / np.maximum(sine, _SMALL), 0.0)
    values: Array = np.concatenate([angle, axis], axis=-1)
    values[0] = _nearest_axis_angle(values[0], np.broadcast_to([0.0, 0.0, 1.0, 0.0], values[0].shape))
    return _followed(values, _nearest_axis_angle)


def _nearest_axis_angle(now: Array, before: Array) -> Array:
    """The axis on the side of the one before, and as many whole turns as that had."""
    axis = now[..., 1:]
    side = np.where(np.sum(axis * before[..., 1:], axis=-1, keepdims=True) < 0, -1.0, 1.0)
    still = np.sum(axis * axis, axis=-1, keepdims=True) == 0
    axis = np.where(still, before[..., 1:], side * axis)
    angle = np.where(still, 0.0, side * now[..., :1])
    return np.concatenate([angle + _TURN * np.round((before[..., :1] - angle) / _TURN), axis], axis=-1)


def _followed(values: Array, nearest: Callable[[Array, Array], Array]) -> Array:
    """Choose for each frame the form nearest to the frame before."""
    result = values.copy()
    for frame in range(1, len(result)):
        result[frame] = nearest(result[frame], result[frame - 1])
    return result
