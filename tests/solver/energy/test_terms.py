"""Every term against values worked out by hand, against finite differences, and against what it must ignore."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from core_solver.energy import terms
from core_solver.energy.terms import CONTACT_RANGE_M
from core_solver.energy.weights import Weights

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
EDGES, SHARES = 100 * normal(PEOPLE, FRAMES, 8, seed=7), torch.full((PEOPLE, FRAMES, 8), 0.1, dtype=torch.float64)
ADULTS = torch.tensor([[1.0, LOG_MEAN, 0.06]], dtype=torch.float64)
EVERYBODY = torch.tensor(Weights().statures(), dtype=torch.float64)

TERMS = {
    "joints": (lambda x: terms.joints(x, JOINTS_AT, CONFIDENCE, SIZES, 0.02), JOINTS_AT),
    "smpl": (lambda x: terms.smpl(x, THETA_HAT, WEIGHT, 0.15), THETA_HAT),
    "shape": (lambda x: terms.shape(x, BETAS_HAT), BETAS_HAT),
    "guard": (lambda x: terms.guard(x, 0.01), torch.zeros(PEOPLE, dtype=torch.float64)),
    "stature": (lambda x: terms.stature(x, 0.01), torch.zeros(PEOPLE, dtype=torch.float64)),
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
    "silhouette": (lambda x: terms.silhouette(x, EDGES, SHARES, 0.02 * SIZES), EDGES),
    "collision": (lambda x: terms.collision(x, 0.05), torch.zeros(PEOPLE, FRAMES, 6, dtype=torch.float64)),
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


@pytest.mark.parametrize(
    "name", ["joints", "smpl", "shape", "acceleration", "depth", "slip", "silhouette", "collision"]
)
def test_an_outlier_pulls_hardly_more_than_what_is_a_few_deviations_off(name):
    energy, truth = TERMS[name]
    direction = (10 if name in ("joints", "silhouette") else 1) * normal(*truth.shape, seed=10)  # pixels and radians
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


def test_stature_by_hand():
    assert terms.stature(torch.tensor([0.02, -0.01]), 0.01).item() == pytest.approx(4 + 1)


def test_guard_by_hand():
    assert terms.guard(torch.tensor([0.02, -0.01]), 0.01).item() == pytest.approx(4 + 1)
    assert terms.guard(torch.tensor([0.02, -0.01]), torch.tensor([0.02, 0.01])).item() == pytest.approx(1 + 1)


def height(metres: float, mixture: torch.Tensor = EVERYBODY) -> float:
    return terms.height(torch.tensor([math.log(metres)], dtype=torch.float64), mixture).item()


def test_height_by_hand_of_adults_alone():
    """One kind of people is a normal distribution: deviations squared."""
    log_heights = torch.tensor([LOG_MEAN, LOG_MEAN + 0.06, LOG_MEAN - 0.12], dtype=torch.float64)
    np.testing.assert_allclose(terms.height(log_heights, ADULTS), [0, 1, 4], atol=1e-12)


@given(st.floats(0.5, 3))
def test_height_by_hand_of_a_mixture(metres):
    weights = Weights()
    density = [
        share / sigma * math.exp(-0.5 * ((math.log(at) - mean) / sigma) ** 2)
        for at in (metres, weights.height_mean_m)
        for share, mean, sigma in weights.statures()
    ]
    expected = -2 * math.log((density[0] + density[1]) / (density[2] + density[3]))
    assert height(metres) == pytest.approx(expected, abs=1e-9)


def test_an_average_adult_is_the_likeliest_person():
    metres = np.linspace(0.8, 2.2, 1401)
    costs = [height(x) for x in metres]
    assert metres[np.argmin(costs)] == pytest.approx(Weights().height_mean_m, abs=0.005)
    assert height(Weights().height_mean_m) == pytest.approx(0, abs=1e-12)


@given(st.floats(1.05, 3))
def test_a_child_is_believed_sooner_than_a_giant(factor):
    assert height(1.65 * factor) > height(1.65 / factor) > -0.01


def test_giants_cost_with_the_square_and_children_little():
    assert height(2.2) > 12
    assert height(1.2) < 5.5
    assert height(1.0) < 7


def test_the_share_of_children_is_what_makes_them_likely():
    few = torch.tensor(Weights(child_share=0.02).statures(), dtype=torch.float64)
    assert height(1.2, few) - height(1.2) == pytest.approx(2 * math.log(0.2 / 0.02 * 0.98 / 0.8), abs=0.15)


@pytest.mark.parametrize("metres", [1e-6, 0.01, 0.3, 4.0, 100.0, 1e6])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_absurd_statures_are_finite_and_are_drawn_home(metres, dtype):
    log_height = torch.tensor([math.log(metres)], dtype=dtype)
    assert torch.isfinite(terms.height(log_height, EVERYBODY.to(dtype))).all()
    slope = pull(lambda x: terms.height(x, EVERYBODY.to(dtype)).sum(), log_height).item()
    assert math.isfinite(slope)
    assert math.copysign(1, slope) == (1 if metres > 1.65 else -1)


def test_the_price_of_height_has_no_step():
    """Where the mixture's densities vanish, its widest part's logarithm goes on."""
    logs = torch.linspace(math.log(0.05), math.log(30), 20001, dtype=torch.float64)
    steps = terms.height(logs, EVERYBODY).diff().abs()
    assert steps.max().item() < 0.5


def test_heights_gradient():
    log_heights = torch.log(torch.tensor([0.2, 0.9, 1.2, 1.45, 1.65, 1.8, 2.5], dtype=torch.float64)).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: terms.height(x, EVERYBODY), (log_heights,), eps=1e-7, rtol=1e-4)


def test_everybody_is_judged_alone():
    log_heights = torch.log(torch.tensor([1.1, 1.7], dtype=torch.float64))
    both = terms.height(log_heights, EVERYBODY)
    assert both.shape == (2,)
    assert both[0].item() == pytest.approx(height(1.1))


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
    assert energy.item() == pytest.approx(1)


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
    "name", ["joints", "smpl", "shape", "stature", "depth", "speed", "acceleration", "slip", "temporal", "silhouette",
             "collision"],
)  # fmt: skip
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


def test_silhouette_by_hand():
    # Half of the outline stands one deviation of 2 % of 200 pixels off, the other half where it should.
    along = torch.tensor([[[104.0, 50.0]]], dtype=torch.float64)
    target = torch.tensor([[[100.0, 50.0]]], dtype=torch.float64)
    half = torch.full((1, 1, 2), 0.5, dtype=torch.float64)
    sigma = torch.tensor([[4.0]], dtype=torch.float64)
    assert terms.silhouette(along, target, half, sigma).item() == pytest.approx(0.5 * ONE_DEVIATION)


def test_an_outline_without_evidence_is_not_drawn():
    shares = SHARES.clone()
    shares[0, 1, 3] = 0
    gradient = pull(lambda x: terms.silhouette(x, EDGES, shares, 0.02 * SIZES), EDGES + 3)
    assert gradient[0, 1, 3] == 0
    assert (gradient[shares > 0] > 0).all()


def test_outlines_of_far_and_near_people_cost_alike():
    far = terms.silhouette(EDGES + 1, EDGES, SHARES, torch.full((PEOPLE, FRAMES), 2.0))
    near = terms.silhouette(EDGES + 10, EDGES, SHARES, torch.full((PEOPLE, FRAMES), 20.0))
    assert far.item() == pytest.approx(near.item())


def test_collision_by_hand():
    # Apart costs nothing; one deviation deep a half, two deviations four fifths, far deeper hardly more than one.
    overlap = torch.tensor([[[-1.0, 0.05, 0.10, 50.0]]], dtype=torch.float64)
    assert terms.collision(overlap, 0.05).item() == pytest.approx(0.5 + 0.8 + 1, abs=1e-5)


def test_collision_pulls_gently_and_only_what_overlaps():
    overlap = torch.tensor([[[-0.1, 0.0, 0.02, 5.0]]], dtype=torch.float64)
    gradient = pull(lambda x: terms.collision(x, 0.05), overlap)[0, 0]
    assert gradient[0] == gradient[1] == 0
    assert gradient[2] > 0
    assert 0 < gradient[3] < 1e-3 * gradient[2]
