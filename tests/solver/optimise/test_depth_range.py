"""The depth range in closed form against a general optimiser on the same energy."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.optimize import minimize

from core_solver.optimise.depth_range import fit_depth_range
from core_solver.optimise.variables import Variables
from tests.solver.optimise.problems import FAR, GAP, Problem, only, total
from tests.solver.scenes import Walker, make_clip

FRAMES = 3
RANGE = ("log_inverse_far", "log_inverse_gap", "log_range")


@pytest.fixture(scope="module")
def clip(body):
    walkers = [Walker(1.0, (-1, 4), 0.5), Walker(0.9, (1, 6), -1.0), Walker(1.0, (2, 9), 0.0)]
    return make_clip(body, walkers, frames=FRAMES, noise_px=0)


@pytest.fixture
def problem(clip, body):
    made = Problem(clip, body, only("depth"))
    made.look()
    return made


def shifted(problem: Problem, far: float, gap: float, jitter: float = 0.0) -> Variables:
    """A wrong range of the clip, and frames about it."""
    noise = jitter * torch.randn(2, FRAMES, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    v = problem.variables
    return replace(
        v,
        log_inverse_far=v.log_inverse_far + far + noise[0],
        log_inverse_gap=v.log_inverse_gap + gap + noise[1],
        log_range=v.log_range + torch.tensor([far, gap], dtype=torch.float64),
    )


def by_scipy(problem: Problem, v: Variables) -> float:
    """The least energy over the ranges that a quasi-Newton method finds."""

    def put(x: np.ndarray) -> Variables:
        x = torch.as_tensor(x)
        return replace(v, log_inverse_far=x[:FRAMES], log_inverse_gap=x[FRAMES:-2], log_range=x[-2:])

    def value(x: np.ndarray) -> tuple[float, np.ndarray]:
        leaves = put(x).leaves()
        energy = total(problem.energy, leaves)
        energy.backward()
        return energy.item(), torch.cat([getattr(leaves, name).grad for name in RANGE]).numpy()

    start = torch.cat([getattr(v, name) for name in RANGE]).numpy()
    return float(minimize(value, start, jac=True, method="BFGS", options={"gtol": 1e-9, "maxiter": 2000}).fun)


@pytest.mark.parametrize("weights", [(1.0, 0.1, 0.0), (0.3, 0.3, 1.0)])
def test_the_least_energy_of_a_general_optimiser(problem, weights):
    picture = problem.picture
    trust = picture.depth.weight * torch.tensor(weights, dtype=torch.float64)[:, None]
    problem.energy.look(picture=replace(picture, depth=replace(picture.depth, weight=trust)))
    v = shifted(problem, 0.5, -0.4, jitter=0.03)
    found = v
    # Its slight stiffness slows it along what people at these few distances hardly tell apart, and does not stop it.
    for _ in range(60):
        found = fit_depth_range(problem.energy, found)
    best = by_scipy(problem, v)
    assert problem.energy.value(found) < problem.energy.value(v)
    assert problem.energy.value(found) == pytest.approx(best, abs=1e-3)


def test_the_true_range_is_found_again(problem):
    v = shifted(problem, 0.3, 0.3)
    for _ in range(10):
        v = fit_depth_range(problem.energy, v)
        problem.look(v)
    truth = [np.log(FAR), np.log(GAP)]
    depths = [1 / (np.exp(r[0]) + np.exp(r[1]) * np.array([0.2, 0.4])) for r in (v.log_range.numpy(), np.array(truth))]
    np.testing.assert_allclose(depths[0], depths[1], rtol=0.05)


def test_the_energy_does_not_rise(problem):
    v = shifted(problem, -0.5, 0.6, jitter=0.1)
    values = [problem.energy.value(v)]
    for _ in range(4):
        v = fit_depth_range(problem.energy, v)
        values.append(problem.energy.value(v))
    assert (np.diff(values) <= 1e-9).all()


def test_the_clips_range_moves_with_its_frames(problem):
    """What all frames ask for is the clip's error, not every frame's jitter."""
    depth = problem.picture.depth
    wished = depth.scene_rows @ torch.tensor([0.0, 0.4], dtype=torch.float64)
    # Bodies stand where another gap would put the depth map.
    moved = replace(depth, body=depth.scene + wished)
    problem.energy.look(picture=replace(problem.picture, depth=moved))
    v = problem.variables
    for _ in range(20):
        v = fit_depth_range(problem.energy, v)
    assert v.log_range[1].item() - problem.variables.log_range[1].item() == pytest.approx(0.4, abs=0.03)
    np.testing.assert_allclose(v.log_inverse_gap, v.log_range[1].expand(FRAMES), atol=0.01)


def test_one_jittering_frame_moves_most(problem):
    depth = problem.picture.depth
    only_first = torch.zeros(FRAMES, dtype=torch.float64)
    only_first[0] = 0.1
    moved = replace(depth, body=depth.scene + depth.scene_rows[..., 1] * only_first)
    problem.energy.look(picture=replace(problem.picture, depth=moved))
    v = fit_depth_range(problem.energy, problem.variables)
    change = (v.log_inverse_gap - problem.variables.log_inverse_gap).abs()
    assert change[0] > 1.2 * change[1:].max()
    assert change[1:].max() < 0.03


@pytest.mark.parametrize("silent", ["no look", "no term", "no mask"])
def test_without_evidence_the_range_stays(problem, silent):
    v = shifted(problem, 0.2, 0.1)
    if silent == "no look":
        problem.energy.look(picture=None)
    elif silent == "no term":
        problem.energy.weights = replace(problem.energy.weights, depth=0.0)
    else:
        picture = problem.picture
        blind = replace(picture.depth, weight=torch.zeros_like(picture.depth.weight))
        problem.energy.look(picture=replace(picture, depth=blind))
    found = fit_depth_range(problem.energy, v)
    for name in RANGE:
        torch.testing.assert_close(getattr(found, name), getattr(v, name), atol=1e-12, rtol=0)


def test_one_frame_of_one_person(body):
    problem = Problem(make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=1, noise_px=0), body, only("depth"))
    problem.look()
    v = problem.variables
    wrong = replace(v, log_inverse_far=v.log_inverse_far + 0.5, log_range=v.log_range + 0.2)
    found = fit_depth_range(problem.energy, wrong)
    assert all(torch.isfinite(getattr(found, name)).all() for name in RANGE)
    assert problem.energy.value(found) < problem.energy.value(wrong)
