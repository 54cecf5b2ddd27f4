"""Levenberg-Marquardt on whole clips."""

from dataclasses import fields, replace

import numpy as np
import pytest
import torch

from core_solver.energy.weights import Weights
from core_solver.optimise import second_order
from core_solver.optimise.second_order import Schedule, minimise
from core_solver.optimise.variables import Variables, pose_points
from tests.solver.optimise.problems import Problem, disturbed, disturbed_alike, only, total
from tests.solver.scenes import Walker, make_clip

FRAMES = 6


@pytest.fixture(scope="module")
def clip(body):
    return make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=FRAMES, noise_px=0)


@pytest.fixture
def problem(clip, body):
    made = Problem(clip, body)
    made.look()
    return made


def unit_joints(problem: Problem, v: Variables) -> np.ndarray:
    joints = pose_points(v, problem.solver_body).joints.numpy()
    return joints / np.exp(v.log_scale.numpy())[:, None, None, None]


class Watch:
    """Records the energy before each iteration, as `look` is called."""

    def __init__(self, energy) -> None:
        self.energy, self.values = energy, []

    def __call__(self, v: Variables) -> None:
        self.values.append(self.energy.value(v))


def test_the_energy_never_rises(problem):
    watch = Watch(problem.energy)
    start = disturbed(problem.variables, 0.1, 0.1)
    found = minimise(problem.energy, start, Schedule(8, 0.0), watch)
    values = [*watch.values, problem.energy.value(found)]
    assert values[0] == problem.energy.value(start)
    assert (np.diff(values) <= 1e-9 * values[0]).all()
    assert values[-1] < 0.75 * values[0]


def test_the_truth_of_a_clip_without_noise(clip, body):
    """Reprojection and pose are zero at the truth: a few iterations find it to all digits."""
    problem = Problem(clip, body, only("joints", "smpl", "betas"))
    problem.energy.given = replace(
        problem.energy.given,
        pixels=problem.energy.project(problem.variables, pose_points(problem.variables, problem.solver_body).keypoints),
    )
    found = minimise(problem.energy, disturbed(problem.variables, 0.1, 0.1), Schedule(15, 0.0))
    assert problem.energy.value(found) < 1e-6
    truth = unit_joints(problem, problem.variables)
    assert np.abs(unit_joints(problem, found) - truth).max() < 1e-4
    assert torch.allclose(found.betas, problem.variables.betas, atol=1e-3)


def test_all_terms_together_come_close_to_the_truth(problem):
    start = disturbed_alike(problem.variables)
    found = minimise(problem.energy, start, Schedule(10, 1e-4))
    truth = unit_joints(problem, problem.variables)

    def error(v: Variables) -> float:
        return float(np.linalg.norm(unit_joints(problem, v) - truth, axis=-1).mean())

    assert error(found) < 0.3 * error(start)


def test_a_trembling_start_is_calmed(problem):
    """Velocities of such a start are off by several metres a second."""
    start = disturbed(problem.variables)
    found = minimise(problem.energy, start, Schedule(15, 1e-4))
    assert problem.energy.value(found) < 0.05 * problem.energy.value(start)


def test_only_what_terms_see_moves(clip, body):
    problem = Problem(clip, body, only("joints", "smpl", "betas"))
    found = minimise(problem.energy, disturbed(problem.variables), Schedule(3, 0.0))
    for name in ("log_scale", "ground", "log_focal", "log_inverse_far", "log_inverse_gap", "log_range"):
        assert torch.equal(getattr(found, name), getattr(problem.variables, name)), name
    assert not torch.equal(found.theta, problem.variables.theta)


def test_the_gradient_is_that_of_the_whole_energy(problem, monkeypatch):
    seen = {}

    def reduce(curvature, frames, own, damping):
        seen.setdefault("people", []).append((frames, own))
        return true_reduce(curvature, frames, own, damping)

    def solve(people, shared_curvature, shared):
        seen.setdefault("shared", shared)
        return true_solve(people, shared_curvature, shared)

    true_reduce, true_solve = second_order.reduce_person, second_order.solve_border
    monkeypatch.setattr(second_order, "reduce_person", reduce)
    monkeypatch.setattr(second_order, "solve_border", solve)
    # The depth range is solved for beforehand: what the gradient is taken at is where it then stands.
    v = second_order.fit_depth_range(problem.energy, disturbed(problem.variables))
    monkeypatch.setattr(second_order, "fit_depth_range", lambda _energy, x: x)
    minimise(problem.energy, v, Schedule(1, 0.0))
    leaves = v.leaves()
    total(problem.energy, leaves).backward()
    frames = torch.cat([leaves.theta.grad.flatten(2), leaves.translation.grad], -1).numpy() / 2
    own = torch.cat([leaves.log_scale.grad[:, None], leaves.betas.grad], -1).numpy() / 2
    for n in range(2):
        matches = [
            np.allclose(f, frames[n], rtol=1e-9, atol=1e-9 * np.abs(frames).max())
            and np.allclose(o, own[n], rtol=1e-9, atol=1e-9 * np.abs(own).max())
            for f, o in seen["people"]
        ]
        assert any(matches), n
    np.testing.assert_allclose(seen["shared"][:3], leaves.ground.grad.numpy() / 2, rtol=1e-9)


