import numpy as np
import pytest

from core_solver.energy.weights import ROOT_ACCELERATION
from core_solver.optimise.root_motion import smooth_depths

RATE = 25.0
TIMES = np.arange(100) / RATE
EVERYWHERE = np.ones(100, bool)


def test_a_person_who_stands_keeps_the_depth():
    np.testing.assert_allclose(smooth_depths(np.full(100, 7.0), EVERYWHERE, TIMES), 7.0, rtol=1e-6)


def test_a_walk_into_the_depth_keeps_its_speed():
    walk = 5.0 * np.exp(0.2 * TIMES)  # straight in log depth, where the smoother works
    np.testing.assert_allclose(smooth_depths(walk, EVERYWHERE, TIMES), walk, rtol=1e-4)


@pytest.mark.parametrize("distance", [3.0, 30.0])
def test_trembling_goes_and_lively_motion_stays(distance):
    rng = np.random.default_rng(0)
    # A person who rocks with half the acceleration of lively motion.
    amplitude = 0.5 * ROOT_ACCELERATION / (2 * np.pi * 0.7) ** 2
    truth = distance + amplitude * np.sin(2 * np.pi * 0.7 * TIMES)
    noisy = truth * np.exp(0.04 * rng.normal(size=100))
    smooth = smooth_depths(noisy, EVERYWHERE, TIMES)
    assert np.sqrt(np.mean((smooth - truth) ** 2)) < 0.5 * np.sqrt(np.mean((noisy - truth) ** 2))


def test_one_wild_frame_is_ignored():
    depths = np.full(100, 5.0)
    depths[40] = 9.0
    assert np.abs(smooth_depths(depths, EVERYWHERE, TIMES) - 5).max() < 0.1


def test_gaps_are_bridged_and_ends_held_at_uneven_times():
    times = np.cumsum(np.random.default_rng(1).uniform(0.02, 0.06, 60))
    truth = 4 * np.exp(0.15 * times)
    known = np.ones(60, bool)
    known[:8] = known[25:40] = known[55:] = False
    smooth = smooth_depths(np.where(known, truth, 99.0), known, times)
    np.testing.assert_allclose(smooth[8:55], truth[8:55], rtol=1e-3)
    np.testing.assert_allclose(smooth[:8], truth[8], rtol=1e-3)
    np.testing.assert_allclose(smooth[55:], truth[54], rtol=1e-3)


@pytest.mark.parametrize("count", [0, 1, 2, 3])
def test_few_frames_are_left_as_they_are(count):
    depths = np.array([5.0, 5.1, 5.0, 5.2])
    known = np.arange(4) < count
    smooth = smooth_depths(depths, known, TIMES[:4])
    assert np.isfinite(smooth).all()
    np.testing.assert_allclose(smooth[:count], depths[:count], rtol=0.05)
