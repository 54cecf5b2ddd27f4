"""Random signals are as large, as lasting and as frequent as they say."""

import numpy as np
import pytest

from core_solver.evaluation.synthetic.noise import NoiseLevels, drifting, episodes, knot_shape, smooth_field

TIMES = np.arange(4000) / 25


def test_drifting_signals_have_unit_size_and_forget() -> None:
    signal = drifting(np.random.default_rng(0), TIMES, (50,), 0.2)
    assert signal.std() == pytest.approx(1, abs=0.03)
    lag = 5  # frames: one forgetting time
    assert (signal[lag:] * signal[:-lag]).mean() == pytest.approx(np.exp(-1), abs=0.03)


def test_uneven_frames_forget_by_time() -> None:
    times = np.cumsum(np.tile([0.02, 0.2], 2000))
    signal = drifting(np.random.default_rng(0), times, (50,), 0.2)
    alike = [(signal[start + 1 :: 2] * signal[start::2][: len(signal[start + 1 :: 2])]).mean() for start in (0, 1)]
    np.testing.assert_allclose(alike, np.exp([-1.0, -0.1]), atol=0.03)


def test_episodes_are_on_as_often_and_as_long_as_asked() -> None:
    on = episodes(np.random.default_rng(0), TIMES, (50,), 0.1, 0.4)
    assert on.mean() == pytest.approx(0.1, abs=0.01)
    starts = (on[1:] & ~on[:-1]).sum()
    # Between frames nobody looks: an episode shows in as many frames as fit, on average its length and half a frame.
    assert on.sum() / starts / 25 == pytest.approx(0.4 + 0.02, abs=0.04)


def test_nothing_happens_at_a_share_of_zero() -> None:
    assert not episodes(np.random.default_rng(0), TIMES, (9,), 0.0, 0.2).any()


@pytest.mark.parametrize("size", [(320, 180), (144, 256)])
def test_smooth_fields_are_as_large_as_their_knots_and_smooth(size: tuple[int, int]) -> None:
    rng = np.random.default_rng(0)
    fields = np.stack([smooth_field(rng.normal(size=knot_shape(size, 8)), size) for _ in range(200)])
    assert fields.shape[1:] == size[::-1]
    assert fields.std() == pytest.approx(1, abs=0.06)
    assert np.diff(fields, axis=1).std() < 0.15


def test_larger_errors_keep_their_kinds() -> None:
    usual, large = NoiseLevels(), NoiseLevels().times(2)
    assert large.keypoint == 2 * usual.keypoint
    assert large.disparity_relief == 2 * usual.disparity_relief
    assert large.keypoint_seconds == usual.keypoint_seconds
    assert large.sure == usual.sure
