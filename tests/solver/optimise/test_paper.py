"""The paper's solver on clips with exact truth, and on evidence that is poor."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from core_solver.camera import Camera
from core_solver.energy.paper import PaperWeights
from core_solver.optimise import paper_picture, pose_fit
from core_solver.optimise.evidence import gather_evidence
from core_solver.optimise.paper import Motion, PaperEnergy, PaperPreset, PaperVariables, solve_paper
from core_solver.optimise.paper_picture import DepthRange
from core_solver.optimise.pose_fit import fit_poses
from core_solver.optimise.posing import torch_body
from core_solver.optimise.solution import Solution
from core_solver.progress import SilentProgress
from core_solver.tracking.tracks import UNCLAIMED, Modalities
from tests.solver.optimise.conftest import hide
from tests.solver.optimise.measures import all_finite, mpjpe, solved_joints
from tests.solver.scenes import SyntheticClip, Walker, change_tracks, make_clip

TRUE_NEAR, TRUE_FAR = 1.5, 30.0  # of `make_clip`
CAMERA_HEIGHT = 1.4
SHORT = PaperPreset(stage_one=2, stage_two=3, raster_size=64)


@pytest.fixture(scope="module")
def clip(body) -> SyntheticClip:
    """A noise-free couple of average size before a level camera, as the paper supposes."""
    walkers = [Walker(1.0, (-0.8, 4), 0.5), Walker(1.0, (0.7, 5), -1.0)]
    return make_clip(body, walkers, frames=16, noise_px=0, tilt=0.0, camera_height=CAMERA_HEIGHT)


@pytest.fixture(scope="module")
def solved(clip, body) -> Solution:
    return run(clip.modalities, clip, body, PaperPreset(raster_size=64))


@pytest.fixture
def quick(monkeypatch):
    monkeypatch.setattr(pose_fit, "ITERATIONS", 5)


def run(modalities: Modalities, clip: SyntheticClip, body, preset: PaperPreset = SHORT) -> Solution:
    return solve_paper(modalities, clip.camera, body, SilentProgress(), preset)


def make_energy(modalities: Modalities, clip: SyntheticClip, body, preset: PaperPreset) -> PaperEnergy:
    evidence, device_body = gather_evidence(modalities, clip.camera), torch_body(body, torch.device("cpu"))
    fit = fit_poses(evidence, body, device_body, clip.camera, smooth=False)
    picture = paper_picture.picture_on_grid(modalities, clip.camera, device_body.faces, preset.raster_size)
    return PaperEnergy(evidence, fit, picture, clip.camera, device_body, preset)


def make_picture(clip: SyntheticClip, body, size: int = 120) -> paper_picture.Picture:
    return paper_picture.picture_on_grid(clip.modalities, clip.camera, body.faces, size)


def true_bodies(clip: SyntheticClip, picture: paper_picture.Picture, factor: float = 1.0) -> paper_picture.Bodies:
    vertices = torch.tensor(factor * clip.vertices, dtype=torch.float32).requires_grad_()
    return paper_picture.bodies_in(picture, slice(0, len(picture.labels)), vertices)


def true_range(frames: int) -> DepthRange:
    return DepthRange(torch.full((frames,), TRUE_NEAR), torch.full((frames,), TRUE_FAR))


# --- A clip with truth ------------------------------------------------------------------------------------------------


def test_a_clip_is_solved(clip, solved, body):
    joints = solved_joints(solved, body)
    assert mpjpe(joints, clip, solved.scales).mean() < 0.045  # landmarks err, and the filter lags behind swinging limbs
    assert np.linalg.norm(joints[:, :, 0] - clip.joints[:, :, 0], axis=-1).mean() < 0.15
    assert np.abs(solved.scales - 1).max() < 0.04
    pixels = clip.camera.project(joints) - clip.camera.project(clip.joints)
    assert np.linalg.norm(pixels, axis=-1).mean() < 4


def test_the_depth_map_meets_the_people(clip, solved):
    """Only where people stand: with two of them the paper's depth range is hardly determined elsewhere."""
    disparity = (1 / 4.5 - 1 / TRUE_FAR) / (1 / TRUE_NEAR - 1 / TRUE_FAR)
    depth = 1 / (solved.inverse_far + solved.inverse_gap * disparity)
    assert np.abs(depth - 4.5).mean() < 0.3
    assert (solved.inverse_gap > 0).all()


