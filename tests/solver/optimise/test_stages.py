import math
from dataclasses import fields

import numpy as np
import pytest
import torch

from core_solver.energy.weights import Weights
from core_solver.optimise.evidence import gather_evidence
from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import torch_body
from core_solver.optimise.scale_ground import ScaleGround
from core_solver.optimise.solve import sole_rows
from core_solver.optimise.stages import JointEnergy, Variables, pose_points, run_stage, start_variables
from core_solver.scene.sampling import sample_bodies
from tests.solver.scenes import SyntheticClip, Walker, make_clip

FAR, GAP = 1 / 30, 1 / 1.5 - 1 / 30  # the synthetic disparity's true range


class Problem:
    """A clip at its truth, as the stages see it."""

    def __init__(self, clip: SyntheticClip, body, weights: Weights | None = None):
        self.clip, weights = clip, weights or Weights()
        self.solver_body = torch_body(body, torch.as_tensor(sole_rows(body)), torch.device("cpu"), torch.float64)
        self.fit = PoseFit(clip.theta, clip.gamma / clip.scales[:, None, None], np.zeros((len(clip.scales), 10)))
        self.ground = ScaleGround(clip.scales, clip.up, clip.camera_height, np.zeros(len(clip.scales)), FAR, GAP)
        evidence = gather_evidence(clip.modalities, clip.camera)
        heights = np.array([body.height(b) for b in self.fit.betas])
        self.energy = JointEnergy(evidence, self.fit, self.ground, clip.camera, self.solver_body, heights, weights)
        self.variables = start_variables(self.fit, self.ground, self.solver_body)
        points = pose_points(self.variables, self.solver_body)
        self.evidence, self.proxy = evidence, points.proxy.numpy()
        self.depth = sample_bodies(self.proxy, evidence.valid, clip.modalities, clip.camera)

    def changed(self, **changes: torch.Tensor) -> Variables:
        return Variables(**{**vars(self.variables), **changes})


@pytest.fixture(scope="module")
def clip(body):
    return make_clip(body, [Walker(1.0, (-1, 5), 0.5), Walker(0.9, (1, 6), -1.0)], frames=8, noise_px=0)


@pytest.fixture
def problem(clip, body):
    return Problem(clip, body)


def test_points_at_the_start_are_the_true_people(problem, body):
    np.testing.assert_allclose(problem.proxy, problem.clip.vertices[:, :, body.proxy], atol=1e-9)
    joints = pose_points(problem.variables, problem.solver_body).joints.numpy()
    np.testing.assert_allclose(joints, problem.clip.joints, atol=1e-9)


def test_heights_are_measured_above_the_true_ground(problem):
    heights = problem.energy.sole_heights(torch.as_tensor(problem.proxy)).numpy()
    assert heights.min() == pytest.approx(0, abs=0.03)
    assert (heights.min(axis=-1) < 0.06).all()


def test_levels_are_added_to_a_persons_own_floor(clip, body):
    problem = Problem(clip, body)
    ground = ScaleGround(clip.scales, clip.up, clip.camera_height, np.array([0.0, 0.3]), FAR, GAP)
    heights = np.ones(2) * 1.7
    raised = JointEnergy(
        problem.evidence, problem.fit, ground, clip.camera, problem.solver_body, heights, Weights()
    ).sole_heights(torch.as_tensor(problem.proxy))
    flat = problem.energy.sole_heights(torch.as_tensor(problem.proxy))
    np.testing.assert_allclose((flat - raised).numpy()[0], 0, atol=1e-9)
    np.testing.assert_allclose((flat - raised).numpy()[1], 0.3, atol=1e-9)


def test_scale_moves_people_along_their_rays_and_leaves_the_picture(problem):
    """The valley of scale against depth is no valley in these variables."""
    before = problem.energy.stage_one(problem.variables)
    taller = problem.changed(log_scale=problem.variables.log_scale + 0.1)
    points, old = (pose_points(v, problem.solver_body).keypoints for v in (taller, problem.variables))
    np.testing.assert_allclose(
        (points[..., :2] / points[..., 2:]).numpy(), (old[..., :2] / old[..., 2:]).numpy(), atol=1e-12
    )
    # Only the prior on stature is left to object.
    weights = Weights()
    heights = np.log([1.70 * s for s in problem.clip.scales]) - math.log(weights.height_mean_m)
    cost = []
    for growth in (0, 0.1):
        residual = heights + growth
        residual /= np.where(residual > 0, weights.height_sigma, weights.height_sigma_below)
        cost.append(np.sum(2 * (np.sqrt(1 + residual**2) - 1)))
    assert (problem.energy.stage_one(taller) - before).item() == pytest.approx(cost[1] - cost[0], rel=1e-6)


