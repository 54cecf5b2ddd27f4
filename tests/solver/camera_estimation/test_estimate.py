"""Focal lengths from people whose camera is known: exactly seen ones, hardly informative ones, and none to speak of."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core_solver.camera import Camera, camera_from_fov
from core_solver.camera_estimation import assumed_camera, estimate_camera
from core_solver.camera_estimation.estimate import PRIOR_SIGMA, posterior
from core_solver.geometry import align_vectors, matrix_from_rotvec
from core_solver.tracking.tracks import Modalities, Track

WIDTH, HEIGHT, FRAMES = 1280, 720, 12

# A standing body in metres: x to its left, y up, z ahead; keypoints in the product's order.
BODY = np.array(
    [
        (0, 1.55, 0.1), (0.03, 1.6, 0.08), (-0.03, 1.6, 0.08), (0.07, 1.58, 0), (-0.07, 1.58, 0), (0.18, 1.38, 0),
        (-0.18, 1.38, 0), (0.25, 1.1, 0), (-0.25, 1.1, 0), (0.25, 0.85, 0.05), (-0.25, 0.85, 0.05), (0.1, 0.9, 0),
        (-0.1, 0.9, 0), (0.1, 0.48, 0.02), (-0.1, 0.48, 0.02), (0.1, 0.08, 0), (-0.1, 0.08, 0), (0.1, 0.02, -0.05),
        (-0.1, 0.02, -0.05), (0.1, 0.02, 0.15), (-0.1, 0.02, 0.15), (0.25, 0.77, 0.07), (-0.25, 0.77, 0.07),
        (0.24, 0.78, 0.09), (-0.24, 0.78, 0.09),
    ]
)  # fmt: skip


def seen_people(
    camera: Camera, pitch: float, places: list[list[tuple[float, float]]], sizes: list[float], noise_px: float = 0.5
) -> Modalities:
    """People who stand at places (metres right of and away from a camera 2.5 m high), one after the other."""
    rng = np.random.default_rng(0)
    to_camera = matrix_from_rotvec([pitch, 0.0, 0.0])  # a camera that looks down sees the world turned up
    tracks = []
    for number, (spots, size) in enumerate(zip(places, sizes, strict=True), start=1):
        keypoints, landmarks = np.zeros((FRAMES, 25, 2)), np.zeros((FRAMES, 25, 3))
        for t in range(FRAMES):
            x, z = spots[t * len(spots) // FRAMES]
            world = size * BODY * (1, -1, -1) + (x, 2.5, z)
            points = world @ to_camera.T
            keypoints[t] = camera.project(points) + rng.normal(0, noise_px, (25, 2))
            # A crop network sees the body along its own ray.
            ray = points.mean(axis=0)
            body = (points - points.mean(axis=0)) / size
            landmarks[t] = body @ align_vectors(ray / np.linalg.norm(ray), [0.0, 0.0, 1.0]).T
        tracks.append(
            Track(
                number, np.ones(FRAMES, bool), keypoints.astype(np.float32), np.ones((FRAMES, 25), np.float32),
                landmarks.astype(np.float32), 0.9,
            )
        )  # fmt: skip
    labels = np.zeros((FRAMES, 9, 16), np.uint8)
    times = np.arange(FRAMES) / 25
    return Modalities(times, np.arange(FRAMES), (camera.width, camera.height), tuple(tracks), labels, None)


CROWD = [[(-2.0, 6.0), (2.5, 9.0)], [(1.5, 5.0), (-1.0, 11.0)], [(2.8, 8.0), (0.0, 6.5)], [(-3.0, 9.0), (-0.5, 5.0)]]


def error_of(clip: Modalities, camera: Camera) -> tuple[float, float]:
    """Log ratio of the estimated focal length to the true one, and its stated deviation."""
    found = estimate_camera(clip)
    return math.log(found.camera.fx / camera.fx), found.focal_sigma


@pytest.mark.parametrize("fov", [40.0, 70.0])
def test_a_crowd_before_a_tilted_camera_fixes_the_lens(fov: float) -> None:
    camera = camera_from_fov(WIDTH, HEIGHT, fov, "truth")
    error, sigma = error_of(seen_people(camera, -0.35, CROWD, [1.05, 0.98, 1.02, 1.0]), camera)
    assert abs(error) < 0.15
    assert abs(error) < 2.5 * sigma
    assert sigma < 0.8 * PRIOR_SIGMA


def test_one_person_in_one_place_tells_little() -> None:
    camera = camera_from_fov(WIDTH, HEIGHT, 40.0, "truth")
    error, sigma = error_of(seen_people(camera, 0.0, [[(0.0, 8.0)]], [1.0]), camera)
    assert sigma > 0.6 * PRIOR_SIGMA
    assert abs(error) < 2.5 * sigma


def test_turned_pictures_are_no_different() -> None:
    camera = camera_from_fov(HEIGHT, WIDTH, 55.0, "truth")
    error, sigma = error_of(seen_people(camera, -0.3, [[(0.0, 9.0), (-0.6, 6.0)], [(0.9, 7.0)]], [1.0, 1.0]), camera)
    assert abs(error) < 2.5 * sigma


def test_people_without_any_evidence_give_the_assumed_lens() -> None:
    camera = camera_from_fov(WIDTH, HEIGHT, 40.0, "truth")
    clip = seen_people(camera, -0.3, CROWD[:2], [1.0, 1.0])
    unseen = tuple(
        replace(t, confidence=np.zeros_like(t.confidence), valid=np.zeros_like(t.valid)) for t in clip.tracks
    )
    found = estimate_camera(replace(clip, tracks=unseen))
    usual = assumed_camera(WIDTH, HEIGHT)
    assert usual.camera.fov_degrees == pytest.approx(55.0)
    assert usual.camera.source == "assumed field of view"
    assert found.camera.fx == pytest.approx(usual.camera.fx, rel=0.02)
    assert found.focal_sigma == pytest.approx(usual.focal_sigma, rel=0.05)


def test_keypoints_that_are_no_numbers_do_no_harm() -> None:
    camera = camera_from_fov(WIDTH, HEIGHT, 55.0, "truth")
    clip = seen_people(camera, -0.3, CROWD[:2], [1.0, 1.0])
    clip.tracks[0].keypoints[3, 5] = np.nan
    clip.tracks[1].landmarks[4] = np.inf
    assert np.isfinite(estimate_camera(clip).camera.fx)


def test_the_posterior_is_the_prior_without_evidence_and_sharpens_with_it() -> None:
    flat, sharp = np.zeros(61), np.full(61, 400.0)
    mean, sigma = posterior(flat)
    assert mean == pytest.approx(math.log(0.5 / math.tan(math.radians(27.5))), abs=5e-3)
    assert sigma == pytest.approx(PRIOR_SIGMA, rel=0.03)
    sharp[18] = 0.0
    assert posterior(sharp)[1] < 0.1