def test_standing_feet_and_the_ground_below_them(clip, solved):
    assert solved.ground.gravity.tolist() == [0, 1, 0]
    assert solved.ground.offset == pytest.approx(CAMERA_HEIGHT, abs=0.15)
    assert set(np.unique(solved.contacts)) == {0.0, 1.0}
    assert solved.contacts.max(axis=-1).mean() > 0.8  # a walker always has a foot on the ground


def test_stage_two_calms_the_motion(body):
    shaky = make_clip(body, [Walker(1.0, (0, 4), 0.5)], frames=12, noise_px=4, tilt=0.0)
    preset = PaperPreset().without("silhouette", "depth")
    calm, nervous = (
        np.linalg.norm(np.diff(solved_joints(run(shaky.modalities, shaky, body, p), body), 3, axis=1), axis=-1).mean()
        for p in (preset, preset.without("temporal"))
    )
    assert calm < 0.7 * nervous


# --- One step ---------------------------------------------------------------------------------------------------------


def gradients(clip: SyntheticClip, body, preset: PaperPreset, modalities: Modalities | None = None) -> PaperVariables:
    energy = make_energy(modalities or clip.modalities, clip, body, preset)
    variables = energy.start()
    filtered = energy.points(variables)[1].detach() * 1.01
    energy.accumulate(variables, Motion(filtered, None))
    return PaperVariables(*(leaf.grad for leaf in variables.leaves()))


def test_the_batch_size_changes_nothing(clip, body, quick):
    preset = replace(SHORT, batch=3)
    few, all_at_once = (gradients(clip, body, p).leaves() for p in (preset, replace(preset, batch=1000)))
    for a, b in zip(few, all_at_once, strict=True):
        assert b.abs().max() > 0
        assert torch.allclose(a, b, rtol=1e-4, atol=1e-5 * float(b.abs().max()))


def test_the_gradient_is_that_of_the_value(clip, body, quick):
    """Along the view everything is smooth: bodies and depth ranges that grow together keep their pictures."""
    energy = make_energy(clip.modalities, clip, body, SHORT.without("joints", "smpl", "silhouette"))
    variables, step = energy.start(), 1e-3
    with torch.no_grad():
        variables.soft_scale.add_(0.3)  # away from where little pulls
    energy.accumulate(variables, None)
    for leaf in (variables.soft_near, variables.soft_range, variables.soft_scale):
        slope, values = float(leaf.grad.sum()), []
        for sign in (1, -1):
            moved = PaperVariables(*(x.detach().clone().requires_grad_() for x in variables.leaves()))
            index = [x is leaf for x in variables.leaves()].index(True)
            with torch.no_grad():
                moved.leaves()[index].add_(sign * step)
            values.append(energy.accumulate(moved, None))
        assert slope == pytest.approx((values[0] - values[1]) / (2 * step), rel=0.05, abs=1e-5)


def test_frames_without_evidence_carry_no_data_terms(clip, body, quick):
    gap = np.arange(5, 9)
    hidden = change_tracks(clip, lambda track: hide(track, gap))
    preset = SHORT.without("speed", "temporal", "scale")
    pull = gradients(clip, body, preset, hidden)
    shown = np.setdiff1d(np.arange(16), gap)
    assert (pull.gamma[:, gap] == 0).all()
    assert (pull.theta[:, gap] == 0).all()
    assert (pull.soft_near[gap] == 0).all()
    assert (pull.gamma[:, shown].abs().amax(-1) > 0).all()


