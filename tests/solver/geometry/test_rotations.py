"""Rotations against scipy's, and at the angles where formulas lose their digits."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core_solver.geometry import (
    align_vectors,
    matrix_from_rotvec,
    quaternion_from_matrix,
    quaternion_from_rotvec,
    rotvec_from_matrix,
)
from core_solver.geometry.rotations import skew
from tests.solver.geometry.strategies import ANGLES, DIRECTIONS, ROTVECS, VECTORS

ROUNDING = 1e-14


def assert_rotation(matrix: np.ndarray) -> None:
    np.testing.assert_allclose(
        matrix @ np.swapaxes(matrix, -1, -2), np.broadcast_to(np.eye(3), matrix.shape), atol=1e-13
    )
    np.testing.assert_allclose(np.linalg.det(matrix), 1, atol=1e-13)


def same_turn(a: np.ndarray, b: np.ndarray) -> float:
    """Largest difference of two unit quaternions, q and -q being one rotation."""
    return min(np.abs(a - b).max(), np.abs(a + b).max())


def scipy_wxyz(rotvec: np.ndarray) -> np.ndarray:
    return np.roll(Rotation.from_rotvec(rotvec).as_quat(), 1, axis=-1)


@given(VECTORS, VECTORS)
def test_skew_is_the_cross_product(a: np.ndarray, b: np.ndarray) -> None:
    np.testing.assert_allclose(skew(a) @ b, np.cross(a, b), atol=1e-12)


@given(st.one_of(ROTVECS, VECTORS))
def test_matrix_agrees_with_scipy(rotvec: np.ndarray) -> None:
    matrix = matrix_from_rotvec(rotvec)
    np.testing.assert_allclose(matrix, Rotation.from_rotvec(rotvec).as_matrix(), atol=4 * ROUNDING)
    assert_rotation(matrix)


def test_matrix_of_hand_made_turns() -> None:
    half = math.pi / 2
    # A positive quarter turn about z carries x to y; half a turn about x flips y and z.
    np.testing.assert_allclose(matrix_from_rotvec([0, 0, half]) @ [1, 0, 0], [0, 1, 0], atol=ROUNDING)
    np.testing.assert_allclose(matrix_from_rotvec([math.pi, 0, 0]), np.diag([1, -1, -1]), atol=ROUNDING)
    np.testing.assert_array_equal(matrix_from_rotvec([0, 0, 0]), np.eye(3))


@pytest.mark.parametrize("angle", [1e-5, 1e-8, 1e-12, 1e-100])
def test_tiny_turns_keep_every_digit(angle: float) -> None:
    matrix = matrix_from_rotvec([angle, 0, 0])
    assert matrix[2, 1] == pytest.approx(angle, rel=1e-9)
    assert rotvec_from_matrix(matrix)[0] == pytest.approx(angle, rel=1e-9)


@given(ROTVECS)
def test_quaternions_agree_with_scipy_and_each_other(rotvec: np.ndarray) -> None:
    direct, by_matrix = quaternion_from_rotvec(rotvec), quaternion_from_matrix(matrix_from_rotvec(rotvec))
    assert same_turn(direct, scipy_wxyz(rotvec)) < 4 * ROUNDING
    assert same_turn(by_matrix, direct) < 1e-12
    assert by_matrix[0] >= 0
    assert np.linalg.norm(by_matrix) == pytest.approx(1, abs=ROUNDING)


@pytest.mark.parametrize("largest", range(4))
def test_quaternion_from_matrix_takes_each_of_its_four_ways(largest: int) -> None:
    truth = np.full(4, 0.1)
    truth[largest] = 1.0
    truth /= np.linalg.norm(truth)
    matrix = Rotation.from_quat(np.roll(truth, -1)).as_matrix()
    assert same_turn(quaternion_from_matrix(matrix), truth) < ROUNDING


@given(ROTVECS)
def test_rotation_vector_survives_a_round_trip(rotvec: np.ndarray) -> None:
    matrix = matrix_from_rotvec(rotvec)
    back = rotvec_from_matrix(matrix)
    assert np.linalg.norm(back) <= math.pi + ROUNDING
    np.testing.assert_allclose(matrix_from_rotvec(back), matrix, atol=1e-13)
    if np.linalg.norm(rotvec) < math.pi - 1e-4:  # at half a turn both axes are right
        np.testing.assert_allclose(back, rotvec, atol=1e-12)


def test_half_turns_about_any_axis_come_back() -> None:
    axes = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(50, 3))).apply([0, 0, 1.0])
    matrices = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    back = rotvec_from_matrix(matrices)
    np.testing.assert_allclose(np.linalg.norm(back, axis=-1), math.pi, atol=1e-12)
    np.testing.assert_allclose(np.abs(np.sum(back * axes, axis=-1)), math.pi, atol=1e-12)


def test_every_function_takes_any_number_of_leading_axes() -> None:
    rotvecs = np.random.default_rng(2).uniform(-1, 1, (2, 3, 3))
    matrices = matrix_from_rotvec(rotvecs)
    assert matrices.shape == (2, 3, 3, 3)
    assert quaternion_from_matrix(matrices).shape == quaternion_from_rotvec(rotvecs).shape == (2, 3, 4)
    for i in range(2):
        for j in range(3):
            np.testing.assert_array_equal(matrices[i, j], matrix_from_rotvec(rotvecs[i, j]))
            np.testing.assert_allclose(rotvec_from_matrix(matrices)[i, j], rotvecs[i, j], atol=1e-12)
    assert matrix_from_rotvec(np.zeros((0, 3))).shape == (0, 3, 3)
    assert rotvec_from_matrix(np.zeros((0, 3, 3))).shape == (0, 3)


@given(DIRECTIONS, DIRECTIONS, st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_align_vectors_turns_one_direction_into_the_other_by_the_smallest_turn(
    a: np.ndarray, b: np.ndarray, length_a: float, length_b: float
) -> None:
    assume(np.linalg.norm(a + b) > 1e-3)  # the nearly opposite ones have tests of their own
    matrix = align_vectors(length_a * a, length_b * b)
    assert_rotation(matrix)
    np.testing.assert_allclose(matrix @ a, b, atol=1e-12)
    angle_between = 2 * math.atan2(np.linalg.norm(a - b), np.linalg.norm(a + b))
    assert np.linalg.norm(rotvec_from_matrix(matrix)) == pytest.approx(angle_between, abs=1e-7)


@given(DIRECTIONS, DIRECTIONS, ANGLES)
def test_align_vectors_is_exact_for_nearly_equal_and_nearly_opposite_directions(
    a: np.ndarray, other: np.ndarray, angle: float
) -> None:
    across = np.cross(a, other)
    if np.linalg.norm(across) < 1e-3:
        return
    b = matrix_from_rotvec(across / np.linalg.norm(across) * angle) @ a
    matrix = align_vectors(a, b)
    assert_rotation(matrix)
    np.testing.assert_allclose(matrix @ a, b, atol=2e-8)


@given(DIRECTIONS)
def test_align_vectors_of_opposite_directions_is_half_a_turn(a: np.ndarray) -> None:
    matrix = align_vectors(a, -2 * a)
    assert_rotation(matrix)
    np.testing.assert_allclose(matrix @ a, -a, atol=1e-12)
    assert np.trace(matrix) == pytest.approx(-1, abs=1e-12)


def test_align_vectors_spreads_one_source_over_many_targets() -> None:
    targets = np.array([[0, 1.0, 0], [0, 0, 1.0], [-1.0, 0, 0], [1.0, 0, 0]])
    matrices = align_vectors([1.0, 0, 0], targets)
    np.testing.assert_allclose(matrices @ [1.0, 0, 0], targets, atol=ROUNDING)
