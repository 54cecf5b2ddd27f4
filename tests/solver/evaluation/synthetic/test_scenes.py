"""Whole scenes: truth agrees with itself and with what is shown, and modalities err as much as they should."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.body import BodyModel
from core_solver.evaluation.synthetic import SUITES, sized_scene, suite_scenes
from core_solver.evaluation.synthetic.noise import NoiseLevels
from core_solver.evaluation.synthetic.path import Move, Script
from core_solver.evaluation.synthetic.physique import physique
from core_solver.evaluation.synthetic.scenery import low_blocks
from core_solver.evaluation.synthetic.stage import Plan, Role, act, stage
from core_solver.evaluation.synthetic.suites import suite_plans
from core_solver.evaluation.synthetic.world import Terrain
from core_solver.evaluation.truth import SyntheticScene
from core_solver.optimise.evidence import turn_to_camera
from core_solver.scene.sampling import sample_grid

NO_ERRORS = replace(NoiseLevels().times(0), disparity_blur=1e-4)


def test_truth_fits_together(scenes: list[SyntheticScene]) -> None:
    for scene in scenes:
        truth, people, frames = scene.truth, len(scene.modalities.tracks), len(scene.modalities.times)
        assert truth.joints.shape == (people, frames, 24, 3)
        assert truth.soles.shape[:3] == (people, frames, 2)
        assert truth.present.shape == (people, frames)
        assert truth.contacts.shape == (people, frames, 2)
        assert np.linalg.norm(truth.up) == pytest.approx(1)
        assert truth.up[1] < -0.5
        # A person's joints span no more than the stature, and for somebody upright most of it.
        span = np.ptp(truth.joints @ truth.up, axis=2).max(axis=1)
        assert (span < 1.25 * truth.heights).all()
        assert (span > 0.7 * truth.heights).all()
        assert [track.id for track in scene.modalities.tracks] == list(range(1, people + 1))


def test_resting_feet_are_still_and_on_the_surface(scenes: list[SyntheticScene]) -> None:
    for scene in scenes:
        truth = scene.truth
        lowest = truth.scenery.height_above(truth.soles).min(axis=-1)
        assert np.abs(lowest[truth.contacts]).max() < 5e-3
        both = truth.contacts[:, 1:] & truth.contacts[:, :-1]
        step = np.linalg.norm(np.diff(truth.soles, axis=1), axis=-1).mean(axis=-1)
        assert step[both].max() < 1e-3
        assert truth.contacts.mean() > 0.3
        assert lowest.min() > -0.03


def test_people_are_where_the_labels_are(scenes: list[SyntheticScene]) -> None:
    trunk = [1, 2, 3, 6, 9, 4, 5, 16, 17]
    for scene in scenes:
        truth, hits, count = scene.truth, 0, 0
        for n, track in enumerate(scene.modalities.tracks):
            for t in np.flatnonzero(truth.present[n])[::10]:
                labels = scene.modalities.labels[t]
                pixels = scene.camera.project(truth.joints[n, t, trunk])
                found = sample_grid(labels, pixels, scene.camera, outside=255)
                unhidden = (found == track.id) | (found == 0)
                hits, count = hits + (found == track.id).sum(), count + unhidden.sum()
        assert hits / count > 0.9


def test_who_is_not_there_is_not_found(scenes: list[SyntheticScene]) -> None:
    for scene in scenes:
        for track, present in zip(scene.modalities.tracks, scene.truth.present, strict=True):
            assert not (track.valid & ~present).any()
            assert not track.confidence[~track.valid].any()
            assert np.isfinite(track.keypoints).all()
            assert track.valid.sum() >= 10


def test_pictures_have_the_promised_form(scenes: list[SyntheticScene]) -> None:
    for scene in scenes:
        modalities = scene.modalities
        assert modalities.disparity is not None
        assert modalities.disparity.dtype == np.float16
        assert 0 <= modalities.disparity.min() <= modalities.disparity.max() <= 1
        assert modalities.labels.dtype == np.uint8
        assert max(modalities.labels.shape[1:]) == 320
        aspect = modalities.labels.shape[2] / modalities.labels.shape[1]
        assert aspect == pytest.approx(modalities.image_size[0] / modalities.image_size[1], rel=0.01)


def test_the_same_seed_gives_the_same_arrays(stick: BodyModel) -> None:
    one, again = (next(suite_scenes("ablation", 4, stick)) for _ in range(2))
    np.testing.assert_array_equal(one.modalities.labels, again.modalities.labels)
    np.testing.assert_array_equal(one.modalities.disparity, again.modalities.disparity)
    np.testing.assert_array_equal(one.truth.joints, again.truth.joints)
    for first, second in zip(one.modalities.tracks, again.modalities.tracks, strict=True):
        np.testing.assert_array_equal(first.keypoints, second.keypoints)
        np.testing.assert_array_equal(first.landmarks, second.landmarks)
    other, _ = next(suite_plans("ablation", 5, stick))
    assert other.roles[0].physique.height not in one.truth.heights


def _standing(stick: BodyModel, levels: NoiseLevels, height: float = 1.3, frames: int = 250) -> Plan:
    plan, _ = next(iter(suite_plans("ablation", 0, stick)))
    role = Role(physique(stick, height, np.zeros(10)), Script((0.0, 0.5 * (3 + 5)), -1.5, (Move(9.0),)))
    return replace(plan, roles=(role,), terrain=Terrain(), times=np.arange(frames) / 25, levels=levels)


def test_without_errors_modalities_are_exact(stick: BodyModel) -> None:
    scene = stage(_standing(stick, NO_ERRORS, frames=3), stick, np.random.default_rng(0))
    plan = _standing(stick, NO_ERRORS, frames=3)
    (actor,) = act(plan, stick, np.random.default_rng(0))
    track = scene.modalities.tracks[0]
    seen = track.valid
    np.testing.assert_allclose(track.keypoints[seen], scene.camera.project(actor.keypoints)[seen], atol=1e-3)
    # The landmarks are an average adult's: parallel to truth's bones, but not as long as a child's.
    turned = turn_to_camera(track.landmarks.astype(float), track.keypoints.astype(float), scene.camera)
    hip, knee = turned[0, 11], turned[0, 13]
    true_bone = actor.keypoints[0, 13] - actor.keypoints[0, 11]
    bone = knee - hip
    assert bone @ true_bone / np.linalg.norm(bone) / np.linalg.norm(true_bone) > 0.995
    assert np.linalg.norm(bone) / np.linalg.norm(true_bone) > 1.15
    # Disparity is inverse depth up to scale and shift.
    depth = scene.truth.scenery.depth(scene.camera.grid_rays(*scene.modalities.disparity.shape[1:]))
    bare = np.ones(depth.shape, bool)
    bare[:, depth.shape[1] // 3 : 2 * depth.shape[1] // 3] = False
    disparity = scene.modalities.disparity[0].astype(float)
    bare &= (disparity > 0.02) & (disparity < 0.98)
    assert np.corrcoef(disparity[bare], 1 / depth[bare])[0, 1] > 0.9999


def test_errors_of_tracks_are_as_large_as_stated(stick: BodyModel) -> None:
    levels = NoiseLevels(least_visible=0.0, dropouts_per_second=1.0)
    plan = _standing(stick, levels)
    scene = stage(plan, stick, np.random.default_rng(1))
    (actor,) = act(plan, stick, np.random.default_rng(1))
    track, exact = scene.modalities.tracks[0], scene.camera.project(actor.keypoints)
    size = np.ptp(exact, axis=1).max(axis=1)[:, None, None]
    error = ((track.keypoints - exact) / size)[track.valid]
    sure = np.median(track.confidence[track.valid], axis=0) > 0.9
    assert sure.sum() > 8
    about = error[:, sure] - np.median(error[:, sure], axis=0)
    # Robust, because of outliers; a mixture of doubts has a narrower middle than a Gaussian.
    assert 1.4826 * np.median(np.abs(about)) == pytest.approx(levels.keypoint, rel=0.25)
    assert np.sqrt((np.median(error[:, sure], axis=0) ** 2).mean()) == pytest.approx(levels.keypoint_bias, rel=0.5)
    assert (np.linalg.norm(about, axis=-1) > 5 * levels.keypoint).mean() == pytest.approx(levels.outlier_share, rel=0.8)
    lost = levels.dropouts_per_second * levels.dropout_seconds
    assert 1 - track.valid.mean() == pytest.approx(lost, abs=0.12)
    # The less sure, the more wrong.
    distance, confidence = np.linalg.norm(about, axis=-1), track.confidence[track.valid][:, sure]
    assert np.median(distance[confidence < 0.9]) > 1.3 * np.median(distance[confidence > 0.98])


def _background(stick: BodyModel, levels: NoiseLevels, frames: int, seed: int = 1) -> np.ndarray:
    """(T, n) disparity of the left quarter of the picture, where nobody is."""
    disparity = stage(_standing(stick, levels, frames=frames), stick, np.random.default_rng(seed)).modalities.disparity
    assert disparity is not None
    return disparity[:, :, : disparity.shape[2] // 4].reshape(frames, -1).astype(float)


def test_errors_of_disparity_are_as_large_as_stated(stick: BodyModel) -> None:
    exact = _background(stick, NO_ERRORS, 3)
    kept = (exact[0] > 0.15) & (exact[0] < 0.85)
    assert exact.std(axis=0).max() < 2e-3
    exact = exact[0, kept]
    # Errors that forget themselves at once: every frame is a sample of its own.
    brief = replace(NO_ERRORS, disparity_affine_seconds=1e-3, disparity_wave_seconds=1e-3)
    affine = _background(stick, replace(brief, disparity_scale=0.02, disparity_shift=0.01), 60)[:, kept]
    slope, shift = np.polyfit(exact, affine.T, 1)
    assert slope.std() == pytest.approx(0.02, rel=0.3)
    assert shift.std() == pytest.approx(0.01, rel=0.3)
    waving = _background(stick, replace(brief, disparity_wave=0.02), 60)[:, kept]
    assert waving.std(axis=0).mean() == pytest.approx(0.02, rel=0.3)


def test_the_error_that_stays_is_as_large_as_stated(stick: BodyModel) -> None:
    levels = replace(NO_ERRORS, disparity_relief=0.05)
    assert _background(stick, levels, 5).std(axis=0).max() < 5e-3
    exact = _background(stick, NO_ERRORS, 1)[0]
    kept = (exact > 0.15) & (exact < 0.85)
    # One picture holds few of its bumps: only many pictures tell how large they are. Normalising shifts each of them
    # as well, since the bumps move its range: about a fifth more.
    errors = np.stack([(_background(stick, levels, 1, seed)[0] - exact)[kept] for seed in range(24)])
    assert np.sqrt((errors**2).mean()) == pytest.approx(0.06, rel=0.3)


def test_outlines_wander_by_about_a_cell(stick: BodyModel) -> None:
    def areas(levels: NoiseLevels) -> np.ndarray:
        scene = stage(_standing(stick, levels, frames=40), stick, np.random.default_rng(1))
        return (scene.modalities.labels == 1).sum(axis=(1, 2))

    exact, wandering = areas(NO_ERRORS), areas(replace(NO_ERRORS, mask_cells=1.0))
    assert exact.std() < 0.02 * exact.mean()
    assert wandering.std() > 2 * exact.std()
    assert wandering.mean() == pytest.approx(exact.mean(), rel=0.05)


def test_the_stress_suite_has_a_crowd_a_single_picture_and_somebody_still(stick: BodyModel) -> None:
    scenes = list(suite_scenes("stress", 0, stick))
    crowd, picture, still = scenes
    assert len(crowd.modalities.tracks) >= 4
    assert len(picture.modalities.times) == 1
    assert picture.truth.contacts.all()
    assert np.abs(np.diff(still.truth.joints[0, :, 0], axis=0)).max() < 0.02


def test_events_happen_in_the_development_seeds(stick: BodyModel) -> None:
    seen = dict.fromkeys(
        ("child beside adult", "stairs", "box", "slope", "wall", "crossing", "late", "left", "flight", "alone", "five"),
        0,
    )
    for seed in range(10):
        for plan, rng in suite_plans("standard", seed, stick):
            heights = np.array([role.physique.height for role in plan.roles])
            low, joints = low_blocks(plan.terrain), np.stack([actor.joints for actor in act(plan, stick, rng)])
            pixels = plan.camera.project(np.maximum(joints[:, :, 0], (-np.inf, -np.inf, 0.1)))
            inside = ((pixels > 0) & (pixels < (plan.camera.width, plan.camera.height))).all(axis=-1)
            order = np.sign(pixels[:, None, :, 0] - pixels[None, :, :, 0])
            ankles = plan.view.to_world(joints[:, :, [7, 8]])
            lifted = ankles[..., 2] - plan.terrain.height(ankles[..., :2])
            seen["child beside adult"] += bool((heights < 1.46).any() and (heights > 1.49).any())
            seen["stairs"] += len(low) > 2 and len({block.yaw for block in low}) == 1
            seen["box"] += len({block.yaw for block in low}) > 1
            seen["slope"] += any(plan.terrain.gradient)
            seen["wall"] += any(block.top > 2 for block in plan.terrain.blocks)
            seen["crossing"] += bool((order.min(axis=2) < order.max(axis=2)).any())
            seen["late"] += bool((~inside[:, 0] & inside.any(axis=1)).any())
            seen["left"] += bool((inside.any(axis=1) & ~inside[:, -1]).any())
            seen["flight"] += bool((lifted.min(axis=-1) > 0.17).any())
            seen["alone"] += len(heights) == 1
            seen["five"] += len(heights) == 5
    assert min(seen.values()) >= 1, seen


def test_people_hide_each_other_somewhere(scenes: list[SyntheticScene]) -> None:
    hidden = 0
    for scene in scenes:
        for n, track in enumerate(scene.modalities.tracks):
            pixels = scene.camera.project(np.maximum(scene.truth.joints[n], (-np.inf, -np.inf, 0.1)))
            for t in range(0, len(pixels), 5):
                found = sample_grid(scene.modalities.labels[t], pixels[t], scene.camera, outside=0)
                hidden += bool(((found != track.id) & (found != 0)).sum() > 4)
    assert hidden > 3


def test_sized_scenes_keep_people_in_the_picture(stick: BodyModel) -> None:
    scene = sized_scene(120, 4, 0, stick)
    assert scene.truth.joints.shape[:2] == (4, 120)
    assert scene.truth.present.mean() > 0.9
    assert max(scene.modalities.labels.shape[1:]) < 256


def test_every_suite_describes_itself() -> None:
    assert set(SUITES) == {"standard", "ablation", "stress"}
    assert all("\n" not in suite.description and len(suite.description) < 120 for suite in SUITES.values())
