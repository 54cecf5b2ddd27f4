"""Torch twins of the numpy geometry, differentiable, on any device."""

import torch
from torch import Tensor


def skew(vectors: Tensor) -> Tensor:
    """Cross-product matrices (..., 3, 3) of (..., 3) vectors."""
    x, y, z = vectors.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*x.shape, 3, 3)


def matrix_from_rotvec(rotvec: Tensor) -> Tensor:
    """Rodrigues' formula with finite gradients at zero.

    Args:
        rotvec: (..., 3) radians.

    Returns:
        (..., 3, 3).
    """
    # sqrt has no gradient at zero: a floor far below rounding keeps it finite without changing the value.
    angle = torch.sqrt((rotvec * rotvec).sum(-1) + 1e-16)[..., None, None]
    K = skew(rotvec)
    first = torch.sin(angle) / angle
    second = 0.5 * (torch.sin(angle / 2) / (angle / 2)) ** 2
    identity = torch.eye(3, dtype=rotvec.dtype, device=rotvec.device)
    return identity + first * K + second * (K @ K)
