from dataclasses import replace

import numpy as np
import pytest
import torch

from core_solver.body.skeleton import joint_index
from core_solver.camera import Camera
from core_solver.optimise.evidence import gather_evidence
from core_solver.optimise.pose_fit import PoseFit, fit_poses, place_clip
from core_solver.optimise.posing import torch_body
from tests.solver.optimise.conftest import GAP, LATE
from tests.solver.optimise.measures import mpjpe
from tests.solver.scenes import Walker, make_clip


def fit(clip, body) -> PoseFit:
    solver_body = torch_body(body, torch.device("cpu"))
    return fit_poses(gather_evidence(clip.modalities, clip.camera), body, solver_body, clip.camera)


def fitted_joints(found: PoseFit, body) -> np.ndarray:
    from core_solver.body import kinematics

    rest = body.rest_joints(found.betas[0])
    return kinematics.pose_joints(found.theta, rest)[1] + found.translation[:, :, None]


@pytest.fixture(scope="module")
def couple_fit(couple, body) -> PoseFit:
    return fit(couple, body)


def test_poses_are_right_in_frames_with_evidence(couple, couple_fit, body):
    error = mpjpe(fitted_joints(couple_fit, body), couple, np.ones(2))
    valid = np.stack([track.valid for track in couple.modalities.tracks])
    assert error[valid].mean() < 0.03
    assert error[valid].max() < 0.07


def test_at_unit_scale_everybody_stands_in_true_directions_and_proportion(couple, couple_fit, body):
    """A person of scale s is placed at 1 / s of the true distance."""
    valid = np.stack([track.valid for track in couple.modalities.tracks])
    found = fitted_joints(couple_fit, body)[:, :, 0]
    truth = couple.joints[:, :, 0] / couple.scales[:, None, None]
    error = np.linalg.norm(found - truth, axis=-1)[valid] / np.linalg.norm(truth, axis=-1)[valid]
    assert np.median(error) < 0.03
    assert error.max() < 0.08


def test_frames_without_evidence_go_on_without_a_jump(couple, couple_fit, body):
    joints = fitted_joints(couple_fit, body)
    steps = np.linalg.norm(np.diff(joints, axis=1), axis=-1).max(axis=-1)
    truth = np.linalg.norm(np.diff(couple.joints, axis=1), axis=-1).max()
    assert steps[0, GAP].max() < 1.5 * truth
    assert steps[1, :LATE].max() < 1.5 * truth


def test_hinges_fold_their_own_way(couple_fit):
    knees = couple_fit.theta[:, :, [joint_index("left_knee"), joint_index("right_knee")], 0]
    assert knees.min() > -0.25
    left, right = (couple_fit.theta[:, :, joint_index(f"{side}_elbow"), 1] for side in ("left", "right"))
    assert left.max() < 0.3
    assert right.min() > -0.3


@pytest.mark.parametrize(
    "camera",
    [
        Camera(540, 960, 900.0, 900.0, 270.0, 480.0, source="portrait"),
        Camera(960, 720, 700.0, 900.0, 480.0, 360.0, source="fx != fy"),
        Camera(960, 720, 800.0, 800.0, 470.0, 365.0, (-0.25, 0.08, 0.002, -0.001, 0.0), "distorted"),
    ],
    ids=lambda camera: camera.source,
)
def test_any_lens_gives_the_same_pose_and_place(body, camera):
    clip = make_clip(body, [Walker(1.0, (0.3, 5), 0.5)], frames=6, camera=camera)
    found = fitted_joints(fit(clip, body), body)
    assert mpjpe(found, clip, np.ones(1)).mean() < 0.035
    assert np.linalg.norm(found[:, :, 0] - clip.joints[:, :, 0], axis=-1).max() < 0.3


def test_places_without_evidence_lie_on_the_way(couple):
    evidence = gather_evidence(couple.modalities, couple.camera)
    points = couple.joints[:, :, [0] * 25] * 0 + np.random.default_rng(0).normal(size=(25, 3)) * 0.3
    truth = np.array([0.5, 0.2, 6.0]) + np.linspace(0, 1, 36)[:, None] * (0.5, 0, 1.0)
    pixels = couple.camera.project(points + truth[:, None])
    found = place_clip(points, replace(evidence, pixels=pixels), couple.camera)
    np.testing.assert_allclose(found[0], truth, atol=0.1)
    assert np.linalg.norm(np.diff(found, axis=1), axis=-1).max() < 0.2


def test_somebody_without_any_evidence_is_put_before_the_camera(couple):
    evidence = gather_evidence(couple.modalities, couple.camera)
    blind = replace(evidence, confidence=evidence.confidence * 0, valid=evidence.valid & False)
    found = place_clip(np.zeros((2, 36, 25, 3)), blind, couple.camera)
    assert np.isfinite(found).all()
    assert (found[..., 2] > 0).all()