# --- The picture ------------------------------------------------------------------------------------------------------


def test_depth_meets_the_truth_without_a_bias(clip, body):
    """The authors' program adds 20 cm to its bodies' depth: the truth here has residuals well below that."""
    picture = make_picture(clip, body)
    energies = {}
    for factor in (1.0, 1.1, 1 / 1.1):
        bodies = true_bodies(clip, picture, factor)
        energies[factor] = float(paper_picture.depth(picture, bodies, true_range(16)).detach()) / 32
    assert energies[1.0] < np.log(1 + 0.05 / 4.5) ** 2
    # Scaled about the camera the picture stays as it is, and all depths gain the same logarithm.
    assert energies[1.1] == pytest.approx(np.log(1.1) ** 2, rel=0.15)
    assert energies[1 / 1.1] == pytest.approx(np.log(1.1) ** 2, rel=0.15)


def test_depth_pulls_scene_and_bodies_alike(clip, body):
    picture = make_picture(clip, body)
    bodies = true_bodies(clip, picture, 1.1)
    near, far = (torch.full((16,), v, requires_grad=True) for v in (TRUE_NEAR, TRUE_FAR))
    by_vertex, by_near, by_far = torch.autograd.grad(
        paper_picture.depth(picture, bodies, DepthRange(near, far)), [bodies.vertices, near, far]
    )
    assert (by_vertex[..., 2].sum(-1) > 0).all()  # too far: come nearer
    assert (by_near < 0).all()  # or the scene moves away
    assert (by_far <= 0).all()


def test_the_first_range_is_the_true_one(clip, body):
    near, far = paper_picture.first_range(make_picture(clip, body), clip.vertices[..., 2].mean(axis=2))
    d = np.array([0.1, 0.3])
    found, truth = (1 / (1 / f + (1 / n - 1 / f) * d) for n, f in ((near, far), (TRUE_NEAR, TRUE_FAR)))
    assert found == pytest.approx(truth, rel=0.25)


def test_disparity_becomes_depth_as_in_the_paper():
    near, far, d = torch.tensor([2.0]), torch.tensor([10.0]), 0.3
    inverse_far, inverse_gap = DepthRange(near, far).inverse()
    assert 1 / (inverse_far + inverse_gap * d) == pytest.approx(20 / (0.3 * 8 + 2))


def test_silhouettes_of_the_truth_fit_and_others_are_pulled_back(clip, body):
    picture = make_picture(clip, body)
    right = float(paper_picture.silhouette(picture, true_bodies(clip, picture)).detach())
    vertices = torch.tensor(clip.vertices + np.array([0.1, 0, 0]), dtype=torch.float32).requires_grad_()
    bodies = paper_picture.bodies_in(picture, slice(0, 16), vertices)
    energy = paper_picture.silhouette(picture, bodies)
    assert float(energy.detach()) > 2 * right
    (pull,) = torch.autograd.grad(energy, vertices)
    assert (pull[..., 0].sum(-1) > 0).all()


def test_a_person_hidden_by_another_is_not_penalised(clip, body):
    """Everything of the farther person's mask is taken by the nearer one, who is made to stand in front."""
    picture = make_picture(clip, body)
    labels = np.where(picture.labels == 2, 1, picture.labels).astype(np.uint8)
    vertices = torch.tensor(clip.vertices, dtype=torch.float32)
    vertices[0] *= 0.5  # keeps its picture
    bodies = paper_picture.bodies_in(replace(picture, labels=labels), slice(0, 16), vertices)
    assert not bodies.visible[16:][labels == 1].any()
    assert bodies.visible[:16][labels == 1].all()
    bodies = paper_picture.bodies_in(replace(picture, labels=np.full_like(labels, UNCLAIMED)), slice(0, 16), vertices)
    assert not bodies.visible.any()


