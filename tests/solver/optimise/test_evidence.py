from dataclasses import replace

import numpy as np
import pytest

from core_solver.camera import Camera, camera_from_fov
from core_solver.optimise.evidence import expect_shallow, gather_evidence, turn_to_camera
from tests.solver.scenes import Walker, change_tracks, make_clip


@pytest.fixture(scope="module")
def clip(body):
    return make_clip(body, [Walker(1.0, (-1.5, 5), 0.5), Walker(0.9, (1, 7), -1.0)], frames=6, noise_px=0)


def test_landmarks_turn_from_the_viewing_ray_into_the_camera(clip):
    """True keypoints relative to the mid-hips come back, however far from the image centre a person stands."""
    found = gather_evidence(clip.modalities, clip.camera).landmarks
    hips = clip.joints[:, :, [1, 2]].mean(axis=2)
    knees = found[:, :, [13, 14]] - found[:, :, [11, 12]].mean(axis=2, keepdims=True)
    truth = (clip.joints[:, :, [4, 5]] - hips[:, :, None]) / clip.scales[:, None, None, None]
    assert np.linalg.norm(knees - truth, axis=-1).mean() < 0.06


def test_somebody_in_the_middle_is_not_turned():
    camera = camera_from_fov(960, 720, 60, "test")
    points = np.random.default_rng(0).normal(size=(25, 3))
    pixels = np.tile([480.0, 360.0], (25, 1))
    np.testing.assert_allclose(turn_to_camera(points, pixels, camera), points, atol=1e-12)


def test_a_person_at_the_border_is_turned_by_the_angle_of_the_ray():
    camera = Camera(1000, 500, 500.0, 500.0, 500.0, 250.0)
    pixels = np.tile([1000.0, 250.0], (25, 1))  # 45 degrees to the right
    turned = turn_to_camera(np.tile([0.0, 0.0, 1.0], (25, 1)), pixels, camera)
    np.testing.assert_allclose(turned, np.tile([np.sqrt(0.5), 0, np.sqrt(0.5)], (25, 1)), atol=1e-12)


def test_pixels_lose_their_distortion(body):
    bent = Camera(960, 720, 800.0, 820.0, 470.0, 365.0, (-0.2, 0.05, 0.002, -0.001, 0.0), "test")
    clip = make_clip(body, [Walker(1.0, (-1.0, 5), 0.5)], frames=3, noise_px=0, camera=bent)
    evidence = gather_evidence(clip.modalities, bent)
    ankle = clip.joints[0, :, 7]
    ideal = bent.project(ankle, distorted=False)
    assert np.abs(evidence.pixels[0, :, 15] - ideal).max() < 0.05
    assert np.abs(bent.project(ankle) - ideal).max() > 1


def test_frames_without_sight_and_pixels_that_are_no_numbers_carry_no_confidence(clip):
    def damage(track):
        keypoints, confidence, valid = track.keypoints.copy(), track.confidence.copy(), track.valid.copy()
        keypoints[2, 5:9], confidence[2, 5:9], valid[3] = np.nan, 0.9, False
        return replace(track, keypoints=keypoints, confidence=confidence, valid=valid)

    evidence = gather_evidence(change_tracks(clip, damage), clip.camera)
    assert (evidence.confidence[:, 3] == 0).all()
    assert (evidence.confidence[:, 2, 5:9] == 0).all()
    assert (evidence.confidence[:, 2, 9:] > 0).all()
    for array in (evidence.pixels, evidence.landmarks, evidence.size):
        assert np.isfinite(array).all()


def test_pixels_that_are_no_numbers_do_not_turn_the_person(clip):
    """The viewing ray follows from what was seen: a missing wrist must not turn the body."""

    def lose_wrists(track):
        keypoints, confidence = track.keypoints.copy(), track.confidence.copy()
        keypoints[:, [9, 10]], confidence[:, [9, 10]] = np.nan, 0
        return replace(track, keypoints=keypoints, confidence=confidence)

    whole = gather_evidence(clip.modalities, clip.camera).landmarks
    partial = gather_evidence(change_tracks(clip, lose_wrists), clip.camera).landmarks
    assert np.abs(whole - partial).max() < 0.01


def test_size_is_the_extent_of_what_is_seen_and_half_a_body_is_not_half_a_person(clip):
    whole = gather_evidence(clip.modalities, clip.camera).size
    pixels = clip.modalities.tracks[0].keypoints
    assert whole[0, 0] == pytest.approx(np.ptp(pixels[0], axis=0).max(), rel=0.01)

    def cut(track):
        confidence = track.confidence.copy()
        confidence[4, 11:] = 0.05
        return replace(track, confidence=confidence)

    part = gather_evidence(change_tracks(clip, cut), clip.camera).size
    assert (part[:, 4] > 0.65 * whole[:, 4]).all()
    np.testing.assert_allclose(part[:, :4], whole[:, :4], rtol=1e-6)


def test_nobody_ever_seen_still_has_a_size(clip):
    blind = change_tracks(clip, lambda t: replace(t, valid=t.valid & False, confidence=t.confidence * 0))
    size = gather_evidence(blind, clip.camera).size
    assert np.isfinite(size).all()
    assert (size > 0).all()


def test_errors_in_depth_shorten_no_limb_on_average() -> None:
    """Limbs of true length with noisy depths: as expected they show the lengths that the picture has."""
    rng = np.random.default_rng(0)
    true = rng.normal(size=(4000, 25, 3)) * (0.2, 0.4, 0.1)
    noisy = true + rng.normal(size=true.shape) * (0, 0, 0.05)

    def slope(marks: np.ndarray) -> float:
        """Regression of true depth differences on the ones believed: 1 where they may be taken at their word."""
        believed, real = np.diff(marks[..., 2], axis=1).ravel(), np.diff(true[..., 2], axis=1).ravel()
        return float(believed @ real / (believed @ believed))

    assert slope(noisy) == pytest.approx(0.8, abs=0.01)
    shallow = expect_shallow(noisy, np.zeros(4000, bool))
    assert slope(shallow) == pytest.approx(1, abs=0.01)
    np.testing.assert_array_equal(shallow[..., :2], noisy[..., :2])


def test_seen_from_above_an_upright_body_keeps_its_lean() -> None:
    """The head is nearer than the feet: that is no error of depth."""
    height = np.linspace(-0.9, 0.9, 25)
    leaning = np.stack([0 * height, height, 0.4 * height], axis=-1)[None]
    np.testing.assert_allclose(expect_shallow(leaning, np.zeros(1, bool)), leaning, atol=1e-12)


def test_bodies_in_regressed_poses_keep_their_depths(clip) -> None:
    """Frame by frame: a clip may have both kinds."""
    frames = np.arange(6) % 2 == 0
    points = gather_evidence(clip.modalities, clip.camera).landmarks
    mixed = gather_evidence(change_tracks(clip, lambda t: replace(t, regressed=frames)), clip.camera).landmarks
    np.testing.assert_array_equal(mixed[:, ~frames], points[:, ~frames])
    for n, track in enumerate(clip.modalities.tracks):
        as_seen = track.landmarks[frames].astype(float)
        pixels = clip.camera.undistort(track.keypoints[frames])
        np.testing.assert_allclose(mixed[n, frames], turn_to_camera(as_seen, pixels, clip.camera), atol=1e-6)
    assert np.abs(mixed[:, frames] - points[:, frames]).max() > 0.01
