"""Measures of real truth: single joints may be unknown, and people are told apart in the image."""

import numpy as np
import pytest

from core_solver.evaluation import alignment, metrics, motion
from tests.solver.evaluation.strategies import crowd, everywhere


def holes(true: np.ndarray, share=0.3) -> np.ndarray:
    """The truth with single joints unknown."""
    gone = np.random.default_rng(3).uniform(size=true.shape[:3]) < share
    return np.where(gone[..., None], np.nan, true)


def test_errors_of_gaussian_noise_are_their_closed_form():
    true = crowd(people=4, frames=500, joints=12)
    noise = np.random.default_rng(1).normal(size=true.shape) * 0.05
    errors = metrics.known_errors(true + noise, holes(true), everywhere(true))
    assert errors.mean() == pytest.approx(0.05 * np.sqrt(8 / np.pi), rel=0.01)
    assert len(errors) == np.isfinite(holes(true)).all(axis=-1).sum()


def test_unknown_joints_are_left_out_one_by_one():
    true = crowd(people=1, frames=2, joints=3)
    predicted = true.copy()
    predicted[0, 0, 0] += (0.3, 0.4, 0)
    predicted[0, 1, 2] += (9, 0, 0)
    partly = true.copy()
    partly[0, 1, 2] = np.nan
    assert sorted(metrics.known_errors(predicted, partly, everywhere(true))) == pytest.approx([0, 0, 0, 0, 0.5])


def test_procrustes_aligns_what_is_known_and_never_mirrors():
    true = crowd(people=2, frames=6, joints=12)
    partly, seen = holes(true), everywhere(true)
    turned = 1.3 * true @ np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]]) + (1, 2, 3)
    assert metrics.pa_mpjpe(turned, partly, seen) == pytest.approx(0, abs=1e-6)
    assert metrics.pa_mpjpe(true * (-1, 1, 1), partly, seen) > 50


def test_two_joints_fix_no_alignment():
    true = crowd(people=1, frames=1, joints=4)
    partly = true.copy()
    partly[0, 0, 2:] = np.nan
    assert metrics.pa_mpjpe(true, partly, everywhere(true)) is None


@pytest.mark.parametrize("measure", [alignment.w_mpjpe, alignment.wa_mpjpe, alignment.group_w])
def test_a_wrong_scale_shows_without_scale_and_vanishes_with_it_when_joints_are_unknown(measure):
    true = crowd(people=3, frames=30, joints=12)
    seen = everywhere(true)
    assert measure(1.3 * true, holes(true), seen, with_scale=False) > 50
    assert measure(1.3 * true, holes(true), seen, with_scale=True) == pytest.approx(0, abs=1e-6)


def test_steps_over_an_unknown_joint_do_not_count():
    true = np.zeros((1, 4, 2, 3))
    predicted = true.copy()
    predicted[0, 2, 0] = (9, 0, 0)  # one joint jumps there and back
    partly = true.copy()
    partly[0, 2, 0] = np.nan
    assert motion.jitter_paper(predicted, partly, everywhere(true)) == 0
    assert motion.jitter_wham(partly, everywhere(true), 30) == 0  # the other joint's
    assert motion.jitter_paper(predicted, true, everywhere(true)) == pytest.approx(1000 * (9 + 9) / 6)


def test_the_error_of_a_distance_by_hand():
    true = np.array([[[0.0, 0, 5]], [[3, 0, 5]], [[0, 4, 5]]])  # 3, 4 and 5 m apart
    predicted = np.array([[[0.0, 0, 5]], [[3.3, 0, 5]], [[0, 4, 5]]])
    expected = 1000 * (0.3 + 0 + np.hypot(3.3, 4) - 5) / 3
    assert metrics.pair_distance(predicted, true, everywhere(true)) == pytest.approx(expected)


def test_a_distance_is_blind_to_where_the_pair_is_and_sees_scale():
    true = crowd(people=3, frames=4, joints=1)[:, :, 0]
    seen = everywhere(true)
    assert metrics.pair_distance(true + 5, true, seen) == pytest.approx(0, abs=1e-9)
    assert metrics.pair_distance(1.3 * true, true, seen) > 300
    assert metrics.pair_distance(true[:1], true[:1], seen[:1]) is None


# --- who is who ---


def pixels(*tracks) -> np.ndarray:
    """(N, T, 2) of people who stand still."""
    return np.repeat(np.array(tracks, float)[:, None], 5, axis=1)


def test_permuted_people_are_put_in_order():
    true = pixels((100, 0), (200, 0), (300, 0))
    predicted = pixels((305, 0), (95, 0), (205, 0))
    matches = metrics.match_in_picture(predicted, true, everywhere(predicted), everywhere(true), 50)
    np.testing.assert_array_equal(matches, [1, 2, 0])


def test_missing_people_are_matched_to_nobody():
    true = pixels((100, 0), (200, 0))
    predicted = pixels((201, 0))
    matches = metrics.match_in_picture(predicted, true, everywhere(predicted), everywhere(true), 50)
    np.testing.assert_array_equal(matches, [-1, 0])
    nobody = metrics.match_in_picture(predicted[:0], true, everywhere(predicted[:0]), everywhere(true), 50)
    np.testing.assert_array_equal(nobody, [-1, -1])


def test_somebody_far_away_never_keeps_another_from_being_matched():
    true = pixels((0, 0), (49, 0))
    predicted = pixels((48, 0), (1000, 0))  # together cheaper if the far one could be had
    matches = metrics.match_in_picture(predicted, true, everywhere(predicted), everywhere(true), 50)
    np.testing.assert_array_equal(matches, [-1, 0])


def test_the_whole_clip_decides_and_only_common_frames():
    true, predicted = pixels((100, 0), (200, 0)), pixels((100, 0), (200, 0))
    predicted[:, 2] = predicted[::-1, 2]  # swapped for a moment
    seen = everywhere(true)
    np.testing.assert_array_equal(metrics.match_in_picture(predicted, true, seen, seen, 50), [0, 1])
    early, late = seen.copy(), seen.copy()
    early[:, 2:], late[:, :2] = False, False
    np.testing.assert_array_equal(metrics.match_in_picture(predicted, true, early, late, 50), [-1, -1])
