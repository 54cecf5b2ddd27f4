"""What the solver reads off the picture, against the picture itself read again after a small move."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from core_solver.camera import Camera
from core_solver.optimise.looking import Look
from core_solver.optimise.picture_terms import contour_points
from core_solver.optimise.raster_evidence import Grids, find_contours, no_depth, pixel_depth, read_grids, vertex_depth
from core_solver.optimise.second_order import Schedule, minimise
from core_solver.optimise.variables import Variables, pose_person, pose_points
from core_solver.raster import depth_buffer
from tests.solver.optimise.problems import FAR, GAP, Problem, only
from tests.solver.scenes import SyntheticClip, Walker, change_tracks, make_clip

FRAMES, LONG_SIDE = 3, 480
IDS = [1, 2]


@pytest.fixture(scope="module")
def clip(body):
    return make_clip(body, [Walker(1.0, (-0.8, 4), 0.5), Walker(0.9, (0.8, 5), -1.0)], frames=FRAMES, noise_px=0)


@pytest.fixture(scope="module")
def problem(clip, body):
    return Problem(clip, body, only("depth", "silhouette"))


@pytest.fixture(scope="module")
def grids(clip):
    return read_grids(clip.modalities, clip.camera, LONG_SIDE)


def surfaces(problem: Problem, v: Variables) -> np.ndarray:
    """(N, T, V, 3) metres."""
    energy = problem.energy
    with torch.no_grad():
        people = [
            torch.exp(v.log_scale[n])
            * (pose_person(v, n, energy.body).skin(energy.body.surface, v.betas[n : n + 1])[0]
               + v.translation[n][:, None])
            for n in range(energy.people)
        ]  # fmt: skip
    return torch.stack(people).numpy()


def everybody_visible(problem: Problem, v: Variables, grids: Grids) -> Grids:
    """Masks where the bodies are, a few pixels smaller: what M counts does not change as they move a little."""
    import cv2

    labels = np.zeros_like(grids.labels)
    for n, body in enumerate(surfaces(problem, v)):
        drawn = np.isfinite(depth_buffer(body, problem.solver_body.faces, grids.pinhole)[0])
        inner = np.stack([cv2.erode(mask.astype(np.uint8), np.ones((5, 5), np.uint8)) for mask in drawn])
        labels[inner > 0] = IDS[n]
    return replace(grids, labels=labels)


# --- Mean depths ------------------------------------------------------------------------------------------------------


def test_mean_depths_are_those_of_the_drawn_picture(problem, grids):
    """M by hand: the logs of the depth picture, averaged where the mask is."""
    v = problem.variables
    inner = everybody_visible(problem, v, grids)
    depth = pixel_depth(problem.energy, v, inner, IDS)
    assert inner.disparity is not None
    for n, body in enumerate(surfaces(problem, v)):
        drawn = depth_buffer(body, problem.solver_body.faces, inner.pinhole)[0]
        for t in range(FRAMES):
            inside = inner.labels[t] == IDS[n]
            assert depth.body[n, t].item() == pytest.approx(np.log(drawn[t][inside]).mean(), abs=1e-4)
            disparity = inner.disparity[t][inside].astype(float)
            assert depth.scene[n, t].item() == pytest.approx(-np.log(FAR + GAP * disparity).mean(), abs=1e-4)
    np.testing.assert_allclose(depth.weight, 1, atol=1e-6)


@pytest.mark.parametrize("each_pixel", [True, False])
def test_at_the_truth_bodies_and_depth_map_agree(problem, clip, grids, each_pixel):
    v = problem.variables
    if each_pixel:
        depth = pixel_depth(problem.energy, v, grids, IDS)
    else:
        depth = vertex_depth(problem.energy, v, problem.evidence, clip.modalities, clip.camera)
    assert depth.weight.min() > 0.9
    np.testing.assert_allclose(depth.body, depth.scene, atol=0.03)


def moves(problem: Problem, seed: int, size: float) -> Variables:
    rng = np.random.default_rng(seed)
    v = problem.variables
    return replace(
        v,
        theta=v.theta + size * torch.as_tensor(rng.normal(size=v.theta.shape)),
        translation=v.translation + size * torch.as_tensor(rng.normal(size=v.translation.shape)),
        log_scale=v.log_scale + size * torch.as_tensor(rng.normal(size=2)),
    )


def test_the_bodys_depth_is_linear_about_the_look(problem, grids):
    """Its rows against the picture drawn again after a small move."""
    v = problem.variables
    inner = everybody_visible(problem, v, grids)
    depth = pixel_depth(problem.energy, v, inner, IDS)
    changes, predicted = [], []
    for seed in range(4):
        for sign in (-1, 1):
            there = moves(problem, seed, sign * 0.004)
            changes.append((pixel_depth(problem.energy, there, inner, IDS).body - depth.body).numpy())
            lines = [depth.log_depths(there, n)[0] for n in range(2)]
            predicted.append((torch.cat(lines) - depth.body).numpy())
    changes, predicted = np.ravel(changes), np.ravel(predicted)
    assert np.abs(changes).max() > 3e-3
    # A pose may turn a limb's side towards the camera: that jump is no gradient's fault.
    assert changes @ predicted / np.linalg.norm(changes) / np.linalg.norm(predicted) > 0.995
    assert np.abs(changes - predicted).max() < 0.1 * np.abs(changes).max()


@pytest.mark.parametrize("each_pixel", [True, False])
def test_moving_away_moves_the_mean_depth_as_much(problem, clip, grids, each_pixel):
    """By hand: every point z goes to z + d at scale 1; M grows by the mean of d / z."""
    v = problem.variables
    depth = (
        pixel_depth(problem.energy, v, grids, IDS)
        if each_pixel
        else vertex_depth(problem.energy, v, problem.evidence, clip.modalities, clip.camera)
    )
    expected = clip.scales[:, None] / np.exp(depth.body.numpy())
    # Pixels on slanted sides see the surface come a little faster than its points.
    np.testing.assert_allclose(depth.body_rows[..., 74], expected, rtol=0.04)
    grown = replace(v, log_scale=v.log_scale + 0.1)
    for n in range(2):
        np.testing.assert_allclose(depth.log_depths(grown, n)[0], depth.body[n : n + 1] + 0.1, atol=1e-12)


@pytest.mark.parametrize("each_pixel", [True, False])
def test_the_scenes_depth_is_linear_in_the_range(problem, clip, grids, each_pixel):
    v = problem.variables

    def at(far: float, gap: float):
        there = replace(v, log_inverse_far=v.log_inverse_far + far, log_inverse_gap=v.log_inverse_gap + gap)
        if each_pixel:
            return pixel_depth(problem.energy, there, grids, IDS).scene
        return vertex_depth(problem.energy, there, problem.evidence, clip.modalities, clip.camera).scene

    rows = (
        pixel_depth(problem.energy, v, grids, IDS)
        if each_pixel
        else vertex_depth(problem.energy, v, problem.evidence, clip.modalities, clip.camera)
    ).scene_rows
    step = 1e-3
    for column, (far, gap) in enumerate([(step, 0), (0, step)]):
        slope = (at(far, gap) - at(-far, -gap)) / (2 * step)
        np.testing.assert_allclose(rows[..., column], slope, atol=1e-4)


def test_a_body_without_a_mask_has_no_depth(problem, grids):
    labels = np.where(grids.labels == 2, 0, grids.labels).astype(np.uint8)
    depth = pixel_depth(problem.energy, problem.variables, replace(grids, labels=labels), IDS)
    assert (depth.weight[1] == 0).all()
    assert (depth.weight[0] > 0.9).all()
    for name in ("body", "body_rows", "scene", "scene_rows"):
        assert torch.isfinite(getattr(depth, name)).all(), name


def test_no_depth_pulls_nowhere(problem):
    depth = no_depth(problem.variables)
    body, scene = depth.log_depths(moves(problem, 0, 0.3), 0)
    assert (depth.weight == 0).all()
    assert torch.isfinite(body - scene).all()


def test_many_frames_are_read_in_pieces_that_fit_together(problem, clip, monkeypatch):
    """A clip of any length in bounded memory, and the same numbers."""
    from core_solver.optimise import raster_evidence

    grids = read_grids(clip.modalities, clip.camera, 160)
    whole = pixel_depth(problem.energy, problem.variables, grids, IDS)
    outlines = find_contours(problem.energy, problem.variables, grids, IDS, 16)
    monkeypatch.setattr(raster_evidence, "_CHUNK", 2)
    parts = pixel_depth(problem.energy, problem.variables, grids, IDS)
    for name in ("body", "body_rows", "scene", "scene_rows", "weight"):
        torch.testing.assert_close(getattr(whole, name), getattr(parts, name))
    torch.testing.assert_close(outlines.target, find_contours(problem.energy, problem.variables, grids, IDS, 16).target)


# --- Outlines ---------------------------------------------------------------------------------------------------------


def test_contour_samples_lie_on_the_body_and_on_its_outline(problem, grids):
    v = problem.variables
    found = find_contours(problem.energy, v, grids, IDS, 48)
    for n in range(2):
        points = contour_points(found, problem.solver_body, v, n, pose_person(v, n, problem.solver_body))
        corners = surfaces(problem, v)[n][np.arange(FRAMES)[:, None, None], found.corners[n].numpy()]
        place = (corners * found.barycentric[n].numpy()[..., None]).sum(axis=2)
        # Skinning is not linear within a triangle whose corners belong to different joints.
        error = np.linalg.norm(math.exp(v.log_scale[n]) * points[0].numpy() - place, axis=-1)
        assert np.median(error) < 1e-6
        assert error.max() < 0.01
    # At the truth the masks' edges are where the outlines are: within the labels' own pixels.
    cell = problem.clip.camera.width / problem.clip.modalities.labels.shape[2]
    error = residuals(problem, v, found)
    assert np.median(np.abs(error[found.weight.numpy() > 0])) < cell


def residuals(problem: Problem, v: Variables, contours) -> np.ndarray:
    """(N, T, S) pixels by which samples stand beyond their targets."""
    people = []
    for n in range(2):
        points = contour_points(contours, problem.solver_body, v, n, pose_person(v, n, problem.solver_body))
        along = torch.gather(problem.energy.project(v, points), -1, contours.axis[n : n + 1, ..., None])[..., 0]
        people.append(along - contours.target[n : n + 1])
    return torch.cat(people).numpy()


def test_weights_are_shares_of_the_outline(problem, grids):
    weight = find_contours(problem.energy, problem.variables, grids, IDS, 48).weight
    assert (weight >= 0).all()
    total = weight.sum(-1)
    assert (total <= 1 + 1e-6).all()
    assert (total > 0.7).all()


def test_without_a_mask_there_is_no_pull(clip, body):
    empty = replace(clip.modalities, labels=np.zeros_like(clip.modalities.labels))
    problem = Problem(SyntheticClip(**{**vars(clip), "modalities": empty}), body, only("depth", "silhouette"))
    problem.look()
    leaves = problem.variables.leaves()
    value = torch.stack([problem.energy.person(leaves, n) for n in range(2)]).sum()
    value.backward()
    assert value.item() == 0
    for name in ("theta", "translation", "betas"):
        gradient = getattr(leaves, name).grad
        assert gradient is None or (gradient == 0).all(), name


def shifted_masks(clip: SyntheticClip, cells: int) -> SyntheticClip:
    """The same bodies' masks some cells to the right, nothing else changed."""
    labels = np.zeros_like(clip.modalities.labels)
    labels[:, :, cells:] = clip.modalities.labels[:, :, : labels.shape[2] - cells]
    return SyntheticClip(**{**vars(clip), "modalities": replace(clip.modalities, labels=labels)})


