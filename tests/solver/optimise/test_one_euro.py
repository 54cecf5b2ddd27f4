import numpy as np
import pytest

from core_solver.optimise.one_euro import one_euro, one_euro_zero_phase

FILTERS = (one_euro, one_euro_zero_phase)


def noise_left(start: int, count: int = 400, rate: float = 25.0, run=one_euro) -> float:
    """Share of white noise that passes, for a clip whose first frame has a late time."""
    values = np.random.default_rng(0).normal(size=(count, 3)) * 0.01
    return float(run(values, (start + np.arange(count)) / rate)[50:-50].std() / values[50:-50].std())


@pytest.mark.parametrize("run", FILTERS)
def test_what_rests_stays(run):
    values = np.full((30, 4, 3), 1.7)
    np.testing.assert_allclose(run(values, np.arange(30) / 25), values, rtol=0, atol=1e-12)


@pytest.mark.parametrize("run", FILTERS)
def test_late_frames_are_filtered_like_early_ones(run):
    """Given absolute times as intervals, a filter opens up along the clip and late frames pass unfiltered."""
    early, late = noise_left(0, run=run), noise_left(10_000, run=run)
    assert late == pytest.approx(early, rel=1e-6)
    assert early < 0.6


def test_noise_reduction_is_even_along_one_clip():
    values = np.random.default_rng(0).normal(size=(12_000, 3)) * 0.01
    filtered = one_euro(values, np.arange(12_000) / 25)
    early, late = filtered[10:1000].std(), filtered[-1000:].std()
    assert late == pytest.approx(early, rel=0.1)


@pytest.mark.parametrize("run", FILTERS)
def test_twice_the_frame_rate_is_the_same_motion(run):
    """The cutoff is in Hz: a rate of 50 or 25 frames a second leaves a slow swing alike."""
    slow, fast = np.arange(100) / 25, np.arange(200) / 50

    def swing(times):
        return 0.3 * np.sin(2 * np.pi * 0.5 * times)[:, None]

    assert np.abs(run(swing(slow), slow) - run(swing(fast), fast)[::2])[10:-10].max() < 0.02


@pytest.mark.parametrize("run", FILTERS)
def test_uneven_times_are_uneven_steps(run):
    """A ramp sampled unevenly stays a ramp: constant speed gives no acceleration anywhere."""
    times = np.cumsum(np.random.default_rng(2).choice([0.02, 0.04, 0.1], 200))
    ramp = (2.0 * times)[:, None]
    speed = np.diff(run(ramp, times), axis=0) / np.diff(times)[:, None]
    middle = speed[60:-60]
    assert np.median(middle) == pytest.approx(2.0, rel=0.02)
    assert np.abs(middle - 2.0).max() < 0.5


def test_a_step_is_followed_without_overshoot_and_late():
    times = np.arange(60) / 25
    step = (times > 0.5).astype(float)[:, None]
    filtered = one_euro(step, times)[:, 0]
    assert (np.diff(filtered) >= -1e-12).all()
    assert filtered.max() <= 1 + 1e-12
    assert filtered[-1] > 0.99
    first = int(np.argmax(step[:, 0]))
    assert 0 < filtered[first] < 1


def test_fast_motion_is_followed_more_closely_than_slow_noise():
    times = np.arange(100) / 25
    slow, fast = 0.1 * times[:, None], 5.0 * times[:, None]
    lag_slow = (slow - one_euro(slow, times))[-1, 0] / 0.1
    lag_fast = (fast - one_euro(fast, times))[-1, 0] / 5.0
    assert 0 < lag_fast < 0.4 * lag_slow


def test_zero_phase_has_no_delay_on_a_ramp():
    times = np.arange(200) / 25
    ramp = np.stack([0.7 * times, -0.2 * times, 0 * times], axis=-1)
    np.testing.assert_allclose(one_euro_zero_phase(ramp, times)[60:-60], ramp[60:-60], atol=2e-3)
    assert np.abs(one_euro(ramp, times) - ramp)[60:-60].max() > 0.01


def test_zero_phase_is_blind_to_the_direction_of_time():
    rng = np.random.default_rng(3)
    values, times = rng.normal(size=(40, 5, 3)), np.cumsum(rng.uniform(0.02, 0.08, 40))
    backwards = one_euro_zero_phase(values[::-1], -times[::-1])[::-1]
    np.testing.assert_allclose(one_euro_zero_phase(values, times), backwards, atol=1e-12)


@pytest.mark.parametrize("run", FILTERS)
def test_one_frame_and_no_side_effect(run):
    values = np.random.default_rng(4).normal(size=(5, 3))
    before = values.copy()
    run(values, np.arange(5) / 25)
    np.testing.assert_array_equal(values, before)
    np.testing.assert_array_equal(run(values[:1], np.zeros(1)), values[:1])
