"""Exact bodies to tracks with the errors of real networks."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from core_solver.body import kinematics
from core_solver.body.skeleton import keypoint_index
from core_solver.camera import Camera
from core_solver.evaluation.synthetic.actor import Actor
from core_solver.evaluation.synthetic.noise import NoiseLevels, drifting, episodes
from core_solver.evaluation.synthetic.spoil_pictures import Sight
from core_solver.geometry import align_vectors, matrix_from_rotvec, rotvec_from_matrix
from core_solver.tracking.tracks import Track

Array = NDArray[np.float64]

_HIPS = [keypoint_index("left_hip"), keypoint_index("right_hip")]
_DOUBT = 0.35  # a keypoint's error grows by this power of e for each deviation by which it is less sure
_OUTLIER_LOG_ODDS = -1.5  # a misplaced keypoint is often sure of itself all the same
_LEAST_DEPTH_M = 0.2


def spoil_tracks(
    actors: Sequence[Actor], keypoints: Array, sight: Sight, camera: Camera, times: Array, levels: NoiseLevels,
    rng: np.random.Generator,
) -> tuple[Track, ...]:  # fmt: skip
    """Tracks as tracking delivers them.

    Args:
        actors: N people.
        keypoints: (N, T, 25, 3) camera frame.
        sight: what could be seen.
        camera: intrinsics.
        times: (T,) seconds.
        levels: of the errors.
        rng: random numbers.
    """
    pixels = camera.project(np.maximum(keypoints, (-np.inf, -np.inf, _LEAST_DEPTH_M)))
    return tuple(
        _spoil(n + 1, actor, pixels[n], sight.visible[n], sight.kind[n], camera, times, levels, rng)
        for n, actor in enumerate(actors)
    )


def _spoil(
    track_id: int, actor: Actor, pixels: Array, visible: Array, kind: NDArray[np.uint8], camera: Camera, times: Array,
    levels: NoiseLevels, rng: np.random.Generator,
) -> Track:  # fmt: skip
    valid = _found(visible, times, levels, rng)
    outlier = episodes(rng, times, (25,), levels.outlier_share, levels.outlier_seconds)
    sureness = drifting(rng, times, (25,), levels.keypoint_seconds)
    noisy = pixels + _pixel_errors(pixels, kind, outlier, sureness, times, levels, rng)
    log_odds = np.array(levels.sure)[kind] + levels.sure_spread * sureness + _OUTLIER_LOG_ODDS * outlier
    landmarks = _regress(actor, pixels, camera, times, levels, rng)
    rows = np.flatnonzero(valid)
    confidence = expit(log_odds)
    return Track(
        id=track_id,
        valid=valid,
        keypoints=_held(noisy, rows, times).astype(np.float32),
        confidence=np.where(valid[:, None], confidence, 0).astype(np.float32),
        landmarks=_held(landmarks, rows, times).astype(np.float32),
        score=float(confidence[valid].mean()) if len(rows) else 0.0,
    )


def _found(visible: Array, times: Array, levels: NoiseLevels, rng: np.random.Generator) -> NDArray[np.bool_]:
    share = min(levels.dropouts_per_second * levels.dropout_seconds, 0.5)
    return (visible >= levels.least_visible) & ~episodes(rng, times, (), share, levels.dropout_seconds)


def _pixel_errors(
    pixels: Array, kind: NDArray[np.uint8], outlier: NDArray[np.bool_], sureness: Array, times: Array,
    levels: NoiseLevels, rng: np.random.Generator,
) -> Array:  # fmt: skip
    """(T, 25, 2) pixels."""
    size = np.ptp(pixels, axis=1).max(axis=1)[:, None, None]
    # Divided by its own mean square, the factor leaves the error as large as it is on average.
    doubt = np.exp(-_DOUBT * sureness - _DOUBT**2)
    factor = (np.where(kind == 0, 1.0, levels.hidden_factor) * doubt)[..., None]
    error = levels.keypoint_bias * rng.normal(size=(25, 2))
    error = error + levels.keypoint * factor * drifting(rng, times, (25, 2), levels.keypoint_seconds)
    elsewhere = drifting(rng, times, (25, 2), 3 * levels.outlier_seconds)
    # The length of a 2D Gaussian of unit deviations is sqrt(pi / 2) on average.
    return size * np.where(outlier[..., None], levels.outlier_size / np.sqrt(np.pi / 2) * elsewhere, error)


def _regress(
    actor: Actor, pixels: Array, camera: Camera, times: Array, levels: NoiseLevels, rng: np.random.Generator
) -> Array:
    """Landmarks (T, 25, 3) of an average adult in almost the right pose, along the ray to the person."""
    body, is_root = actor.body, (np.arange(24) == 0)[:, None]
    bias = np.where(is_root, levels.root_bias_degrees, levels.landmark_bias_degrees) * rng.normal(size=(24, 3))
    spread = np.where(is_root, levels.root_degrees, levels.landmark_degrees)
    error = np.radians(bias + spread * drifting(rng, times, (24, 3), levels.landmark_seconds))
    theta = rotvec_from_matrix(matrix_from_rotvec(actor.theta) @ matrix_from_rotvec(error))
    rest = body.rest_joints(body.neutral_betas)
    rotations, positions = kinematics.pose_joints(theta, rest)
    points = kinematics.skin(body.rest_keypoints(body.neutral_betas), body.keypoint_weights, rotations, positions, rest)
    points = points - points[:, _HIPS].mean(axis=1, keepdims=True)
    ray = camera.rays(pixels.mean(axis=1))
    return points @ align_vectors(np.broadcast_to([0.0, 0.0, 1.0], ray.shape), ray)


def _held(values: Array, rows: NDArray[np.int64], times: Array) -> Array:
    """(T, ...) with the frames outside `rows` filled: linear in gaps, the nearest value outside; unchanged without."""
    if len(rows) == 0:
        return values
    flat = values[rows].reshape(len(rows), -1)
    filled = np.stack([np.interp(times, times[rows], column) for column in flat.T], axis=-1)
    return filled.reshape(values.shape)
