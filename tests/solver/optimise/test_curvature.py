"""Curvature against automatic second derivatives, where Gauss-Newton is exact: all residuals vanish.

Everybody keeps still, and what the energies compare with is set to where the body is. Half the Hessian is then J^T J.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from core_solver.optimise.curvature import BORDER, FRAME, OWN, Curvature, person_curvature
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.picture_terms import contour_points
from core_solver.optimise.variables import Variables, pose_person
from tests.solver.optimise.problems import SWITCHES, Problem, only, unit_points
from tests.solver.scenes import Walker, make_clip

FRAMES, PERSON = 3, 1
STATURE = 1.70  # of the body at unit scale
# Collisions have no curvature: they act through the gradient alone.
CURVED = tuple(name for name in SWITCHES if name != "collision")
JUST_BELOW_M = 1e-6


@dataclass(frozen=True)
class Optimum:
    """A clip in which every term of PERSON has what it wants."""

    problem: Problem
    variables: Variables

    def energy(self, *terms: str, **changes: float) -> JointEnergy:
        # A single kind of people, a focal length that is asked for, and no collisions.
        weights = only(*terms, focal_sigma=0.1, child_share=1e-12, **changes)
        energy = self.problem.energy_with(weights)
        energy.given, energy.motion = self.problem.energy.given, self.problem.energy.motion
        return energy


@pytest.fixture(scope="module")
def optimum(body):
    clip = make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (0.5, 6), -1.0)], frames=FRAMES, noise_px=0)
    problem = Problem(clip, body)
    problem.look()
    rng = np.random.default_rng(0)
    # A pose without symmetry, so that no two sole points are equally low.
    still = problem.variables.theta[:, :1] + 0.15 * torch.as_tensor(rng.normal(size=(2, 1, 24, 3)))
    v = problem.changed(
        theta=still.expand(-1, FRAMES, -1, -1).clone(),
        translation=problem.variables.translation[:, :1].expand(-1, FRAMES, -1).clone(),
        # The ground's tilts are taken as small: their rows are exact where they are zero.
        ground=torch.tensor([0.0, 0.0, 0.03], dtype=torch.float64),
        log_scale=problem.variables.log_scale.new_full((2,), math.log(problem.weights.height_mean_m / STATURE)),
    )
    energy = problem.energy
    energy.given = replace(
        energy.given,
        theta_hat=v.theta,
        pixels=energy.project(v, unit_points(v, energy)[:, :, :25]),
        # Evidence of every strength, and uneven frames.
        confidence=torch.as_tensor(rng.uniform(0, 1, (2, FRAMES, 25))),
        seconds=torch.tensor([0.04, 0.08], dtype=torch.float64),
    )
    _please(problem, v, rng)
    return Optimum(problem, v)


def _please(problem: Problem, v: Variables, rng: np.random.Generator) -> None:
    """Put supports, contours and depths where the bodies are."""
    energy, picture = problem.energy, problem.energy.motion.picture
    assert picture is not None
    assert picture.contours is not None
    with torch.no_grad():
        posed = [pose_person(v, n, energy.body) for n in range(2)]
        lowest = torch.cat([energy.sole_heights(v, n, p).amin(-1) for n, p in enumerate(posed)])
        samples = torch.cat([contour_points(picture.contours, energy.body, v, n, p) for n, p in enumerate(posed)])
        along = torch.gather(energy.project(v, samples), -1, picture.contours.axis[..., None])[..., 0]
    depth = replace(
        picture.depth, at=v, scene=picture.depth.body, weight=torch.as_tensor(rng.uniform(0.2, 1, (2, FRAMES)))
    )
    energy.look(
        support=lowest + JUST_BELOW_M,
        contacts=torch.as_tensor(rng.uniform(0.2, 1, (2, FRAMES, 2))),
        filtered=unit_points(v, energy),
        picture=replace(picture, depth=depth, contours=replace(picture.contours, target=along)),
    )


def unknowns(v: Variables) -> torch.Tensor:
    """PERSON's unknowns in the order of `Curvature`, flat."""
    frames = torch.cat([v.theta[PERSON].flatten(1), v.translation[PERSON]], -1).flatten()
    return torch.cat([frames, v.log_scale[PERSON : PERSON + 1], v.betas[PERSON], v.ground, v.log_focal[None]])


def with_unknowns(v: Variables, x: torch.Tensor) -> Variables:
    frames = x[: FRAMES * FRAME].reshape(FRAMES, FRAME)
    border = x[FRAMES * FRAME :]

    def put(values: torch.Tensor, mine: torch.Tensor) -> torch.Tensor:
        return torch.stack([mine if n == PERSON else row for n, row in enumerate(values)])

    return replace(
        v,
        theta=put(v.theta, frames[:, :-3].reshape(FRAMES, 24, 3)),
        translation=put(v.translation, frames[:, -3:]),
        log_scale=put(v.log_scale, border[0]),
        betas=put(v.betas, border[1:OWN]),
        ground=border[OWN:-1],
        log_focal=border[-1],
    )


