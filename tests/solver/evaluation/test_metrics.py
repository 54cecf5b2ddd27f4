import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.body import JOINT_NAMES
from core_solver.evaluation import metrics
from tests.solver.evaluation.strategies import crowd, everywhere, rigid_motions

ALL = np.ones((1, 1), bool)


def frame(*points) -> np.ndarray:
    """One person in one frame, (1, 1, J, 3)."""
    return np.array(points, float)[None, None]


def roots(*rows) -> np.ndarray:
    """(N, 1, 3)."""
    return np.array(rows, float)[:, None]


# --- roots ---


def test_mrpe_of_two_known_distances():
    true = roots((0, 0, 5), (1, 0, 5))
    predicted = roots((0.3, 0.4, 5), (1, 0, 5.1))
    assert metrics.mrpe(predicted, true, everywhere(true)) == pytest.approx((500 + 100) / 2)


def test_mrpe_of_gaussian_noise_is_its_closed_form():
    true = crowd(people=5, frames=8000, joints=1)[:, :, 0]
    noise = np.random.default_rng(1).normal(size=true.shape) * 0.05
    assert metrics.mrpe(true + noise, true, everywhere(true)) == pytest.approx(2 * 50 * np.sqrt(2 / np.pi), rel=0.01)


def test_only_frames_in_the_mask_count():
    true = np.tile([0.0, 0, 5], (1, 3, 1))
    predicted = true.copy()
    predicted[0, 1] += (9, 0, 0)
    assert metrics.mrpe(predicted, true, np.array([[True, False, True]])) == 0
    assert metrics.mrpe(predicted, true, np.array([[False, True, False]])) == pytest.approx(9000)


@pytest.mark.parametrize("measure", [metrics.mrpe, metrics.ap25_matched, metrics.depth_order])
def test_nobody_to_measure_gives_none(measure):
    true = roots((0, 0, 5), (1, 0, 6))
    assert measure(true, true, ~everywhere(true)) is None


def test_what_is_not_finite_is_missing():
    true = roots((0, 0, 5), (1, 0, 5))
    predicted = roots((np.nan, 0, 5), (1.1, 0, 5))
    assert metrics.mrpe(predicted, true, everywhere(true)) == pytest.approx(100)
    assert metrics.ap25_matched(predicted, true, everywhere(true)) == 1
    assert metrics.average_precision(
        predicted, np.ones((2, 1)), everywhere(true), true, everywhere(true)
    ) == pytest.approx(0.5)


def test_ap25_of_matched_roots_forgives_missed_people_and_true_ap_does_not():
    true = roots((0, 0, 5), (1, 0, 5), (2, 0, 5), (3, 0, 5))
    predicted = true + roots((0.1, 0, 0), (0.3, 0, 0), (0, 0, 0), (0, 0, 0))
    found = np.array([[True], [True], [True], [False]])
    assert metrics.ap25_matched(predicted, true, found) == pytest.approx(2 / 3)
    scores = np.array([[0.9], [0.1], [0.8], [0.5]])
    # Sorted: hit, hit, miss; two of four people at precision 1.
    assert metrics.average_precision(predicted, scores, found, true, everywhere(true)) == pytest.approx(0.5)


def test_average_precision_prefers_hits_that_are_sure():
    true = roots((0, 0, 5), (1, 0, 5))
    predicted = true + roots((0, 0, 0), (0, 0, 2))
    seen = everywhere(true)
    sure_hit = metrics.average_precision(predicted, np.array([[0.9], [0.1]]), seen, true, seen)
    sure_miss = metrics.average_precision(predicted, np.array([[0.1], [0.9]]), seen, true, seen)
    assert (sure_hit, sure_miss) == (pytest.approx(0.5), pytest.approx(0.25))


def test_a_root_is_found_once():
    true = roots((0, 0, 5))
    twice = roots((0, 0, 5), (0.05, 0, 5))
    seen = np.ones((2, 1), bool)
    scores = np.array([[0.1], [0.9]])
    assert metrics.average_precision(twice, scores, seen, true, everywhere(true)) == pytest.approx(1.0)
    lonely = roots((0, 0, 5), (4, 0, 5))
    assert metrics.average_precision(twice, scores, seen, lonely, everywhere(lonely)) == pytest.approx(0.5)


def test_average_precision_does_not_care_who_is_who_and_mrpe_does():
    true = crowd(4)[:, :, 0]
    order, seen, scores = [2, 0, 3, 1], everywhere(true), np.ones(true.shape[:2])
    assert metrics.average_precision(true[order], scores, seen, true, seen) == pytest.approx(1)
    assert metrics.mrpe(true[order], true, seen) > 1000


def test_frames_without_truth_invent_nobody():
    true = np.tile([0.0, 0, 5], (1, 2, 1))
    present = np.array([[True, False]])
    assert metrics.average_precision(true, np.ones((1, 2)), everywhere(true), true, present) == 1


# --- who is who ---


def test_permuted_people_are_brought_together_in_spite_of_wrong_depths():
    true = crowd(4)[:, :, 0]
    order = [2, 0, 3, 1]
    seen = everywhere(true)
    matches = metrics.match_people(1.3 * true[order], true, seen, seen)
    np.testing.assert_array_equal(np.array(order)[matches], range(4))


def test_who_was_not_found_is_matched_with_nobody():
    true = crowd(3)[:, :, 0]
    seen = everywhere(true)
    np.testing.assert_array_equal(metrics.match_people(true[[2]], true, seen[:1], seen), [-1, -1, 0])
    np.testing.assert_array_equal(metrics.match_people(true[:0], true, seen[:0], seen), [-1, -1, -1])


