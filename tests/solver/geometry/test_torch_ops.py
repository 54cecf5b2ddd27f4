"""The torch twin: equal to numpy, with right gradients everywhere, zero included."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver import geometry
from core_solver.geometry import rotations, torch_ops
from tests.solver.geometry.strategies import ROTVECS, VECTORS

NEAR_ZERO = [0.0, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, math.pi, 6.0]


@given(st.one_of(ROTVECS, VECTORS))
def test_matrix_equals_numpys(rotvec: np.ndarray) -> None:
    twin = torch_ops.matrix_from_rotvec(torch.as_tensor(rotvec)).numpy()
    np.testing.assert_allclose(twin, geometry.matrix_from_rotvec(rotvec), atol=1e-14)


@given(ROTVECS)
def test_single_precision_is_good_to_its_own_rounding(rotvec: np.ndarray) -> None:
    twin = torch_ops.matrix_from_rotvec(torch.as_tensor(rotvec, dtype=torch.float32))
    assert twin.dtype == torch.float32
    np.testing.assert_allclose(twin.numpy(), geometry.matrix_from_rotvec(rotvec), atol=1e-6)


@given(VECTORS)
def test_skew_equals_numpys(vector: np.ndarray) -> None:
    np.testing.assert_array_equal(torch_ops.skew(torch.as_tensor(vector)).numpy(), rotations.skew(vector))


@pytest.mark.parametrize("angle", NEAR_ZERO)
def test_gradient_agrees_with_finite_differences(angle: float) -> None:
    rotvec = torch.tensor([[0.6, -0.48, 0.64]], dtype=torch.float64) * angle
    assert torch.autograd.gradcheck(torch_ops.matrix_from_rotvec, rotvec.requires_grad_(), eps=1e-6, atol=1e-7)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradient_at_zero_is_the_generator_of_rotations(dtype: torch.dtype) -> None:
    jacobian = torch.autograd.functional.jacobian(torch_ops.matrix_from_rotvec, torch.zeros(3, dtype=dtype))
    assert isinstance(jacobian, torch.Tensor)
    for axis in range(3):
        np.testing.assert_allclose(jacobian[..., axis].numpy(), rotations.skew(np.eye(3)[axis]), atol=1e-7)


@settings(max_examples=50)
@given(ROTVECS)
def test_single_precision_gradients_are_finite_and_close(rotvec: np.ndarray) -> None:
    exact, rough = (
        torch.autograd.functional.jacobian(torch_ops.matrix_from_rotvec, torch.as_tensor(rotvec, dtype=dtype))
        for dtype in (torch.float64, torch.float32)
    )
    assert isinstance(exact, torch.Tensor)
    assert isinstance(rough, torch.Tensor)
    np.testing.assert_allclose(rough.numpy(), exact.numpy(), atol=1e-5)


def test_a_whole_clip_goes_through_at_once() -> None:
    rotvecs = torch.randn(3, 5, 24, 3, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    matrices = torch_ops.matrix_from_rotvec(rotvecs)
    assert matrices.shape == (3, 5, 24, 3, 3)
    np.testing.assert_allclose(matrices.numpy(), geometry.matrix_from_rotvec(rotvecs.numpy()), atol=1e-14)