def fine_masks(clip: SyntheticClip, problem: Problem, pixels: int = 0) -> SyntheticClip:
    """Masks drawn at full resolution, moved to the right."""
    pinhole = read_grids(clip.modalities, clip.camera, clip.camera.width).pinhole
    labels = np.zeros((FRAMES, clip.camera.height, clip.camera.width), np.uint8)
    nearest = np.full(labels.shape, np.inf)
    for n, people in enumerate(surfaces(problem, problem.variables)):
        depth = depth_buffer(people, problem.solver_body.faces, pinhole)[0]
        labels[depth < nearest] = IDS[n]
        nearest = np.minimum(nearest, depth)
    return shifted_masks(SyntheticClip(**{**vars(clip), "modalities": replace(clip.modalities, labels=labels)}), pixels)


@pytest.mark.parametrize("pixels", [3, 8])
def test_a_mask_beside_the_body_draws_it_there(clip, body, problem, pixels):
    """Silhouettes alone move everybody by as many pixels as their masks are off, limbs and all."""
    moved = Problem(fine_masks(clip, problem, pixels), body, only("silhouette", "smpl", "betas"))
    fine = Look(clip.camera.width // 2, 64, each_pixel=True)
    found = minimise(
        moved.energy, moved.variables, Schedule(6, 0.0), lambda v: moved.onlooker.look(moved.energy, v, fine)
    )
    before, after = (clip.camera.project(pose_points(v, moved.solver_body).joints.numpy())
                     for v in (moved.variables, found))  # fmt: skip
    change = (after - before).mean(axis=2)
    np.testing.assert_allclose(change[..., 0], pixels, atol=1.0)
    np.testing.assert_allclose(change[..., 1], 0, atol=1.5)


def test_masks_at_home_leave_the_body_there(clip, body, problem):
    home = Problem(fine_masks(clip, problem), body, only("silhouette", "smpl", "betas"))
    fine = Look(clip.camera.width // 2, 64, each_pixel=True)
    found = minimise(home.energy, home.variables, Schedule(4, 0.0), lambda v: home.onlooker.look(home.energy, v, fine))
    before, after = (clip.camera.project(pose_points(v, home.solver_body).joints.numpy())
                     for v in (home.variables, found))  # fmt: skip
    # A cell of the grid looked at is two pixels.
    assert np.abs((after - before).mean(axis=2)).max() < 1.0


def test_masks_of_a_bent_lens_fit_bodies_seen_without_one(body):
    bent = Camera(960, 720, 830.0, 830.0, 480.0, 360.0, (-0.25, 0.05, 0.0, 0.0, 0.0), "truth")
    clip = make_clip(body, [Walker(1.0, (-1.9, 4), 0.5), Walker(0.9, (2.3, 5), -1.0)], frames=FRAMES, noise_px=0,
                     camera=bent)  # fmt: skip
    problem = Problem(clip, body)
    grids = read_grids(clip.modalities, bent, LONG_SIDE)
    contours = find_contours(problem.energy, problem.variables, grids, IDS, 48)
    seen = contours.weight.numpy() > 0
    assert seen.mean() > 0.5
    cell = bent.width / clip.modalities.labels.shape[2]
    straight = read_grids(clip.modalities, replace(bent, distortion=(0.0, 0.0, 0.0, 0.0, 0.0)), LONG_SIDE)
    wrong = find_contours(problem.energy, problem.variables, straight, IDS, 48)
    right_error = np.abs(residuals(problem, problem.variables, contours)[seen]).mean()
    assert right_error < cell
    wrong_error = np.abs(residuals(problem, problem.variables, wrong)[wrong.weight.numpy() > 0]).mean()
    assert wrong_error > 1.5 * right_error


def test_a_person_hidden_by_another_is_not_drawn_to_the_visible_part(body):
    """The mask of somebody half hidden ends where the other begins: no edge of theirs."""
    clip = make_clip(body, [Walker(1.0, (-0.1, 3.5), 0.5), Walker(1.0, (0.15, 5), -1.0)], frames=FRAMES, noise_px=0)
    problem = Problem(fine_masks(clip, Problem(clip, body)), body, only("silhouette", "smpl", "betas"))
    fine = Look(480, 64, each_pixel=True)
    found = minimise(
        problem.energy, problem.variables, Schedule(4, 0.0), lambda v: problem.onlooker.look(problem.energy, v, fine)
    )
    before, after = (clip.camera.project(pose_points(v, problem.solver_body).joints.numpy())
                     for v in (problem.variables, found))  # fmt: skip
    assert np.abs((after - before).mean(axis=2)).max() < 3


def test_frames_without_evidence_are_not_drawn_anywhere(clip, body):
    def hide(track):
        valid = track.valid.copy()
        valid[1] = False
        return replace(track, valid=valid, confidence=track.confidence * valid[:, None])

    labels = clip.modalities.labels.copy()
    labels[1] = 0
    hidden = replace(change_tracks(clip, hide), labels=labels)
    problem = Problem(SyntheticClip(**{**vars(clip), "modalities": hidden}), body)
    problem.look()
    picture = problem.picture
    assert picture.contours is not None
    assert (picture.depth.weight[:, 1] == 0).all()
    assert (picture.contours.weight[:, 1] == 0).all()
    assert (picture.contours.weight[:, 0].sum(-1) > 0.5).all()
