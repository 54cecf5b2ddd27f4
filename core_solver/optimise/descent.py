"""First-order descent shared by the pose fit and the stages."""

import math
from collections.abc import Callable, Sequence

import torch
from torch import Tensor
from torch.optim.adam import adam


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
    # The function behind torch.optim.Adam: the class would first import a compiler, which takes seconds.
    leaves = [tensor.requires_grad_() for tensor, _ in variables]
    first, second = [torch.zeros_like(x) for x in leaves], [torch.zeros_like(x) for x in leaves]
    steps = [torch.zeros(()) for _ in leaves]
    value = math.nan
    for iteration in range(iterations):
        total = energy(iteration)
        gradients = torch.autograd.grad(total, leaves, materialize_grads=True)
        fall = 0.01 + 0.99 * 0.5 * (1 + math.cos(math.pi * iteration / iterations))
        for i, (tensor, rate) in enumerate(variables):
            # A frame whose evidence contradicts itself must not poison the clip: its gradient is dropped, not spread.
            gradient = torch.nan_to_num(gradients[i], nan=0.0, posinf=0.0, neginf=0.0)
            with torch.no_grad():
                adam([tensor], [gradient], [first[i]], [second[i]], [], [steps[i]], amsgrad=False, beta1=0.9,
                     beta2=0.95, lr=rate * fall, weight_decay=0, eps=1e-8, maximize=False)  # fmt: skip
        value = float(total.detach())
        advance(1)
    for tensor, _ in variables:
        tensor.requires_grad_(False)
    return value
