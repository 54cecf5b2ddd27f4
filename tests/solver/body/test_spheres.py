"""Spheres that stand for a body, and the collisions the solver finds with them."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from core_solver.body.skeleton import joint_index
from core_solver.body.spheres import body_spheres
from core_solver.energy import terms
from core_solver.energy.weights import Weights
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.variables import Variables, pose_person
from tests.solver.body.synthetic import make_stick_body
from tests.solver.optimise.problems import Problem, only
from tests.solver.scenes import Walker, make_clip

SIDES = (
    ("hip", "knee", 3), ("knee", "ankle", 3), ("shoulder", "elbow", 2), ("elbow", "wrist", 2), ("wrist", "hand", 1),
)  # fmt: skip
COUNT = 4 + 2 * sum(count for _, _, count in SIDES)


@pytest.fixture(scope="module")
def body():
    return make_stick_body()


@pytest.fixture(scope="module")
def spheres(body):
    return body_spheres(body)


# --- The spheres ------------------------------------------------------------------------------------------------------


def test_two_dozen_spheres_each_on_one_bone(spheres):
    assert spheres.template.shape == (COUNT, 3)
    assert spheres.directions.shape == (COUNT, 3, 10)
    assert spheres.radii.shape == (COUNT,)
    assert (spheres.weights.sum(axis=1) == 1).all()
    assert ((spheres.weights == 0) | (spheres.weights == 1)).all()


def test_a_thighs_spheres_by_hand(body, spheres):
    """Three spheres at a sixth, a half and five sixths of the way from hip to knee, carried by the hip."""
    hip, knee = joint_index("left_hip"), joint_index("left_knee")
    mine = np.flatnonzero(spheres.weights[:, hip] == 1)
    joints = body.joint_template
    expected = [joints[hip] + share * (joints[knee] - joints[hip]) for share in (1 / 6, 1 / 2, 5 / 6)]
    np.testing.assert_allclose(spheres.template[mine], expected, atol=1e-12)
    # All vertices are corners of rings of 14 by 16 cm around the bone.
    assert (spheres.radii[mine] == spheres.radii[mine][0]).all()
    assert spheres.radii[mine][0] == pytest.approx(math.hypot(0.07, 0.08), abs=0.01)


def test_spheres_grow_with_the_body(body, spheres):
    betas = np.zeros(10)
    betas[0] = 2.0
    joints = body.rest_joints(betas)
    hip, knee = joint_index("right_hip"), joint_index("right_knee")
    mine = np.flatnonzero(spheres.weights[:, hip] == 1)
    middle = (spheres.template + spheres.directions @ betas)[mine][1]
    np.testing.assert_allclose(middle, (joints[hip] + joints[knee]) / 2, atol=1e-12)


def test_left_and_right_are_alike(spheres):
    for side, other in (("left", "right"), ("right", "left")):
        for joint in ("hip", "knee", "shoulder", "elbow", "wrist"):
            here, there = (np.flatnonzero(spheres.weights[:, joint_index(f"{s}_{joint}")]) for s in (side, other))
            np.testing.assert_allclose(
                spheres.template[here] * (-1, 1, 1), spheres.template[there], atol=1e-9, err_msg=joint
            )
            np.testing.assert_allclose(spheres.radii[here], spheres.radii[there], atol=1e-9)


def test_pairs_are_those_that_really_meet(spheres):
    """Forearms with the trunk, thighs with the other leg's; never neighbours on one limb, nor the upper arm's trunk."""
    owner = spheres.weights.argmax(axis=1)
    pairs = {tuple(sorted((owner[a], owner[b]))) for a, b in spheres.pairs}

    def meet(first: str, second: str) -> bool:
        return tuple(sorted((joint_index(first), joint_index(second)))) in pairs

    assert meet("left_elbow", "spine3")
    assert meet("left_wrist", "head") or meet("left_wrist", "neck")
    assert meet("left_elbow", "right_elbow")
    assert meet("left_elbow", "right_hip")
    assert not meet("left_hip", "left_knee")
    assert not meet("left_elbow", "left_wrist")
    assert not meet("left_shoulder", "spine3")
    assert not meet("left_hip", "pelvis")
    assert all(a < b for a, b in spheres.pairs)


def test_two_legs_must_not_meet(spheres):
    owner = spheres.weights.argmax(axis=1)
    pairs = {tuple(sorted((owner[a], owner[b]))) for a, b in spheres.pairs}
    for joint in ("hip", "knee"):
        assert (joint_index(f"left_{joint}"), joint_index(f"right_{joint}")) in pairs


def test_nobody_collides_with_themselves_in_a_t_pose(spheres):
    first, second = spheres.pairs.T
    apart = np.linalg.norm(spheres.template[first] - spheres.template[second], axis=1)
    assert (apart > spheres.radii[first] + spheres.radii[second]).all()


# --- The term ---------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def problem(body):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=2, noise_px=0)
    return Problem(clip, body, only("collision"))


def posed(problem: Problem, theta: torch.Tensor, places: list, scales=(1.0, 1.0)) -> Variables:
    """Both people in the same pose (24, 3) in both frames, at metric places."""
    place = torch.tensor(places, dtype=torch.float64)[:, None].expand(-1, 2, -1)
    scale = torch.tensor(scales, dtype=torch.float64)
    return replace(
        problem.variables,
        theta=theta.expand(2, 2, -1, -1).clone(),
        translation=place / scale[:, None, None],
        log_scale=torch.log(scale),
    )


def seen(problem: Problem, v: Variables) -> JointEnergy:
    """The energy after everybody was seen at these variables."""
    energy = problem.energy_with(problem.weights)
    with torch.no_grad():
        energy.look(spheres=torch.cat([energy.spheres(v, n, pose_person(v, n, energy.body)) for n in range(2)]))
    return energy


T_POSE = torch.zeros(24, 3, dtype=torch.float64)
FAR_APART = [[-2.0, 0, 5], [2.0, 0, 5]]


def test_spheres_stand_where_the_body_does(problem, body, spheres):
    v = posed(problem, T_POSE, FAR_APART, (1.0, 0.8))
    found = problem.energy.spheres(v, 1, pose_person(v, 1, problem.solver_body))[0, 0].numpy()
    np.testing.assert_allclose(found, 0.8 * spheres.template + (2, 0, 5), atol=1e-9)


def test_a_t_pose_alone_costs_nothing(problem):
    v = posed(problem, T_POSE, FAR_APART)
    assert seen(problem, v).value(v) == pytest.approx(0, abs=1e-12)


def test_an_arm_through_the_trunk_is_pushed_out(problem):
    theta = T_POSE.clone()
    # The left upper arm turns forwards across the chest, the forearm back through it.
    theta[joint_index("left_shoulder"), 1] = -1.2
    theta[joint_index("left_elbow"), 1] = -2.2
    v = posed(problem, theta, FAR_APART)
    energy = seen(problem, v)
    cost = energy.value(v)
    assert cost > 0.3
    leaves = v.leaves()
    energy.person(leaves, 0).backward()
    better = replace(v, theta=v.theta - 0.02 * leaves.theta.grad / leaves.theta.grad.norm())
    assert energy.value(better) < cost


def test_two_spheres_by_hand(problem, spheres):
    """Overlaps are sums of radii less distances."""
    # One stands on the other's head: only the lowest spheres of one are near the highest of the other.
    tall = np.ptp(spheres.template[:, 1])
    for gap in (-0.05, 0.02, 0.3):
        v = posed(problem, T_POSE, [[0.0, 0, 5], [0.0, tall + gap, 5.0]])
        reach = spheres.radii[:, None] + spheres.radii
        offset = spheres.template[:, None] - (spheres.template + np.array([0, tall + gap, 0]))
        overlap = torch.as_tensor(np.maximum(reach - np.linalg.norm(offset, axis=-1), 0))
        expected = 2 * 2 * terms.collision(overlap, Weights().collision_sigma).item()  # two people, two frames
        assert seen(problem, v).value(v) == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_two_bodies_in_one_place_are_pushed_apart(problem):
    v = posed(problem, T_POSE, [[-0.03, 0, 5], [0.03, 0, 5]])
    energy = seen(problem, v)
    assert energy.value(v) > 1
    pulls = []
    for n in range(2):
        leaves = v.leaves()
        energy.person(leaves, n).backward()
        pulls.append(leaves.translation.grad[n, 0].numpy())
    # Descent moves the left one to the left and the right one to the right, by as much.
    assert pulls[0][0] > 0 > pulls[1][0]
    np.testing.assert_allclose(pulls[0], -pulls[1], atol=1e-9)
    for _ in range(150):
        leaves = v.leaves()
        energy = seen(problem, v)
        torch.stack([energy.person(leaves, n) for n in range(2)]).sum().backward()
        v = replace(v, translation=v.translation - 0.002 * leaves.translation.grad)
    assert (v.translation[1] - v.translation[0])[:, 0].min() > 0.1


def test_exactly_one_place_is_finite(problem):
    v = posed(problem, T_POSE, [[0.0, 0, 5], [0.0, 0, 5]])
    energy = seen(problem, v)
    for n in range(2):
        leaves = v.leaves()
        value = energy.person(leaves, n)
        value.backward()
        assert math.isfinite(value.item())
        for name in ("theta", "translation", "log_scale", "betas"):
            assert torch.isfinite(getattr(leaves, name).grad).all(), name


def test_people_apart_do_not_feel_each_other(problem):
    v = posed(problem, T_POSE, FAR_APART)
    leaves = v.leaves()
    seen(problem, v).person(leaves, 0).backward()
    assert (leaves.translation.grad == 0).all()


def test_it_costs_the_same_either_way_round(problem):
    """One's overlap with the other is the other's with the first."""
    theta = 0.3 * torch.randn(24, 3, generator=torch.Generator().manual_seed(1), dtype=torch.float64)
    places, scales = [[-0.1, 0.05, 5], [0.15, 0, 5.1]], (1.0, 0.8)
    forth, back = posed(problem, theta, places, scales), posed(problem, theta, places[::-1], scales[::-1])
    costs = []
    for v in (forth, back):
        energy = seen(problem, v)
        costs.append([float(energy.person(v, n)) for n in range(2)])
    assert costs[0] == pytest.approx(costs[1][::-1], rel=1e-9)


def test_gradient(problem):
    theta = 0.5 * torch.randn(24, 3, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    v = posed(problem, theta, [[-0.2, 0, 5], [0.2, 0.1, 5]])
    energy = seen(problem, v)
    leaves = v.leaves()
    energy.person(leaves, 0).backward()
    rng = np.random.default_rng(0)
    for name in ("theta", "translation", "betas"):
        direction = torch.as_tensor(rng.normal(size=getattr(v, name).shape))
        values = [
            float(energy.person(replace(v, **{name: getattr(v, name) + step * direction}), 0)) for step in (1e-6, -1e-6)
        ]
        slope = (values[0] - values[1]) / 2e-6
        assert float((getattr(leaves, name).grad * direction).sum()) == pytest.approx(slope, rel=1e-4, abs=1e-6), name


def test_single_precision_far_away_keeps_its_digits(problem):
    """Distances of people at 40 m are at most differences of small enough squares."""
    theta = 0.3 * torch.randn(24, 3, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    v = posed(problem, theta, [[-0.1, 0, 40], [0.15, 0, 40.1]])
    exact = seen(problem, v)
    spheres = exact.motion.spheres
    assert spheres is not None
    others = torch.cdist(spheres[:1], spheres[1:])
    rounded = torch.cdist(spheres[:1].float(), spheres[1:].float())
    assert (rounded - others).abs().max().item() < 5e-3
