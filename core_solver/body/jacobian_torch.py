"""How skinned points move with pose and shape, in closed form: the curvature of the energies is built from it."""

from dataclasses import dataclass

import torch
from torch import Tensor

from core_solver.body.skeleton import LEVELS, PARENTS
from core_solver.geometry.torch_ops import skew


def _descendants() -> Tensor:
    """(24, 24) 1 where the column's joint is the row's joint or hangs from it."""
    below = torch.eye(len(PARENTS))
    for level in reversed(LEVELS[1:]):
        for joint in level:
            below[PARENTS[joint]] += below[joint]
    return below


_BELOW = _descendants()


@dataclass(frozen=True)
class Levers:
    """What turns a posed body's joint angles into motions of points.

    Attributes:
        rotations: (T, 24, 3, 3) global rotations.
        positions: (T, 24, 3) metres.
        offsets: (T, 24, 3) joint j carries a rest point v to R_j v + offset_j.
        spins: (T, 24, 3, 3) angular velocity in the body's frame for each rate of theta.
        shape_steps: (T, 24, 3, 10) how the offsets move with betas.
    """

    rotations: Tensor
    positions: Tensor
    offsets: Tensor
    spins: Tensor
    shape_steps: Tensor


def levers(theta: Tensor, rotations: Tensor, positions: Tensor, rest_joints: Tensor, directions: Tensor) -> Levers:
    """Prepare the Jacobians of one person's clip.

    Args:
        theta: (T, 24, 3) radians.
        rotations: (T, 24, 3, 3) from `pose_joints`.
        positions: (T, 24, 3) metres, from `pose_joints`.
        rest_joints: (24, 3) metres.
        directions: (24, 3, 10) how the rest joints move with betas.
    """
    offsets = positions - (rotations @ rest_joints[..., None])[..., 0]
    parents = torch.cat([torch.eye(3).to(rotations).expand(len(theta), 1, 3, 3), rotations[:, list(PARENTS[1:])]], 1)
    spins = parents @ _left_jacobian(theta)
    bones = directions.clone()
    bones[1:] -= directions[list(PARENTS[1:])]
    # A joint's place is the sum of the turned bones above it.
    turned = parents @ bones
    placed = torch.einsum("kj,tkab->tjab", _BELOW.to(rotations), turned)
    return Levers(rotations, positions, offsets, spins, placed - rotations @ directions)


def point_jacobian(lever: Levers, rest: Tensor, weights: Tensor) -> Tensor:
    """Derivative of skinned points with respect to theta.

    Args:
        lever: of the clip.
        rest: (P, 3) or (T, P, 3) rest points, metres.
        weights: (P, 24) or (T, P, 24).

    Returns:
        (T, P, 3, 72) metres per radian.
    """
    turned = (
        torch.einsum("tjab,...pb->tpaj", lever.rotations, rest)
        if rest.dim() == 2
        else torch.einsum("tjab,tpb->tpaj", lever.rotations, rest)
    )
    carried = (turned + lever.offsets.transpose(1, 2)[:, None]) * weights[..., None, :]
    below = _BELOW.to(carried)
    reach = carried @ below.T - (weights @ below.T)[..., None, :] * lever.positions.transpose(1, 2)[:, None]
    # A spin of joint k about the axis m moves the point by m x reach_k.
    arm = reach.transpose(-1, -2)[:, :, :, None, :]
    axes = lever.spins.transpose(-1, -2)[:, None]
    moved = torch.linalg.cross(axes.expand(-1, arm.shape[1], -1, -1, -1), arm.expand(-1, -1, -1, 3, -1))
    return moved.flatten(2, 3).transpose(-1, -2)


def shape_jacobian(lever: Levers, directions: Tensor, weights: Tensor) -> Tensor:
    """Derivative of skinned points with respect to betas.

    Args:
        lever: of the clip.
        directions: (P, 3, 10) or (T, P, 3, 10) how the rest points move, metres.
        weights: (P, 24) or (T, P, 24).

    Returns:
        (T, P, 3, 10) metres per unit of beta.
    """
    frames = len(lever.rotations)
    weights = weights.expand(frames, -1, -1)
    blended = (weights @ lever.rotations.flatten(2)).unflatten(-1, (3, 3))
    return blended @ directions + (weights @ lever.shape_steps.flatten(2)).unflatten(-1, (3, 10))


def _left_jacobian(rotvec: Tensor) -> Tensor:
    """(..., 3, 3) turning rates of axis-angle numbers into angular velocity in the parent's frame."""
    angle = torch.sqrt((rotvec * rotvec).sum(-1) + 1e-12)[..., None, None]
    K = skew(rotvec)
    first = 2 * (torch.sin(angle / 2) / angle) ** 2
    # (x - sin x) / x^3 loses all digits near zero; its series does not.
    series = 1 / 6 - angle**2 / 120 + angle**4 / 5040
    second = torch.where(angle < 0.3, series, (angle - torch.sin(angle)) / angle**3)
    return torch.eye(3, dtype=rotvec.dtype, device=rotvec.device) + first * K + second * (K @ K)
