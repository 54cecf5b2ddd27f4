"""Forward kinematics and linear blend skinning in numpy.

Frames: everything is in the body's own rest frame (SMPL axes: y up, z to the front, x to the body's left, metres).
The root turns about `rest_joints[0]` and stays there; a solved person is `scale * points + gamma` (camera frame).
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.body.skeleton import PARENTS
from core_solver.geometry import matrix_from_rotvec

Array = NDArray[np.float64]


def pose_joints(theta: ArrayLike, rest_joints: ArrayLike) -> tuple[Array, Array]:
    """Forward kinematics.

    Args:
        theta: (..., 24, 3) each joint's rotation relative to its parent, axis-angle in radians.
        rest_joints: (24, 3), or (..., 24, 3) with one rest pose per batch entry, metres.

    Returns:
        rotations (..., 24, 3, 3) from the rest pose to the posed body, and joint positions (..., 24, 3) in metres.
    """
    local = matrix_from_rotvec(theta)
    rest = np.broadcast_to(np.asarray(rest_joints, float), local.shape[:-1])
    rotations = np.empty_like(local)
    positions = np.empty(local.shape[:-1])
    for joint, parent in enumerate(PARENTS):
        if parent < 0:
            rotations[..., joint, :, :] = local[..., joint, :, :]
            positions[..., joint, :] = rest[..., joint, :]
            continue
        turn = rotations[..., parent, :, :]
        rotations[..., joint, :, :] = turn @ local[..., joint, :, :]
        bone = rest[..., joint, :] - rest[..., parent, :]
        positions[..., joint, :] = positions[..., parent, :] + (turn @ bone[..., None])[..., 0]
    return rotations, positions


def skin(
    rest_points: ArrayLike, weights: ArrayLike, rotations: ArrayLike, positions: ArrayLike, rest_joints: ArrayLike
) -> Array:
    """Linear blend skinning: each point is the weighted mean of where every joint would carry it.

    Args:
        rest_points: (P, 3) or (..., P, 3) metres.
        weights: (P, 24), rows sum to 1.
        rotations: (..., 24, 3, 3) from `pose_joints`.
        positions: (..., 24, 3) metres, from `pose_joints`.
        rest_joints: (24, 3) or (..., 24, 3) metres: the ones given to `pose_joints`.

    Returns:
        (..., P, 3) metres.
    """
    rotations, positions, rest_joints = (np.asarray(a, float) for a in (rotations, positions, rest_joints))
    points, weights = np.asarray(rest_points, float), np.asarray(weights, float)
    offsets = positions - (rotations @ rest_joints[..., None])[..., 0]
    # sum_j w_j (R_j v + t_j) is linear in the joints' (R_j, t_j): one product with the coefficients w_j v and w_j.
    coefficients = weights[:, :, None] * points[..., None, :]
    coefficients = coefficients.reshape(*coefficients.shape[:-2], -1)
    columns = np.swapaxes(rotations, -1, -2).reshape(*rotations.shape[:-3], -1, 3)
    return coefficients @ columns + weights @ offsets


def pose_blend(theta: ArrayLike, pose_directions: ArrayLike) -> Array:
    """SMPL's pose-dependent corrections, to be added to the rest vertices before skinning.

    Args:
        theta: (..., 24, 3) radians.
        pose_directions: (V, 3, 207) metres per unit of (rotation - identity) of the 23 joints below the root.

    Returns:
        (..., V, 3) metres.
    """
    features = matrix_from_rotvec(np.asarray(theta, float)[..., 1:, :]) - np.eye(3)
    features = features.reshape(*features.shape[:-3], -1)
    return np.tensordot(features, np.asarray(pose_directions, float), axes=([-1], [-1]))
