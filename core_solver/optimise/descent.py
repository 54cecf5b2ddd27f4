"""First-order descent shared by the pose fit and the stages."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor


def descend(
    variables: Sequence[tuple[Tensor, float]],
    energy: Callable[[int], Tensor],
    iterations: int,
    advance: Callable[[int], None] = lambda _steps: None,
) -> float:
    """Minimise by Adam with step sizes that fall to a hundredth along half a cosine.

    Args:
        variables: leaf tensors with their first step size, changed in place.
        energy: iteration number to scalar energy.
        iterations: how many steps.
        advance: told after each step.

    Returns:
        The last energy.
    """
    groups = [{"params": [tensor.requires_grad_()], "lr": rate} for tensor, rate in variables]
    optimiser = torch.optim.Adam(groups, betas=(0.9, 0.95))
    schedule = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda step: 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * min(step / iterations, 1)))
    )
    value = math.nan
    for iteration in range(iterations):
        optimiser.zero_grad(set_to_none=True)
        total = energy(iteration)
        total.backward()
        # A frame whose evidence contradicts itself must not poison the clip: its gradient is dropped, not spread.
        for tensor, _ in variables:
            if tensor.grad is not None:
                torch.nan_to_num_(tensor.grad, nan=0.0, posinf=0.0, neginf=0.0)
        optimiser.step()
        schedule.step()
        value = float(total.detach())
        advance(1)
    for tensor, _ in variables:
        tensor.requires_grad_(False)
    return value
