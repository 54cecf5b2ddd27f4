"""Rotations as keyed numbers, against Blender's own conversions."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.geometry import matrix_from_rotvec

MODES = ("QUATERNION", "AXIS_ANGLE", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


@pytest.mark.parametrize("mode", MODES)
def test_blender_makes_the_same_of_the_numbers(bpy: Any, addon: Any, mode: str) -> None:
    from mathutils import Euler, Matrix, Quaternion

    module = addon("retarget.rotation_modes")
    values = np.random.default_rng(0).normal(size=(20, 3 if mode in MODES[2:] else 4)) * 2
    for row, matrix in zip(values, module.matrices_from_channels(values, mode), strict=True):
        if mode == "QUATERNION":
            truth = Quaternion(row).normalized().to_matrix()
        elif mode == "AXIS_ANGLE":
            truth = Matrix.Rotation(row[0], 3, row[1:])
        else:
            truth = Euler(row, mode).to_matrix()
        np.testing.assert_allclose(matrix, truth, atol=1e-5)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 10**6), mode=st.sampled_from(MODES), quarters=st.booleans())
def test_numbers_and_matrices_are_inverse(addon: Any, seed: int, mode: str, quarters: bool) -> None:
    module = addon("retarget.rotation_modes")
    rng = np.random.default_rng(seed)
    # Quarter turns meet the places where Euler angles are ambiguous.
    angles = rng.integers(-2, 3, (6, 3, 3)) * np.pi / 2 if quarters else rng.normal(size=(6, 3, 3)) * 2
    matrices = matrix_from_rotvec(angles * [1, 0, 0]) @ matrix_from_rotvec(angles * [0, 1, 0])
    matrices = matrices @ matrix_from_rotvec(angles * [0, 0, 1])
    again = module.matrices_from_channels(module.channels_from_matrices(matrices, mode), mode)
    np.testing.assert_allclose(again, matrices, atol=1e-6)


@pytest.mark.parametrize("mode", MODES)
def test_a_steady_turn_gives_curves_without_jumps(addon: Any, mode: str) -> None:
    module = addon("retarget.rotation_modes")
    angle = np.linspace(-2, 14, 400)
    axes = matrix_from_rotvec([0.3, 0.2, -0.1])
    for axis in np.eye(3):
        matrices = axes @ matrix_from_rotvec(angle[:, None, None] * axis)
        values = module.channels_from_matrices(matrices, mode)
        # Steps grow where Euler angles are near their singular pose; a jump would be one of at least half a turn.
        assert np.abs(np.diff(values, axis=0)).max() < 1.0


def test_an_axis_does_not_flip_where_the_angle_passes_zero(addon: Any) -> None:
    module = addon("retarget.rotation_modes")
    angle = np.linspace(-0.5, 0.5, 21)
    matrices = matrix_from_rotvec(angle[:, None, None] * np.array([0.6, 0.0, 0.8]))
    values = module.channels_from_matrices(matrices, "AXIS_ANGLE")[:, 0]
    assert np.ptp(values[:, 1:], axis=0).max() < 1e-6
    np.testing.assert_allclose(np.abs(np.diff(values[:, 0])), 0.05, atol=1e-6)


def test_no_length_is_no_rotation(addon: Any) -> None:
    module = addon("retarget.rotation_modes")
    for mode in MODES[:2]:
        np.testing.assert_array_equal(module.matrices_from_channels(np.zeros(4), mode), np.eye(3))
