import numpy as np
import pytest

from core_solver.evaluation.mupots import PARENTS, PELVIS, Mode, match_in_image, official_hits, rescale_bones


def skeletons(count=3, seed=0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 17, 3)) * 0.4 + (0, 0, 4)


def lengths(points) -> np.ndarray:
    children = [j for j, parent in enumerate(PARENTS) if parent >= 0]
    return np.linalg.norm(points[..., children, :] - points[..., [PARENTS[j] for j in children], :], axis=-1)


def test_bones_take_the_true_length_and_keep_their_direction():
    true, predicted = skeletons(), skeletons(seed=1)
    rescaled = rescale_bones(predicted, true)
    np.testing.assert_allclose(lengths(rescaled), lengths(true))
    np.testing.assert_allclose(rescaled[:, PELVIS], predicted[:, PELVIS])
    before, after = (points[:, 3] - points[:, 2] for points in (predicted, rescaled))
    np.testing.assert_allclose(np.cross(before, after), 0, atol=1e-12)
    assert (np.sum(before * after, axis=-1) > 0).all()


def test_a_wrong_size_costs_nothing_here():
    true = skeletons()
    matches = np.arange(3)
    assert official_hits(1.5 * true, true, matches, Mode.ALL).all()


def test_a_joint_turned_away_is_missed():
    true = skeletons(1)
    predicted = true.copy()
    predicted[0, 4] = 2 * true[0, 3] - true[0, 4]  # the right wrist on the other side of its elbow
    hits = official_hits(predicted, true, np.array([0]), Mode.ALL)
    assert not hits[0, 4]
    assert hits.sum() == 13


def test_unmatched_people_count_in_one_mode_only():
    true = skeletons(2)
    matches = np.array([-1, 0])
    assert official_hits(true[1:], true, matches, Mode.ALL).mean() == pytest.approx(0.5)
    assert official_hits(true[1:], true, matches, Mode.MATCHED).mean() == 1
    assert official_hits(true[:0], true, np.array([-1, -1]), Mode.ALL).mean() == 0


def test_matching_is_by_joints_in_the_image():
    true = np.random.default_rng(0).uniform(0, 500, (2, 17, 2)) + np.array([0, 1000])[:, None, None]
    seen = np.ones((2, 17), bool)
    np.testing.assert_array_equal(match_in_image(true, seen, true[::-1] + 39), [1, 0])
    np.testing.assert_array_equal(match_in_image(true, seen, true[::-1] + np.array([41, 0])), [-1, -1])
    np.testing.assert_array_equal(match_in_image(true, ~seen, true), [-1, -1])
    np.testing.assert_array_equal(match_in_image(true, seen, true[:0]), [-1, -1])


def test_matching_is_greedy_in_the_order_of_truth():
    place = np.random.default_rng(0).uniform(0, 500, (1, 17, 2))
    true = np.concatenate([place + 20, place])  # the first person takes what would fit the second better
    np.testing.assert_array_equal(match_in_image(true, np.ones((2, 17), bool), place), [0, -1])
