"""Similarity fits: they give back what made the data, and nothing mirrored."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from core_solver.geometry import Similarity, fit_similarity, matrix_from_rotvec
from tests.solver.geometry.strategies import ROTVECS, VECTORS

SEEDS = st.integers(0, 10_000)


def cloud(seed: int, count: int = 12) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 3))


def test_apply_scales_turns_and_shifts_points_of_any_leading_axes() -> None:
    motion = Similarity(matrix_from_rotvec([0, 0, np.pi / 2]), np.array([1.0, 2.0, 3.0]), 2.0)
    np.testing.assert_allclose(motion.apply([1.0, 0, 0]), [1, 4, 3], atol=1e-14)
    assert motion.apply(np.zeros((4, 5, 3))).shape == (4, 5, 3)


@given(SEEDS, ROTVECS, VECTORS, st.floats(0.05, 20))
def test_fit_gives_back_the_motion_and_scale(seed: int, rotvec: np.ndarray, shift: np.ndarray, scale: float) -> None:
    truth = Similarity(matrix_from_rotvec(rotvec), shift, scale)
    source = cloud(seed)
    fit = fit_similarity(source, truth.apply(source), with_scale=True)
    np.testing.assert_allclose(fit.rotation, truth.rotation, atol=1e-9)
    np.testing.assert_allclose(fit.translation, truth.translation, atol=1e-9)
    assert fit.scale == pytest.approx(scale, rel=1e-9)


@given(SEEDS, ROTVECS, VECTORS, st.floats(0.05, 20))
def test_fit_without_scale_is_rigid_whatever_the_sizes(
    seed: int, rotvec: np.ndarray, shift: np.ndarray, scale: float
) -> None:
    source = cloud(seed)
    target = Similarity(matrix_from_rotvec(rotvec), shift, scale).apply(source)
    fit = fit_similarity(source, target)
    assert fit.scale == 1.0
    np.testing.assert_allclose(fit.rotation, matrix_from_rotvec(rotvec), atol=1e-9)
    np.testing.assert_allclose(fit.apply(source.mean(axis=0)), target.mean(axis=0), atol=1e-9)


@given(SEEDS, st.booleans())
def test_a_mirrored_cloud_is_never_met_by_a_reflection(seed: int, with_scale: bool) -> None:
    source = cloud(seed)
    target = source * [1, 1, -1]
    fit = fit_similarity(source, target, with_scale=with_scale)
    assert np.linalg.det(fit.rotation) == pytest.approx(1, abs=1e-9)
    assert fit.scale > 0
    # Least squares: no turn nearby does better.
    best = np.sum((fit.apply(source) - target) ** 2)
    for step in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
        turned = Similarity(matrix_from_rotvec(step) @ fit.rotation, fit.translation, fit.scale)
        middle = target.mean(axis=0) - turned.apply(source).mean(axis=0)
        assert np.sum((turned.apply(source) + middle - target) ** 2) >= best - 1e-12
    # Nor does any scale.
    for factor in (0.999, 1.001) if with_scale else ():
        sized = Similarity(fit.rotation, np.zeros(3), factor * fit.scale)
        middle = target.mean(axis=0) - sized.apply(source).mean(axis=0)
        assert np.sum((sized.apply(source) + middle - target) ** 2) >= best - 1e-12


@given(SEEDS, ROTVECS)
def test_points_of_weight_zero_count_for_nothing(seed: int, rotvec: np.ndarray) -> None:
    source = cloud(seed)
    target = source @ matrix_from_rotvec(rotvec).T
    weights = np.ones(len(source))
    target[:3], weights[:3] = 100.0, 0.0
    fit = fit_similarity(source, target, weights, with_scale=True)
    np.testing.assert_allclose(fit.rotation, matrix_from_rotvec(rotvec), atol=1e-9)
    assert fit.scale == pytest.approx(1, rel=1e-9)


@given(SEEDS)
def test_an_integer_weight_is_as_many_copies_of_the_point(seed: int) -> None:
    source, target = cloud(seed), cloud(seed + 1)
    counts = np.random.default_rng(seed).integers(1, 4, len(source))
    weighted = fit_similarity(source, target, counts, with_scale=True)
    repeated = fit_similarity(np.repeat(source, counts, 0), np.repeat(target, counts, 0), with_scale=True)
    np.testing.assert_allclose(weighted.rotation, repeated.rotation, atol=1e-9)
    np.testing.assert_allclose(weighted.translation, repeated.translation, atol=1e-9)
    assert weighted.scale == pytest.approx(repeated.scale, rel=1e-9)


@given(VECTORS, VECTORS, st.integers(1, 7), st.booleans())
def test_one_place_is_only_shifted(a: np.ndarray, b: np.ndarray, count: int, with_scale: bool) -> None:
    source, target = np.tile(a, (count, 1)), np.tile(b, (count, 1))
    fit = fit_similarity(source, target, with_scale=with_scale)
    np.testing.assert_allclose(fit.apply(a), b, atol=1e-12)
    assert fit.scale == 1.0
    assert np.linalg.det(fit.rotation) == pytest.approx(1)


@given(ROTVECS, VECTORS, st.floats(0.1, 10))
def test_points_on_a_line_are_met_by_a_proper_rotation(rotvec: np.ndarray, shift: np.ndarray, scale: float) -> None:
    source = np.outer([-1.0, 0.5, 2.0, 4.0], [1.0, -2.0, 0.5])
    target = Similarity(matrix_from_rotvec(rotvec), shift, scale).apply(source)
    fit = fit_similarity(source, target, with_scale=True)
    np.testing.assert_allclose(fit.apply(source), target, atol=1e-8)
    assert fit.scale == pytest.approx(scale, rel=1e-9)
    assert np.linalg.det(fit.rotation) == pytest.approx(1, abs=1e-9)


def test_noise_leaves_the_fit_near_scipys() -> None:
    rng = np.random.default_rng(3)
    source, weights = cloud(4, 40), rng.uniform(0.1, 2, 40)
    target = source @ matrix_from_rotvec([0.3, -1, 2]).T + rng.normal(scale=0.05, size=source.shape)
    centred = [p - np.average(p, axis=0, weights=weights) for p in (target, source)]
    truth = Rotation.align_vectors(*centred, weights=weights)[0]
    np.testing.assert_allclose(fit_similarity(source, target, weights).rotation, truth.as_matrix(), atol=1e-9)