def dense(curvature: Curvature) -> np.ndarray:
    """The symmetric matrix whose blocks a `Curvature` holds."""
    inner = FRAMES * FRAME
    matrix = np.zeros((inner + BORDER, inner + BORDER))
    for t in range(FRAMES):
        here = slice(t * FRAME, (t + 1) * FRAME)
        matrix[here, here] = curvature.blocks[t]
        matrix[here, inner:] = curvature.sides[t]
        matrix[inner:, here] = curvature.sides[t].T
        if t + 1 < FRAMES:
            there = slice((t + 1) * FRAME, (t + 2) * FRAME)
            matrix[there, here] = curvature.next[t]
            matrix[here, there] = curvature.next[t].T
        if t + 2 < FRAMES:
            for axis in range(FRAME - 3, FRAME):
                row, column = (t + 2) * FRAME + axis, t * FRAME + axis
                matrix[row, column] = matrix[column, row] = curvature.after_next[t]
    matrix[inner:, inner:] = curvature.corner
    return matrix


def second_derivative(energy: JointEnergy, v: Variables, directions: np.ndarray) -> np.ndarray:
    """Half the Hessian of PERSON's energy times directions (K, D)."""
    x = unknowns(v).requires_grad_()
    (slope,) = torch.autograd.grad(energy.person(with_unknowns(v, x), PERSON), x, create_graph=True)
    if not slope.requires_grad:
        return np.zeros_like(directions)
    rows = [
        torch.autograd.grad(slope, x, torch.as_tensor(d), retain_graph=True, materialize_grads=True)[0]
        for d in directions
    ]
    return torch.stack(rows).numpy() / 2


def assert_same(found: np.ndarray, truth: np.ndarray, rtol: float = 1e-4) -> None:
    np.testing.assert_allclose(found, truth, atol=rtol * np.abs(truth).max(), rtol=rtol)


@pytest.mark.parametrize("term", CURVED)
def test_each_terms_curvature_is_half_its_second_derivative(optimum, term):
    """A matrix that agrees in random directions agrees in every entry."""
    energy = optimum.energy(term)
    directions = np.random.default_rng(1).normal(size=(4, FRAMES * FRAME + BORDER))
    truth = second_derivative(energy, optimum.variables, directions)
    assert np.abs(truth).max() > 0
    assert_same(directions @ dense(person_curvature(energy, optimum.variables, PERSON)), truth)


def test_every_block_of_the_whole(optimum):
    energy = optimum.energy(*CURVED)
    size = FRAMES * FRAME + BORDER
    truth = second_derivative(energy, optimum.variables, np.eye(size))
    found = dense(person_curvature(energy, optimum.variables, PERSON))
    blocks = [slice(t * FRAME, (t + 1) * FRAME) for t in range(FRAMES)] + [slice(FRAMES * FRAME, size)]
    for rows in blocks:
        for columns in blocks:
            assert_same(found[rows, columns], truth[rows, columns], 1e-3)


def test_temporal_of_a_moving_body(optimum):
    rng = np.random.default_rng(5)
    v = optimum.variables
    v = replace(v, theta=v.theta + 0.2 * torch.as_tensor(rng.normal(size=v.theta.shape)))
    energy = optimum.energy("temporal")
    energy.look(filtered=unit_points(v, energy))
    directions = rng.normal(size=(4, FRAMES * FRAME + BORDER))
    truth = second_derivative(energy, v, directions)
    assert_same(directions @ dense(person_curvature(energy, v, PERSON)), truth)


def test_what_is_switched_off_bends_nothing(optimum):
    curvature = person_curvature(optimum.energy(), optimum.variables, PERSON)
    for name in Curvature.__dataclass_fields__:
        assert (getattr(curvature, name) == 0).all(), name


def test_an_unknown_focal_length_alone_has_a_column(optimum):
    fixed = person_curvature(optimum.energy("joints", "silhouette"), optimum.variables, PERSON)
    assert (fixed.corner[-1, -1] > 0).all()
    known = optimum.energy("joints", "silhouette")
    known.weights = replace(known.weights, focal_sigma=0.0)
    without = person_curvature(known, optimum.variables, PERSON)
    assert (without.sides[..., -1] == 0).all()
    assert (without.corner[-1] == 0).all()


@pytest.mark.parametrize("term", ["joints", "smpl", "contact", "acceleration", "silhouette", "slip"])
def test_outliers_bend_less(optimum, term):
    """Robust kernels flatten: far from the optimum no curvature is larger than at it."""
    energy, v = optimum.energy(term), optimum.variables
    rng = np.random.default_rng(2)
    far = replace(
        v,
        theta=v.theta + 0.1 * torch.as_tensor(rng.normal(size=v.theta.shape)),
        translation=v.translation + 0.1 * torch.as_tensor(rng.normal(size=v.translation.shape)),
    )
    near, away = (person_curvature(energy, x, PERSON).blocks.diagonal(dim1=1, dim2=2).sum() for x in (v, far))
    assert 0 < away < near


def test_every_curvature_is_positive_far_from_the_optimum_too(optimum):
    v = optimum.variables
    rng = np.random.default_rng(3)
    far = replace(
        v,
        theta=v.theta + 0.3 * torch.as_tensor(rng.normal(size=v.theta.shape)),
        translation=v.translation + 0.3 * torch.as_tensor(rng.normal(size=v.translation.shape)),
        betas=v.betas + torch.as_tensor(rng.normal(size=v.betas.shape)),
        log_scale=v.log_scale - 0.5,
    )
    matrix = dense(person_curvature(optimum.energy(*CURVED), far, PERSON))
    assert np.linalg.eigvalsh(matrix).min() > -1e-9 * np.abs(matrix).max()
