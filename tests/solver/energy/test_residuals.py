import ast
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

import core_solver
from core_solver.energy.kernels import charbonnier
from core_solver.energy.residuals import saturated, softened

ANY_SIZE = st.floats(-1e6, 1e6)


@given(ANY_SIZE)
def test_softened_squares_are_the_kernel_of_squares(residual: float) -> None:
    value = softened(np.array([residual]))
    expected = charbonnier(torch.tensor([residual**2], dtype=torch.float64)).numpy()
    np.testing.assert_allclose(value**2, expected, rtol=1e-9, atol=1e-12)
    assert value * residual >= 0


def test_small_residuals_stay_and_large_ones_are_held_back() -> None:
    np.testing.assert_allclose(softened(np.array([-1e-3, 0, 1e-3])), [-1e-3, 0, 1e-3], rtol=1e-5)
    np.testing.assert_allclose(softened(np.array([-1e6, 1e6])) ** 2, 2e6, rtol=1e-5)
    np.testing.assert_allclose(saturated(np.array([-1e-3, 0, 1e-3]), 4), [-1e-3, 0, 1e-3], rtol=1e-6)
    np.testing.assert_allclose(saturated(np.array([-1e6, 1e6]), 4), [-4, 4])


@given(ANY_SIZE, ANY_SIZE, st.floats(0.5, 20))
def test_saturated_residuals_keep_their_order_below_the_limit(a: float, b: float, limit: float) -> None:
    low, high = saturated(np.array(sorted((a, b))), limit)
    assert -limit <= low <= high <= limit


@pytest.mark.parametrize("name", ["softened", "saturated"])
def test_there_is_one_of_each(name: str) -> None:
    homes = [
        path.name
        for path in Path(core_solver.__file__).parent.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef) and node.name.lstrip("_") == name
    ]
    assert homes == ["residuals.py"]