def test_the_grid_is_freed_of_distortion(body):
    camera = Camera(640, 480, 500.0, 480.0, 310.0, 245.0, (-0.25, 0.06, 0.0, 0.0, 0.0), "truth")
    clip = make_clip(body, [Walker(1.0, (1.3, 4), 0.5)], frames=2, camera=camera, tilt=0.0)
    picture = paper_picture.picture_on_grid(clip.modalities, camera, body.faces, 128)
    bodies = true_bodies(clip, picture)
    drawn = paper_picture.depth_buffer(bodies.vertices.detach().numpy(), body.faces, picture.pinhole)[1] >= 0
    overlap = (drawn & bodies.own).sum() / (drawn | bodies.own).sum()
    assert overlap > 0.8


# --- Variables and preset ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [-500.0, -30.0, 0.0, 30.0, 500.0])
def test_depths_and_scales_are_positive_and_finite_whatever_the_step(value):
    far_out = torch.full((3,), value)
    variables = PaperVariables(*(torch.zeros(1),) * 3, far_out, far_out, far_out)
    depth_range = variables.depth_range()
    for positive in (variables.scales(), depth_range.near, depth_range.far - depth_range.near):
        assert (positive > 0).all()
        assert torch.isfinite(positive).all()


def test_terms_can_be_left_out():
    preset = PaperPreset().without("depth", "scale")
    assert (preset.weights.depth, preset.weights.scale, preset.weights.joints) == (0, 0, 1)
    with pytest.raises(ValueError, match="choose from"):
        PaperPreset().without("height")


def test_every_switch_changes_the_gradient(clip, body, quick):
    """Of the terms that the first step knows; contact and slip need a scene and have their own tests."""
    full = gradients(clip, body, SHORT).leaves()
    for term in set(PaperWeights.terms()) - {"contact", "slip", "smpl", "scale"}:
        without = gradients(clip, body, SHORT.without(term)).leaves()
        assert any(not torch.equal(a, b) for a, b in zip(full, without, strict=True)), term


# --- Poor evidence ----------------------------------------------------------------------------------------------------

POOR = {
    "no masks": lambda m: replace(m, labels=np.zeros_like(m.labels)),
    "masks of nobody": lambda m: replace(m, labels=np.full_like(m.labels, UNCLAIMED)),
    "no disparity": lambda m: replace(m, disparity=None),
    "disparity that is no number": lambda m: replace(m, disparity=np.full_like(m.disparity, np.nan)),
    "flat disparity": lambda m: replace(m, disparity=np.zeros_like(m.disparity)),
    "one person": lambda m: replace(m, tracks=m.tracks[:1]),
    "nobody in frame 0": lambda m: replace(m, tracks=tuple(hide(t, np.arange(2)) for t in m.tracks)),
    "one frame": lambda m: Modalities(
        m.times[:1],
        m.frames[:1],
        m.image_size,
        tuple(
            replace(
                t,
                valid=t.valid[:1],
                keypoints=t.keypoints[:1],
                confidence=t.confidence[:1],
                landmarks=t.landmarks[:1],
            )
            for t in m.tracks
        ),
        m.labels[:1],
        m.disparity[:1],
    ),
    "never seen": lambda m: replace(
        m,
        tracks=(
            m.tracks[0],
            replace(m.tracks[1], valid=np.zeros(16, bool), confidence=np.zeros((16, 25), np.float32)),
        ),
    ),
}


@pytest.mark.parametrize("name", POOR)
def test_poor_evidence_gives_finite_results(clip, body, quick, name):
    modalities = POOR[name](clip.modalities)
    solution = run(modalities, clip, body)
    assert all_finite(solution)
    assert solution.theta.shape[:2] == (len(modalities.tracks), len(modalities.times))
    unseen = ~np.stack([track.valid for track in modalities.tracks])
    assert (solution.contacts[unseen] == 0).all()
    assert (solution.confidence[unseen] == 0).all()
