from dataclasses import dataclass

import numpy as np
import pytest

from core_solver.evaluation import motion
from tests.solver.evaluation.strategies import crowd, everywhere


@dataclass(frozen=True)
class Floor:
    """A flat floor `level` metres below the camera."""

    level: float

    def height_above(self, points):
        return self.level - points[..., 1]


def line(*positions) -> np.ndarray:
    """One person with one joint that moves along x, (1, T, 1, 3)."""
    points = np.zeros((1, len(positions), 1, 3))
    points[0, :, 0, 0] = positions
    return points


def test_jitter_of_the_paper_by_hand():
    true, predicted = line(0, 1, 1), line(0, 0, 3)  # steps 1, 0 and 0, 3
    assert motion.jitter_paper(predicted, true, everywhere(true)) == pytest.approx(1000 * (1 + 3) / 2)


def test_jitter_of_the_paper_is_blind_to_direction():
    true, backwards = line(0, 1, 2), line(0, -1, -2)
    assert motion.jitter_paper(backwards, true, everywhere(true)) == 0


def test_steps_across_a_gap_do_not_count():
    true, predicted = line(0, 0, 0, 0), line(0, 9, 9, 9)
    mask = np.array([[True, False, True, True]])
    assert motion.jitter_paper(predicted, true, mask) == 0


def test_jitter_of_wham_is_the_third_derivative():
    rate = 30.0
    seconds = np.arange(20) / rate
    cubic = line(*(2.0 * seconds**3))  # third derivative 12 m/s^3
    assert motion.jitter_wham(cubic, everywhere(cubic), rate) == pytest.approx(1.2)
    even = line(*(1 + 3 * seconds - seconds**2))
    assert motion.jitter_wham(even, everywhere(even), rate) == pytest.approx(0, abs=1e-6)


def test_jitter_of_wham_needs_four_frames_in_a_row():
    points = crowd(1, frames=7)
    mask = np.array([[True, True, True, False, True, True, True]])
    assert motion.jitter_wham(points, mask, 30) is None
    assert motion.jitter_wham(points[:, :3], mask[:, :3], 30) is None


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_clips_too_short_to_jitter_give_none_rather_than_break(frames):
    points = crowd(1, frames=frames)
    assert motion.jitter_wham(points, everywhere(points), 30) is None
    assert (motion.jitter_paper(points, points, everywhere(points)) is None) == (frames == 1)


def feet(left, right) -> np.ndarray:
    """Soles (1, T, 2, 3, 3) of one person: three vertices under each foot at these x."""
    soles = np.zeros((1, len(left), 2, 3, 3))
    soles[0, :, 0, :, 0] = np.array(left, float)[:, None]
    soles[0, :, 1, :, 0] = np.array(right, float)[:, None]
    return soles


def test_skate_counts_the_resting_foot_only():
    soles = feet([0, 0.01, 0.03, 1.0], [0, 1, 2, 3])
    contacts = np.zeros((1, 4, 2), bool)
    contacts[0, :3, 0] = True
    assert motion.foot_skate(soles, contacts, np.ones((1, 4), bool)) == pytest.approx((10 + 20) / 2)
    contacts[0, 0, 0] = False  # landing is no sliding
    assert motion.foot_skate(soles, contacts, np.ones((1, 4), bool)) == pytest.approx(20)


def test_skate_of_nobody_at_rest_is_none():
    soles = feet([0, 1], [0, 1])
    assert motion.foot_skate(soles, np.zeros((1, 2, 2), bool), np.ones((1, 2), bool)) is None
    assert motion.foot_skate(soles, np.ones((1, 2, 2), bool), np.array([[True, False]])) is None


def test_penetration_by_hand():
    vertices = np.zeros((1, 1, 4, 3))
    vertices[0, 0, :, 1] = (1.0, 1.504, 1.51, 1.53)  # the floor is at 1.5: above, 4 mm, 10 mm and 30 mm below
    seen = np.ones((1, 1), bool)
    assert motion.penetration(vertices, Floor(1.5), seen) == pytest.approx(20)
    assert motion.penetration_share(vertices, Floor(1.5), seen) == pytest.approx(0.5)
    assert motion.penetration(vertices, Floor(2.0), seen) == 0
    assert motion.penetration(vertices, Floor(2.0), ~seen) is None


def test_contact_f1_by_hand():
    true = np.array([[[True, True], [True, False]]])
    claimed = np.array([[[0.9, 0.2], [0.8, 0.7]]])  # two hits, one false, one missed
    assert motion.contact_f1(claimed, true, np.ones((1, 2), bool)) == pytest.approx(2 / 3)
    assert motion.contact_f1(claimed, true, np.array([[True, False]])) == pytest.approx(2 / 3)
    assert motion.contact_f1(0 * claimed, true, np.ones((1, 2), bool)) == 0
    assert motion.contact_f1(0 * claimed, ~true & False, np.ones((1, 2), bool)) is None
