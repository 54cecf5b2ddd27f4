"""The limits' directions, seen on a body: what bends which way."""

import numpy as np
import pytest

from core_solver.body import MIRROR, kinematics
from core_solver.body.limits import joint_limits
from core_solver.body.skeleton import joint_index
from tests.solver.body.synthetic import make_stick_body

BODY = make_stick_body()
REST = BODY.rest_joints(BODY.neutral_betas)
LOWER, UPPER = joint_limits()
SIDES = ("left", "right")


def moved(joint: str, axis: int, angle: float, end: str) -> np.ndarray:
    """How far the joint `end` travels (3,) when `joint` turns: x to the body's left, y up, z to the front."""
    theta = np.zeros((24, 3))
    theta[joint_index(joint), axis] = angle
    return kinematics.pose_joints(theta, REST)[1][joint_index(end)] - REST[joint_index(end)]


def room(joint: str, axis: int) -> tuple[float, float]:
    """Most negative and most positive allowed angle."""
    return float(LOWER[joint_index(joint), axis]), float(UPPER[joint_index(joint), axis])


def test_lower_lies_below_upper_and_the_rest_pose_is_allowed():
    assert (LOWER < 0).all()
    assert (UPPER > 0).all()
    assert np.isinf(LOWER[0]).all()
    assert np.isinf(UPPER[0]).all()
    assert np.isfinite(LOWER[1:]).all()
    assert np.isfinite(UPPER[1:]).all()


def test_the_right_side_is_the_left_one_in_the_mirror():
    """A pose seen in the mirror swaps sides and turns round its y and z rotations: it must be as allowed as before."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        theta = rng.uniform(-3, 3, (24, 3))
        mirrored = theta[list(MIRROR)] * (1, -1, -1)

        def beyond(pose):
            return (np.maximum(pose - UPPER, 0) + np.maximum(LOWER - pose, 0)).sum(axis=1)

        np.testing.assert_allclose(beyond(mirrored), beyond(theta)[list(MIRROR)], atol=1e-12)


@pytest.mark.parametrize("side", SIDES)
def test_knees_bend_backwards_only(side):
    low, high = room(f"{side}_knee", 0)
    heel_to_seat = moved(f"{side}_knee", 0, high, f"{side}_ankle")
    assert heel_to_seat[2] < -0.1
    assert heel_to_seat[1] > 0.3
    assert high > 2
    # The other way, which would be a broken knee, the foot may hardly move.
    assert moved(f"{side}_knee", 0, low, f"{side}_ankle")[2] < 0.05
    assert moved(f"{side}_knee", 0, -0.1, f"{side}_ankle")[2] > 0


@pytest.mark.parametrize("side", SIDES)
def test_elbows_bend_forwards_only(side):
    low, high = room(f"{side}_elbow", 1)
    fold, stretch = (low, high) if abs(low) > abs(high) else (high, low)
    assert abs(fold) > 2
    assert abs(stretch) < 0.2
    quarter = np.sign(fold) * np.pi / 2
    hand = moved(f"{side}_elbow", 1, quarter, f"{side}_wrist")
    assert hand[2] > 0.2
    assert hand[0] * (1 if side == "left" else -1) < -0.2  # towards the body's middle
    assert moved(f"{side}_elbow", 1, stretch, f"{side}_wrist")[2] > -0.05


@pytest.mark.parametrize("side", SIDES)
def test_thighs_rise_far_to_the_front_and_little_to_the_back(side):
    low, high = room(f"{side}_hip", 0)
    forwards, backwards = (moved(f"{side}_hip", 0, angle, f"{side}_knee") for angle in (low, high))
    assert forwards[2] > 0.2
    assert forwards[1] > backwards[1] > 0
    assert backwards[2] < -0.1
    assert abs(low) > 2 * abs(high)


@pytest.mark.parametrize("side", SIDES)
def test_legs_spread_wider_than_they_cross(side):
    outwards = 1 if side == "left" else -1
    travel = [moved(f"{side}_hip", 2, angle, f"{side}_knee")[0] * outwards for angle in room(f"{side}_hip", 2)]
    assert max(travel) > abs(min(travel)) > 0.1


@pytest.mark.parametrize("side", SIDES)
def test_arms_can_hang_down_and_be_raised(side):
    angles = room(f"{side}_shoulder", 2)
    assert max(moved(f"{side}_shoulder", 2, angle, f"{side}_elbow")[1] for angle in angles) > 0.2
    # Hanging straight down is a quarter turn from the T-pose, well inside.
    down = -np.pi / 2 if side == "left" else np.pi / 2
    assert angles[0] < down < angles[1]
    assert moved(f"{side}_shoulder", 2, down, f"{side}_elbow")[1] < -0.2


def test_the_spine_bends_farther_forwards_than_back():
    for joint in ("spine1", "spine2", "spine3"):
        low, high = room(joint, 0)
        assert moved(joint, 0, high, "head")[2] > 0
        assert high > -low
