"""The torch twin of `body.kinematics`: differentiable, batched over leading dimensions, on any device."""

from itertools import pairwise

import torch
from torch import Tensor

from core_solver.body.skeleton import LEVELS, PARENTS
from core_solver.geometry.torch_ops import matrix_from_rotvec

# For every level below the root: where each joint's parent stands within the level above.
_PARENT_SLOTS = [[above.index(PARENTS[j]) for j in level] for above, level in pairwise(LEVELS)]
_LEVEL_ORDER = [joint for level in LEVELS for joint in level]
_SLOT_OF_JOINT = [_LEVEL_ORDER.index(joint) for joint in range(len(PARENTS))]


def pose_joints(theta: Tensor, rest_joints: Tensor) -> tuple[Tensor, Tensor]:
    """Forward kinematics in 9 steps, one for each level of the tree.

    Args:
        theta: (..., 24, 3) each joint's rotation relative to its parent, axis-angle in radians.
        rest_joints: (24, 3), or anything that broadcasts with theta, metres.

    Returns:
        rotations (..., 24, 3, 3) from the rest pose to the posed body, and joint positions (..., 24, 3) in metres.
    """
    local = matrix_from_rotvec(theta)
    rest = rest_joints.expand(theta.shape)
    bones = rest - rest[..., [max(parent, 0) for parent in PARENTS], :]
    rotations, positions = [local[..., :1, :, :]], [rest[..., :1, :]]
    for level, slots in zip(LEVELS[1:], _PARENT_SLOTS, strict=True):
        turn = rotations[-1][..., slots, :, :]
        step = (turn @ bones[..., level, :, None])[..., 0]
        positions.append(positions[-1][..., slots, :] + step)
        rotations.append(turn @ local[..., level, :, :])
    return torch.cat(rotations, -3)[..., _SLOT_OF_JOINT, :, :], torch.cat(positions, -2)[..., _SLOT_OF_JOINT, :]


def skin(rest_points: Tensor, weights: Tensor, rotations: Tensor, positions: Tensor, rest_joints: Tensor) -> Tensor:
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
    offsets = positions - (rotations @ rest_joints[..., None])[..., 0]
    # sum_j w_j (R_j v + t_j) is linear in the joints' (R_j, t_j): one product with the coefficients w_j v and w_j.
    coefficients = (weights[:, :, None] * rest_points[..., None, :]).flatten(-2)
    columns = rotations.transpose(-1, -2).flatten(-3, -2)
    return coefficients @ columns + weights @ offsets


def pose_blend(theta: Tensor, pose_directions: Tensor) -> Tensor:
    """SMPL's pose-dependent corrections, to be added to the rest vertices before skinning.

    Args:
        theta: (..., 24, 3) radians.
        pose_directions: (V, 3, 207) metres per unit of (rotation - identity) of the 23 joints below the root.

    Returns:
        (..., V, 3) metres.
    """
    identity = torch.eye(3, dtype=theta.dtype, device=theta.device)
    features = (matrix_from_rotvec(theta[..., 1:, :]) - identity).flatten(-3)
    return torch.einsum("...f,vcf->...vc", features, pose_directions)