def test_the_scale_terms_do_not_depend_on_the_number_of_frames(body):
    """A prior that holds once for each person must count once, whatever the clip's length."""

    def pull(frames: int) -> float:
        clip = make_clip(body, [Walker(1.2, (0, 5), 0.5, is_still=True)], frames=frames, noise_px=0)
        problem = Problem(clip, body)
        scale = problem.variables.log_scale.requires_grad_()
        problem.energy.stage_one(problem.variables).backward()
        assert scale.grad is not None
        return scale.grad.item()

    assert pull(12) == pytest.approx(pull(3), rel=1e-6)


def test_depth_counts_as_a_few_measurements_whatever_the_length(body):
    def pull(frames: int) -> float:
        clip = make_clip(body, [Walker(1.0, (0, 5), 0.5, is_still=True)], frames=frames, noise_px=0)
        problem = Problem(clip, body, Weights(height=0))
        problem.energy.set_depth(problem.depth)
        wrong = problem.changed(log_scale=problem.variables.log_scale + 0.2)
        wrong.log_scale.requires_grad_()
        problem.energy.stage_one(wrong).backward()
        assert wrong.log_scale.grad is not None
        return wrong.log_scale.grad.item()

    assert pull(24) == pytest.approx(pull(8), rel=0.02)
    assert pull(8) > 0


def test_true_depth_has_no_bias(clip, body):
    """The body's own surface, seen in the true depth map, wants neither a nearer nor a farther body."""
    problem = Problem(clip, body, Weights(height=0))
    problem.energy.set_depth(problem.depth)

    def cost(offset: float) -> float:
        return problem.energy.stage_one(problem.changed(log_scale=problem.variables.log_scale + offset)).item()

    offsets = np.linspace(-0.1, 0.1, 41)
    assert offsets[np.argmin([cost(offset) for offset in offsets])] == pytest.approx(0, abs=0.03)


def test_motion_terms_do_not_shrink_the_scene(clip, body):
    """Calm must not be bought by smaller people: slip and temporal do not see the scale."""
    weights = Weights(joints=0, smpl=0, betas=0, height=0, depth=0, contact=0, speed=1, acceleration=1)
    alone = Problem(clip, body, weights)
    alone.energy.set_contacts(np.ones((2, 8, 2)))
    alone.energy.set_filtered(alone.proxy * 0)
    scale = alone.variables.log_scale.requires_grad_()
    alone.energy.stage_two(alone.variables).backward()
    assert scale.grad is not None
    assert scale.grad.abs().max().item() < 1e-9


def test_near_is_always_nearer_than_far(problem):
    wild = torch.randn(8, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 5
    v = problem.changed(log_inverse_far=wild, log_inverse_gap=-wild)
    far, gap = torch.exp(v.log_inverse_far), torch.exp(v.log_inverse_gap)
    z_near, z_far = 1 / (far + gap), 1 / far
    assert ((z_near > 0) & (z_near < z_far)).all()


def test_a_weight_of_zero_switches_a_term_off(clip, body):
    scales_of_terms = ("_sigma", "_sigma_below", "_mean_m", "_samples")
    nothing = {f.name: 0.0 for f in fields(Weights) if not f.name.endswith(scales_of_terms)}
    problem = Problem(clip, body, Weights(**nothing))
    problem.energy.set_contacts(np.ones((2, 8, 2)))
    problem.energy.set_filtered(problem.proxy * 0)
    moved = problem.changed(translation=problem.variables.translation + 0.3, theta=problem.variables.theta + 0.1)
    assert problem.energy.stage_two(moved).item() == 0


def test_a_disturbed_start_comes_back_to_the_truth(problem):
    rng = np.random.default_rng(0)
    problem.energy.set_depth(problem.depth)
    disturbed = problem.changed(
        theta=problem.variables.theta + 0.05 * torch.as_tensor(rng.normal(size=(2, 8, 24, 3))),
        translation=problem.variables.translation + 0.05 * torch.as_tensor(rng.normal(size=(2, 8, 3))),
    )
    truth = problem.clip.joints / problem.clip.scales[:, None, None, None]

    def error(v: Variables) -> float:
        joints = pose_points(v, problem.solver_body).joints.detach().numpy()
        return float(np.linalg.norm(joints / np.exp(v.log_scale.numpy())[:, None, None, None] - truth, axis=-1).mean())

    before, start = error(disturbed), problem.energy.stage_one(disturbed).item()
    last = run_stage(disturbed, problem.energy.stage_one, 60)
    assert last < 0.1 * start
    assert error(disturbed) < 0.35 * before


@pytest.mark.parametrize("frames", [1, 2])
def test_one_and_two_frames_have_every_term_they_can(body, frames):
    problem = Problem(make_clip(body, [Walker(1.0, (0, 5), 0.5)], frames=frames), body)
    problem.energy.set_contacts(np.ones((1, frames, 2)))
    problem.energy.set_filtered(problem.proxy)
    for stage in (problem.energy.stage_one, problem.energy.stage_two):
        v = problem.changed(theta=problem.variables.theta.clone().requires_grad_())
        value = stage(v)
        value.backward()
        assert math.isfinite(value.item())
        assert v.theta.grad is not None
        assert torch.isfinite(v.theta.grad).all()