@pytest.mark.parametrize(("tolerance", "expected"), [(0.0, 6), (1.0, 1)])
def test_it_stops_by_tolerance_and_tells_of_all_iterations(problem, tolerance, expected):
    watch, told = Watch(problem.energy), []
    minimise(problem.energy, disturbed_alike(problem.variables), Schedule(6, tolerance), watch, told.append)
    assert len(watch.values) == expected
    assert sum(told) == 6
    assert all(step >= 0 for step in told)


def test_no_iterations_change_nothing(problem):
    v = disturbed(problem.variables)
    assert minimise(problem.energy, v, Schedule(0, 0.0)) is v


def test_two_runs_are_equal_bit_by_bit(problem):
    first, second = (minimise(problem.energy, disturbed(problem.variables), Schedule(3, 0.0)) for _ in range(2))
    for field in fields(Variables):
        assert torch.equal(getattr(first, field.name), getattr(second, field.name)), field.name


def test_the_order_of_people_changes_nothing(clip, body):
    """Everybody's frames are eliminated alone: the crowd's order is only an order."""
    walkers = [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)]
    forth = Problem(clip, body)
    back = Problem(make_clip(body, walkers[::-1], frames=FRAMES, noise_px=0), body)
    results = []
    for problem, order in ((forth, [0, 1]), (back, [1, 0])):
        start = disturbed_alike(forth.variables)
        start = replace(start, **{
            name: getattr(start, name)[order] for name in ("theta", "translation", "betas", "log_scale")
        })  # fmt: skip
        # The walk's phase goes with the place in the list: the second clip is only asked about the first one's people.
        given = forth.energy.given
        problem.energy.given = replace(given, **{
            name: getattr(given, name)[order]
            for name in ("pixels", "confidence", "size", "valid", "theta_hat", "theta_trust", "betas_hat", "per_clip")
        })  # fmt: skip
        found = minimise(problem.energy, start, Schedule(4, 0.0))
        results.append(found.theta[order].numpy())
    np.testing.assert_allclose(results[0], results[1], atol=1e-3)


def test_an_energy_that_is_no_number_leaves_everything_where_it_was(clip, body):
    """Evidence is made finite before it comes here; should that fail, the answer is still one of numbers."""
    problem = Problem(clip, body, only("joints", "smpl", "betas", "speed", "acceleration"))
    pixels = problem.energy.given.pixels.clone()
    pixels[0, 2] = torch.nan
    problem.energy.given = replace(problem.energy.given, pixels=pixels)
    start = disturbed(problem.variables)
    found = minimise(problem.energy, start, Schedule(3, 0.0))
    for field in fields(Variables):
        assert torch.equal(getattr(found, field.name), getattr(start, field.name)), field.name


@pytest.mark.parametrize("frames", [1, 2])
def test_one_and_two_frames(body, frames):
    problem = Problem(make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=frames, noise_px=0), body)
    problem.look()
    start = disturbed_alike(problem.variables)
    found = minimise(problem.energy, start, Schedule(6, 1e-4))
    assert problem.energy.value(found) < 0.2 * problem.energy.value(start)


def test_an_unknown_focal_length_is_found(body):
    """Two people of known pose at different distances tell how long the lens is, as far as its prior lets them."""
    clip = make_clip(body, [Walker(1.0, (-0.8, 3), 0.5), Walker(1.0, (1, 6), -1.0)], frames=3, noise_px=0)
    problem = Problem(clip, body, replace(only("joints", "smpl", "betas"), focal_sigma=0.3, theta_sigma=0.01))
    start = problem.changed(log_focal=torch.tensor(0.15, dtype=torch.float64))
    found = minimise(problem.energy, start, Schedule(15, 0.0))
    assert abs(found.log_focal.item()) < 0.02
    assert Weights().focal_sigma == 0  # by default it is believed
