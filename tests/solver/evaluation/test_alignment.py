import numpy as np
import pytest
from hypothesis import given

from core_solver.evaluation.alignment import group_w, w_mpjpe, wa_mpjpe
from core_solver.evaluation.metrics import mrpe
from tests.solver.evaluation.strategies import crowd, everywhere, rigid_motions


@pytest.mark.parametrize("measure", [w_mpjpe, wa_mpjpe, group_w])
def test_a_wrong_scale_shows_where_scale_is_fixed_and_vanishes_where_it_is_not(measure):
    true = crowd(3, frames=30)
    seen = everywhere(true)
    assert measure(1.3 * true, true, seen, with_scale=False) > 50
    assert measure(1.3 * true, true, seen, with_scale=True) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("measure", [w_mpjpe, wa_mpjpe, group_w])
@given(motion=rigid_motions())
def test_a_rigid_motion_is_aligned_away(measure, motion):
    true = crowd(2, frames=5)
    seen = everywhere(true)
    assert measure(motion.apply(true), true, seen, with_scale=False) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("measure", [w_mpjpe, wa_mpjpe, group_w])
def test_a_reflection_is_not_aligned_away(measure):
    true = crowd(3, frames=10)
    assert measure(true * (-1, 1, 1), true, everywhere(true), with_scale=True) > 50


def test_only_the_group_tells_that_people_stand_wrongly_among_each_other():
    true = crowd(3, frames=20)
    predicted = true.copy()
    predicted[1] += (0, 0, 1.5)
    seen = everywhere(true)
    assert wa_mpjpe(predicted, true, seen, with_scale=False) == pytest.approx(0, abs=1e-6)
    assert group_w(predicted, true, seen) > 300


def test_the_group_moves_once_for_the_whole_clip():
    true = crowd(2, frames=20)
    predicted = true.copy()
    predicted[:, 10:] += (1, 0, 0)
    # All people jump together: no one motion of the clip removes it, half a metre remains on either side.
    assert group_w(predicted, true, everywhere(true)) == pytest.approx(500, rel=0.2)


def test_a_drift_shows_more_when_only_the_first_frames_are_aligned():
    true = crowd(1, frames=100)
    drift = true + np.linspace(0, 1, 100)[:, None, None] * np.array([1.0, 0, 0])
    first = w_mpjpe(drift, true, everywhere(true), with_scale=False)
    whole = wa_mpjpe(drift, true, everywhere(true), with_scale=False)
    assert first > 1.5 * whole
    assert first == pytest.approx(500, rel=0.1)  # a line from 0 to 1 m, aligned at its start


def test_chunks_are_a_hundred_frames_and_the_rest_goes_with_the_last():
    true = crowd(1, frames=250)
    predicted = true.copy()
    predicted[:, 100:] += (1, 0, 0)  # between the chunks: aligned away
    assert w_mpjpe(predicted, true, everywhere(true), with_scale=False) == pytest.approx(0, abs=1e-6)
    predicted = true.copy()
    predicted[:, 200:] += (1, 0, 0)  # inside the second chunk, which runs to 250
    assert w_mpjpe(predicted, true, everywhere(true), with_scale=False) == pytest.approx(1000 * 50 / 250)


def test_chunks_count_frames_that_were_measured():
    true = crowd(1, frames=205)
    predicted = true.copy()
    predicted[:, 105:] += (1, 0, 0)
    mask = everywhere(true)
    mask[0, 20:25] = False  # the hundredth measured frame is number 104
    predicted[0, 20:25] = np.nan
    assert w_mpjpe(predicted, true, mask, with_scale=False) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("measure", [w_mpjpe, wa_mpjpe, group_w])
def test_missing_people_are_left_out_and_nobody_gives_none(measure):
    true = crowd(3, frames=6)
    mask = everywhere(true)
    mask[1] = False
    broken = true.copy()
    broken[1] = np.nan
    assert measure(broken, true, mask, with_scale=False) == pytest.approx(0, abs=1e-6)
    assert measure(true, true, ~everywhere(true), with_scale=False) is None


def test_a_person_seen_in_one_frame_is_measured():
    true = crowd(1, frames=1)
    assert w_mpjpe(true + 1, true, everywhere(true), with_scale=False) == pytest.approx(0, abs=1e-6)


def test_alignment_forgives_what_the_absolute_error_does_not():
    true = crowd(2, frames=6)
    moved = true + np.array([0, 0, 2.0])
    seen = everywhere(true)
    assert mrpe(moved[:, :, 0], true[:, :, 0], seen) == pytest.approx(2000)
    assert group_w(moved, true, seen) == pytest.approx(0, abs=1e-6)
