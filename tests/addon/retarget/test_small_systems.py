"""Systems of equations against numpy's own solver."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


@settings(max_examples=50, deadline=None)
@given(frames=st.integers(0, 5), size=st.integers(1, 12), seed=st.integers(0, 10_000))
def test_solutions_are_numpys(addon: Any, frames: int, size: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    half = rng.normal(size=(frames, size, size))
    matrices = half @ np.swapaxes(half, 1, 2) + 0.1 * np.eye(size)
    right = rng.normal(size=(frames, size))
    given_matrices, given_right = matrices.copy(), right.copy()
    found = addon("retarget.small_systems").solve_positive(matrices, right)
    np.testing.assert_allclose(found, np.linalg.solve(matrices, right[..., None])[..., 0], rtol=1e-6, atol=1e-8)
    np.testing.assert_array_equal(matrices, given_matrices)
    np.testing.assert_array_equal(right, given_right)


def test_a_stiff_unknown_does_not_spoil_the_others(addon: Any) -> None:
    """As where a change is held on its bound."""
    matrices = np.array([[[2.0, 0.5, 0.0], [0.5, 3.0, 0.2], [0.0, 0.2, 1.0]]])
    matrices[:, 1, 1] += 1e9
    found = addon("retarget.small_systems").solve_positive(matrices, np.array([[1.0, 0.5e9, 1.0]]))[0]
    assert found[1] == pytest.approx(0.5, rel=1e-7)
    assert found[0] == pytest.approx((1 - 0.25) / 2, rel=1e-7)
    assert found[2] == pytest.approx(1 - 0.1, rel=1e-7)