def test_two_who_are_never_there_together_do_not_match():
    true = crowd(1, frames=4)[:, :, 0]
    found, present = np.array([[True, True, False, False]]), np.array([[False, False, True, True]])
    np.testing.assert_array_equal(metrics.match_people(true, true, found, present), [-1])


# --- joints ---


def test_mpjpe_by_hand():
    true = frame((0, 0, 5), (0, 1, 5), (1, 0, 5))
    predicted = frame((3, 0, 5), (3, 1.3, 5), (4, 0, 5.6))
    assert metrics.mpjpe(predicted, true, ALL) == pytest.approx((0 + 300 + 600) / 3)


def test_pck_by_hand():
    true = np.zeros((1, 1, 24, 3))
    predicted = np.tile([0.0, 0, 7], (1, 1, 24, 1))  # where somebody stands does not matter
    predicted[0, 0, JOINT_NAMES.index("left_knee"), 0] += 0.149
    predicted[0, 0, JOINT_NAMES.index("right_knee"), 0] += 0.151
    predicted[0, 0, JOINT_NAMES.index("spine2"), 0] += 5.0  # none of the fourteen
    assert metrics.pck3d(predicted, true, ALL) == pytest.approx(13 / 14)


def test_pck_does_not_forgive_a_wrong_size():
    true = crowd(2)
    pelvis = true[:, :, :1]
    grown = pelvis + 2.0 * (true - pelvis)
    seen = everywhere(true)
    assert metrics.pck3d(true, true, seen) == 1
    assert metrics.pck3d(grown, true, seen) < 0.2


def test_the_fourteen_joints_are_fourteen():
    assert len(set(metrics.MUPOTS_14)) == 14
    assert 0 not in metrics.MUPOTS_14


@given(rigid_motions(), st.floats(0.3, 3))
def test_procrustes_is_blind_to_place_turn_and_size(motion, scale):
    true = crowd(2, frames=3)
    noisy = true + np.random.default_rng(2).normal(size=true.shape) * 0.05
    seen = everywhere(true)
    moved = scale * motion.apply(noisy)
    assert metrics.pa_mpjpe(moved, true, seen) == pytest.approx(metrics.pa_mpjpe(noisy, true, seen), rel=1e-6)


@given(rigid_motions())
def test_a_motion_of_both_changes_nothing(motion):
    true = crowd(2, frames=3)
    predicted = true + np.random.default_rng(2).normal(size=true.shape) * 0.1
    seen = everywhere(true)
    for measure in (metrics.mpjpe, metrics.pck3d, metrics.pa_mpjpe):
        assert measure(motion.apply(predicted), motion.apply(true), seen) == pytest.approx(
            measure(predicted, true, seen), rel=1e-6
        )


def test_procrustes_does_not_align_a_reflection_away():
    true = crowd(2, frames=3)
    mirrored = true * (-1, 1, 1)
    assert metrics.pa_mpjpe(true, true, everywhere(true)) == pytest.approx(0, abs=1e-6)
    assert metrics.pa_mpjpe(mirrored, true, everywhere(true)) > 50


def test_procrustes_error_is_at_most_the_relative_one():
    true = crowd(3)
    predicted = true + np.random.default_rng(5).normal(size=true.shape) * 0.08
    seen = everywhere(true)
    assert 0 < metrics.pa_mpjpe(predicted, true, seen) < metrics.mpjpe(predicted, true, seen)


@pytest.mark.parametrize("measure", [metrics.mpjpe, metrics.pck3d, metrics.pa_mpjpe])
def test_no_joints_give_none(measure):
    true = crowd(2)
    assert measure(true, true, ~everywhere(true)) is None


def test_a_joint_that_is_not_finite_takes_its_person_out_of_that_frame():
    true = crowd(1, frames=2)
    predicted = true.copy()
    predicted[0, 0, 7, 1] = np.inf
    assert metrics.mpjpe(predicted, true, everywhere(true)) == pytest.approx(0, abs=1e-9)


# --- sizes and order ---


def test_height_error_by_hand():
    assert metrics.height_error(np.array([1.8, 0.9]), np.array([2.0, 1.0])) == pytest.approx(0.1)
    assert metrics.height_error(np.array([1.8, np.nan]), np.array([2.0, 1.0])) == pytest.approx(0.1)
    assert metrics.height_error(np.array([]), np.array([])) is None


def test_depth_order_by_hand():
    true = roots((0, 0, 5.0), (0, 0, 5.2), (0, 0, 7.0))
    assert metrics.depth_order(true, true, everywhere(true)) == 1
    # The first two become different (wrong), the last comes nearest (wrong twice).
    predicted = roots((0, 0, 5.0), (0, 0, 6.0), (0, 0, 4.0))
    assert metrics.depth_order(predicted, true, everywhere(true)) == 0
    # Only the pair (0, 1) changes from equal to different.
    assert metrics.depth_order(roots((0, 0, 5), (0, 0, 5.4), (0, 0, 7)), true, everywhere(true)) == pytest.approx(2 / 3)


def test_one_person_has_no_order():
    true = roots((0, 0, 5.0))
    assert metrics.depth_order(true, true, everywhere(true)) is None


# --- when somebody counts as found ---


def test_from_the_first_to_the_last_sight_gaps_included():
    seen = np.array([0, 0, 1, 0, 1, 1, 0], bool)
    assert metrics.first_to_last(seen).tolist() == [False, False, True, True, True, True, False]
    assert not metrics.first_to_last(np.zeros(3, bool)).any()
