"""Every term against values worked out by hand, against finite differences, and against what it must ignore."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core_solver.energy import terms
from core_solver.energy.terms import CONTACT_RANGE_M

PEOPLE, FRAMES = 2, 4
# 2 (sqrt(1 + r^2) - 1) at r = 1: what a robust term costs one deviation from the truth.
ONE_DEVIATION = 2 * (math.sqrt(2) - 1)


def normal(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.as_tensor(np.random.default_rng(seed).normal(size=shape))


def uneven_seconds() -> torch.Tensor:
    return torch.tensor([0.04, 0.08, 0.05], dtype=torch.float64)


def pull(energy, values: torch.Tensor) -> torch.Tensor:
    """Gradient of a scalar energy."""
    leaf = values.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(energy(leaf), leaf)
    return gradient


UNEVEN_TIMES = torch.cat([torch.zeros(1, dtype=torch.float64), torch.cumsum(uneven_seconds(), 0)])

# Each term as a function of what is solved for alone, with the place where it must vanish.
JOINTS_AT, SIZES = normal(PEOPLE, FRAMES, 3, 2, seed=1) * 50, torch.full((PEOPLE, FRAMES), 200.0, dtype=torch.float64)
CONFIDENCE = torch.rand(PEOPLE, FRAMES, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
THETA_HAT = normal(PEOPLE, FRAMES, 24, 3, seed=2)
WEIGHT = torch.rand(PEOPLE, FRAMES, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
BETAS_HAT = normal(PEOPLE, 10, seed=3)
LOG_MEAN = math.log(1.65)
SCENE_LOG_DEPTH = normal(PEOPLE, FRAMES, seed=4)
PROBABILITY = torch.rand(PEOPLE, FRAMES, 2, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
REACH = torch.full((PEOPLE, FRAMES), CONTACT_RANGE_M, dtype=torch.float64)
FILTERED = normal(PEOPLE, FRAMES, 5, 3, seed=5)

TERMS = {
    "joints": (lambda x: terms.joints(x, JOINTS_AT, CONFIDENCE, SIZES, 0.02), JOINTS_AT),
    "smpl": (lambda x: terms.smpl(x, THETA_HAT, WEIGHT, 0.15), THETA_HAT),
    "shape": (lambda x: terms.shape(x, BETAS_HAT), BETAS_HAT),
    "height": (lambda x: terms.height(x, LOG_MEAN, 0.07, 0.12), torch.full((PEOPLE,), LOG_MEAN, dtype=torch.float64)),
    "speed": (lambda x: terms.speed(x, uneven_seconds(), 1.0), normal(PEOPLE, 1, 3).expand(-1, FRAMES, -1)),
    "acceleration": (
        lambda x: terms.acceleration(x, uneven_seconds(), 4.0),
        normal(PEOPLE, 1, 3) + normal(PEOPLE, 1, 3, seed=6) * UNEVEN_TIMES[:, None],
    ),
    "depth": (lambda x: terms.depth(x, SCENE_LOG_DEPTH, WEIGHT, 0.15), SCENE_LOG_DEPTH),
    "contact": (
        lambda x: terms.contact(x, PROBABILITY, REACH, 0.02),
        torch.zeros(PEOPLE, FRAMES, 2, dtype=torch.float64),
    ),
    "penetration": (
        lambda x: terms.penetration(x, WEIGHT, REACH),
        torch.zeros(PEOPLE, FRAMES, 2, dtype=torch.float64),
    ),
    "slip": (
        lambda x: terms.slip(x, PROBABILITY, uneven_seconds(), 0.1),
        normal(PEOPLE, 1, 2, 6, 3).expand(-1, FRAMES, -1, -1, -1),
    ),
    "temporal": (lambda x: terms.temporal(x, FILTERED, uneven_seconds(), 0.4), FILTERED + 0.3),
}


@pytest.mark.parametrize("name", TERMS)
def test_zero_without_pull_at_the_truth(name):
    energy, truth = TERMS[name]
    assert energy(truth).shape == ()
    assert energy(truth).item() == pytest.approx(0, abs=1e-18)
    assert pull(energy, truth).abs().max().item() == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("name", TERMS)
def test_positive_and_true_gradient_away_from_the_truth(name):
    energy, truth = TERMS[name]
    # Small enough to stay within the 20 cm of contact, where the gate is constant.
    away = (truth + 0.02 * normal(*truth.shape, seed=9)).requires_grad_()
    assert energy(away).item() > 0
    assert torch.autograd.gradcheck(energy, (away,), eps=1e-7, rtol=1e-4)


@pytest.mark.parametrize("name", ["joints", "smpl", "shape", "height", "acceleration", "depth", "slip"])
def test_an_outlier_pulls_hardly_more_than_what_is_a_few_deviations_off(name):
    energy, truth = TERMS[name]
    direction = (10 if name == "joints" else 1) * normal(*truth.shape, seed=10)  # pixels and radians
    near = pull(energy, truth + direction).abs().max().item()
    assert pull(energy, truth + 1e4 * direction).abs().max().item() <= 1.5 * near


def test_joints_by_hand():
    # 3 and 4 pixels off are 5; in a person of 250 pixels at 2 % that is one deviation.
    projected = torch.tensor([[[[3.0, 4.0], [0.0, 0.0]]]], dtype=torch.float64)
    energy = terms.joints(
        projected, torch.zeros_like(projected), torch.tensor([[[0.5, 0.5]]]), torch.full((1, 1), 250.0), 0.02
    )
    assert energy.item() == pytest.approx(0.5 * ONE_DEVIATION)


def test_far_and_near_people_cost_alike():
    off = normal(1, 3, 5, 2)
    confidence, size = torch.ones(1, 3, 5), torch.full((1, 3), 40.0)
    far = terms.joints(off, off * 0, confidence, size, 0.02)
    near = terms.joints(10 * off, off * 0, confidence, 10 * size, 0.02)
    assert far.item() == pytest.approx(near.item())


def test_a_joint_without_confidence_says_nothing():
    confidence = CONFIDENCE.clone()
    confidence[0, 2, 1] = 0
    gradient = pull(lambda x: terms.joints(x, JOINTS_AT, confidence, SIZES, 0.02), JOINTS_AT + 5)
    assert (gradient[0, 2, 1] == 0).all()
    assert (gradient[confidence > 0] != 0).all()


def test_smpl_by_hand_and_unseen_frames_say_less():
    theta = torch.zeros(1, 2, 24, 3, dtype=torch.float64)
    theta[:, :, 4] = torch.tensor([0.15, 0.0, 0.0])
    energy = terms.smpl(theta, torch.zeros_like(theta), torch.tensor([[1.0, 0.25]]), 0.15)
    assert energy.item() == pytest.approx(1.25 * ONE_DEVIATION)


def test_shape_by_hand():
    betas = torch.zeros(2, 10, dtype=torch.float64)
    betas[0, 3], betas[1, 0] = 1, math.sqrt(3)
    assert terms.shape(betas, torch.zeros_like(betas)).item() == pytest.approx(ONE_DEVIATION + 2)


@given(st.floats(1.01, 3))
def test_a_child_is_believed_sooner_than_a_giant(factor):
    tall = terms.height(torch.tensor([math.log(1.65 * factor)], dtype=torch.float64), LOG_MEAN, 0.07, 0.12)
    small = terms.height(torch.tensor([math.log(1.65 / factor)], dtype=torch.float64), LOG_MEAN, 0.07, 0.12)
    assert tall.item() > small.item() > 0


def test_height_by_hand():
    log_heights = torch.tensor([LOG_MEAN + 0.07, LOG_MEAN - 0.12], dtype=torch.float64)
    assert terms.height(log_heights, LOG_MEAN, 0.07, 0.12).item() == pytest.approx(2 * ONE_DEVIATION)


def test_speed_by_hand_uses_the_time_between_frames():
    translations = torch.zeros(1, 3, 3, dtype=torch.float64)
    translations[0, 1:, 0] = 0.1
    for seconds in (0.04, 0.1):
        energy = terms.speed(translations, torch.tensor([seconds, 5.0]), 0.5)
        assert energy.item() == pytest.approx((0.1 / seconds / 0.5) ** 2)


def test_acceleration_by_hand():
    # From rest to 0.1 m/s within uneven frames: the velocity changes by 0.1 m/s over half their sum, 0.05 s.
    translations = torch.zeros(1, 3, 3, dtype=torch.float64)
    translations[0, 2, 1] = 0.1 * 0.06
    energy = terms.acceleration(translations, torch.tensor([0.04, 0.06], dtype=torch.float64), 2.0)
    assert energy.item() == pytest.approx(ONE_DEVIATION)


def test_depth_by_hand_and_without_a_mask_no_term():
    body = torch.tensor([[0.0, 0.3]], dtype=torch.float64)
    scene = torch.tensor([[0.3, -9.0]], dtype=torch.float64)
    weight = torch.tensor([[1.0, 0.0]], dtype=torch.float64)
    assert terms.depth(body, scene, weight, 0.3).item() == pytest.approx(ONE_DEVIATION)
    gradient = pull(lambda x: terms.depth(x, scene, weight, 0.3), body)
    assert gradient[0, 1] == 0
    assert gradient[0, 0] < 0  # a body that is too near is pushed away, without any bias


def test_contact_by_hand():
    heights = torch.tensor([[[0.02, 0.0]]], dtype=torch.float64)
    assert terms.contact(heights, torch.full((1, 1, 2), 0.5), REACH[:1, :1], 0.02).item() == pytest.approx(
        0.5 * ONE_DEVIATION
    )


@given(st.floats(-1, 1))
def test_contact_pulls_from_both_sides_and_only_from_within_reach(height):
    reach = torch.tensor([[0.2, 0.5]], dtype=torch.float64)
    heights = torch.full((1, 2, 2), height, dtype=torch.float64)
    gradient = pull(lambda x: terms.contact(x, torch.ones(1, 2, 2), reach, 0.02), heights)
    # Residuals whose square is below the smallest number have no pull left.
    if height == 0 or abs(height) > 1e-9:
        for frame in range(2):
            expected = np.sign(height) if abs(height) < reach[0, frame].item() else 0.0
            assert (torch.sign(gradient[0, frame]) == expected).all()


def test_the_papers_range_of_contact():
    assert CONTACT_RANGE_M == 0.20


def test_a_foot_in_the_air_is_not_pulled_down():
    heights = torch.full((1, 1, 2), 0.05, dtype=torch.float64)
    gradient = pull(lambda x: terms.contact(x, torch.tensor([[[0.0, 1.0]]]), REACH[:1, :1], 0.02), heights)
    assert gradient[0, 0, 0] == 0
    assert gradient[0, 0, 1] > 0


def test_slip_by_hand():
    # One foot of two sole vertices; one of them moves 1 cm in 0.1 s: one deviation of 0.1 m/s, half the foot.
    soles = torch.zeros(1, 2, 2, 2, 3, dtype=torch.float64)
    soles[0, 1, 0, 0, 2] = 0.01
    energy = terms.slip(soles, torch.ones(1, 2, 2), torch.tensor([0.1], dtype=torch.float64), 0.1)
    assert energy.item() == pytest.approx(0.5 / 2)


def test_slip_acts_only_between_consecutive_frames_that_are_both_in_contact():
    soles = normal(1, 5, 2, 6, 3)
    contact = torch.zeros(1, 5, 2, dtype=torch.float64)
    # Left: contact in frames 0 and 1. Right: in frames 1, 3: never twice in a row.
    contact[0, [0, 1], 0] = 1
    contact[0, [1, 3], 1] = 1
    gradient = pull(lambda x: terms.slip(x, contact, torch.full((4,), 0.04), 10.0), soles)
    moved = (gradient != 0).flatten(3).any(-1)[0]
    assert moved.tolist() == [[True, False], [True, False], [False, False], [False, False], [False, False]]


def test_temporal_by_hand():
    vertices = torch.zeros(1, 2, 4, 3, dtype=torch.float64)
    vertices[0, 1, 2, 1] = 0.02
    energy = terms.temporal(vertices, torch.zeros_like(vertices), torch.tensor([0.05], dtype=torch.float64), 0.4)
    assert energy.item() == pytest.approx(1 / 4)


@pytest.mark.parametrize("name", ["joints", "smpl", "depth", "contact"])
def test_batches_of_frames_add_up_to_the_whole(name):
    """Splitting a clip changes nothing in terms that look at one frame at a time."""
    heights = 0.05 * normal(PEOPLE, FRAMES, 2)
    at = {"joints": JOINTS_AT + 3, "smpl": THETA_HAT + 0.1, "depth": SCENE_LOG_DEPTH + 0.2, "contact": heights}[name]

    def part(frames: slice) -> float:
        x = at[:, frames]
        return {
            "joints": lambda: terms.joints(x, JOINTS_AT[:, frames], CONFIDENCE[:, frames], SIZES[:, frames], 0.02),
            "smpl": lambda: terms.smpl(x, THETA_HAT[:, frames], WEIGHT[:, frames], 0.15),
            "depth": lambda: terms.depth(x, SCENE_LOG_DEPTH[:, frames], WEIGHT[:, frames], 0.15),
            "contact": lambda: terms.contact(x, PROBABILITY[:, frames], REACH[:, frames], 0.02),
        }[name]().item()

    assert part(slice(0, 3)) + part(slice(3, 4)) == pytest.approx(part(slice(0, 4)))


@pytest.mark.parametrize("name", ["speed", "slip", "temporal"])
def test_batches_that_share_a_frame_add_up_to_the_whole(name):
    """Terms between consecutive frames add up over batches that overlap by one frame."""
    shape = {"speed": (PEOPLE, FRAMES, 3), "slip": (PEOPLE, FRAMES, 2, 6, 3), "temporal": (PEOPLE, FRAMES, 5, 3)}[name]
    at = normal(*shape, seed=11) * 0.01

    def part(first: int, last: int) -> float:
        x, seconds, frames = at[:, first : last + 1], uneven_seconds()[first:last], slice(first, last + 1)
        return {
            "speed": lambda: terms.speed(x, seconds, 1.0),
            "slip": lambda: terms.slip(x, PROBABILITY[:, frames], seconds, 0.1),
            "temporal": lambda: terms.temporal(x, FILTERED[:, frames], seconds, 0.4),
        }[name]().item()

    assert part(0, 2) + part(2, 3) == pytest.approx(part(0, 3))


@pytest.mark.parametrize(
    "name", ["joints", "smpl", "shape", "height", "depth", "speed", "acceleration", "slip", "temporal"]
)
def test_people_do_not_touch_each_other(name):
    energy, truth = TERMS[name]
    away = truth.clone()
    away[1] += 0.1 * normal(*truth.shape[1:], seed=12)
    gradient = pull(energy, away)
    assert (gradient[0] == 0).all() or gradient[0].abs().max() < 1e-9
    assert (gradient[1] != 0).any()


def test_penetration_by_hand_counts_only_what_is_below_the_ground():
    heights = torch.tensor([[[0.3, 0.0], [-0.2, -0.4], [-0.2, 0.0]]], dtype=torch.float64)
    weight = torch.tensor([[1.0, 1.0, 0.0]], dtype=torch.float64)
    reach = torch.full((1, 3), 0.2, dtype=torch.float64)
    # One deviation costs a half, two cost four fifths; a frame without evidence costs nothing.
    assert terms.penetration(heights, weight, reach).item() == pytest.approx(0.5 + 0.8)


def test_penetration_lifts_a_sunken_sole_and_lets_go_where_the_ground_must_be_wrong():
    weight, reach = torch.ones(1, 1, dtype=torch.float64), torch.full((1, 1), 0.2, dtype=torch.float64)
    heights = torch.tensor([[[-0.1, 0.1]]], dtype=torch.float64)
    gradient = pull(lambda x: terms.penetration(x, weight, reach), heights)
    assert gradient[0, 0, 0] < 0  # descent raises the sole that is below
    assert gradient[0, 0, 1] == 0
    far = pull(lambda x: terms.penetration(x, weight, reach), heights * 50)
    assert abs(far[0, 0, 0]) < 0.01 * abs(gradient[0, 0, 0])
