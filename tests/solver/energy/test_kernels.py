import math

import pytest
import torch

from core_solver.energy.kernels import charbonnier, geman_mcclure

KERNELS = (charbonnier, geman_mcclure)


@pytest.mark.parametrize("kernel", KERNELS)
def test_small_residuals_count_squared(kernel):
    squared = torch.tensor([0.0, 1e-6, 1e-4], dtype=torch.float64)
    torch.testing.assert_close(kernel(squared), squared, rtol=1e-3, atol=0)


def test_large_residuals_count_linearly_or_level_off():
    squared = torch.tensor([1e8], dtype=torch.float64)
    assert charbonnier(squared).item() == pytest.approx(2 * (1e4 - 1), rel=1e-6)
    assert geman_mcclure(squared).item() == pytest.approx(1, rel=1e-6)
    assert charbonnier(torch.tensor([3.0])).item() == pytest.approx(2 * (math.sqrt(4) - 1))
    assert geman_mcclure(torch.tensor([3.0])).item() == pytest.approx(0.75)


@pytest.mark.parametrize(("kernel", "most"), [(charbonnier, 2.0), (geman_mcclure, 0.66)])
def test_the_pull_of_any_residual_is_bounded(kernel, most):
    residual = torch.logspace(-6, 6, 200, dtype=torch.float64, requires_grad=True)
    kernel(residual**2).sum().backward()
    assert residual.grad is not None
    assert (residual.grad >= 0).all()
    assert residual.grad.max().item() <= most


@pytest.mark.parametrize("kernel", KERNELS)
def test_gradients_are_finite_at_zero_and_true(kernel):
    squared = torch.tensor([0.0, 0.3, 7.0], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(kernel, (squared,))
