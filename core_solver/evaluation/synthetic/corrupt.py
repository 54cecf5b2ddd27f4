"""Exact frames and bodies to modalities with the errors of real networks."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.body import kinematics
from core_solver.body.skeleton import keypoint_index
from core_solver.camera import Camera
from core_solver.evaluation.synthetic.actor import Actor
from core_solver.evaluation.synthetic.noise import NoiseLevels, drifting, episodes, waves
from core_solver.evaluation.synthetic.render import ExactFrame, Grids
from core_solver.geometry import align_vectors, matrix_from_rotvec, rotvec_from_matrix
from core_solver.perception.disparity import normalise, sharpen_edges
from core_solver.tracking.tracks import Track

Array = NDArray[np.float64]

_MID_HIPS = [keypoint_index("left_hip"), keypoint_index("right_hip")]
_MASK_KNOTS, _DISPARITY_KNOTS = 40, 5
_LEAST_INVERSE_M = 1e-3


@dataclass(frozen=True)
class Sight:
    """What of N people could be seen over T frames.

    Attributes:
        visible: (N, T) share of the body.
        kind: (N, T, 25) index into NoiseLevels.confidence: seen, behind oneself, behind others, outside.
    """

    visible: Array
    kind: NDArray[np.uint8]


@dataclass(frozen=True)
class Pictures:
    """Corrupted pictures over T frames.

    Attributes:
        labels: (T, h, w) uint8.
        disparity: (T, hd, wd) float16.
    """

    labels: NDArray[np.uint8]
    disparity: NDArray[np.float16]


def corrupt_frames(
    frames: Iterable[ExactFrame], people: int, times: Array, grids: Grids, levels: NoiseLevels,
    rng: np.random.Generator,
) -> tuple[Pictures, Sight]:  # fmt: skip
    """Spoil exact frames one by one; only the spoilt ones are kept."""
    count = len(times)
    labels = np.zeros((count, *grids.labels[::-1]), np.uint8)
    disparity = np.zeros((count, *grids.disparity[::-1]), np.float16)
    visible, kind = np.zeros((people, count)), np.zeros((people, count, 25), np.uint8)
    drift = _DisparityDrift.draw(rng, times, people, levels)
    for t, frame in enumerate(frames):
        labels[t] = _displaced(frame.labels, levels.mask_cells, rng)
        disparity[t] = drift.spoil(t, frame)
        visible[:, t] = frame.visible
        kind[:, t] = np.select([~frame.inside, frame.hidden_by_others, frame.hidden_by_self], [3, 2, 1], 0)
    return Pictures(labels, disparity), Sight(visible, kind)


def _displaced(labels: NDArray[np.uint8], cells: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Labels whose outlines wander: each cell takes the label of a place nearby."""
    height, width = labels.shape
    across, down = (cells * waves(rng, (width, height), _MASK_KNOTS) for _ in range(2))
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    moved = cv2.remap(labels, columns + across, rows + down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return moved.astype(np.uint8)


@dataclass(frozen=True)
class _DisparityDrift:
    """Errors of disparity over T frames, all in ranges of the picture's disparity.

    Attributes:
        levels: noise levels.
        scale: (T,) factor.
        shift: (T,).
        person: (T, N).
        knots: (T, k, k) of the smooth error.
    """

    levels: NoiseLevels
    scale: Array
    shift: Array
    person: Array
    knots: NDArray[np.float32]

    @classmethod
    def draw(cls, rng: np.random.Generator, times: Array, people: int, levels: NoiseLevels) -> "_DisparityDrift":
        seconds = levels.disparity_seconds
        shape = (_DISPARITY_KNOTS, _DISPARITY_KNOTS)
        return cls(
            levels,
            np.exp(levels.disparity_scale * rng.normal(size=len(times))),
            levels.disparity_shift * rng.normal(size=len(times)),
            levels.disparity_person * drifting(rng, times, (people,), seconds),
            (levels.disparity_wave * drifting(rng, times, shape, seconds)).astype(np.float32),
        )

    def spoil(self, t: int, frame: ExactFrame) -> NDArray[np.float16]:
        inverse = (1 / frame.depth).astype(np.float32)
        low, high = np.percentile(inverse, (1, 99))
        size = (inverse.shape[1], inverse.shape[0])
        disparity = (inverse - low) / max(high - low, _LEAST_INVERSE_M)
        whose = cv2.resize(frame.labels, size, interpolation=cv2.INTER_NEAREST)
        offsets = np.concatenate([[0.0], self.person[t]]).astype(np.float32)
        disparity = disparity + offsets[whose] + cv2.resize(self.knots[t], size, interpolation=cv2.INTER_CUBIC)
        disparity = self.scale[t] * disparity + self.shift[t]
        blurred = cv2.GaussianBlur(disparity.astype(np.float32), (0, 0), self.levels.disparity_blur * max(size))
        return sharpen_edges(normalise(np.asarray(blurred, np.float32))).astype(np.float16)


def corrupt_tracks(
    actors: Sequence[Actor], keypoints: Array, sight: Sight, camera: Camera, times: Array, levels: NoiseLevels,
    rng: np.random.Generator,
) -> tuple[Track, ...]:  # fmt: skip
    """Tracks as tracking delivers them.

    Args:
        actors: the people.
        keypoints: (N, T, 25, 3) camera frame.
        sight: what could be seen.
        camera: intrinsics.
        times: (T,) seconds.
        levels: noise levels.
        rng: random numbers.
    """
    return tuple(
        _corrupt_track(
            n + 1,
            actor,
            keypoints[n],
            Sight(sight.visible[n : n + 1], sight.kind[n : n + 1]),
            camera,
            times,
            levels,
            rng,
        )
        for n, actor in enumerate(actors)
    )


def _corrupt_track(
    track_id: int, actor: Actor, keypoints: Array, sight: Sight, camera: Camera, times: Array, levels: NoiseLevels,
    rng: np.random.Generator,
) -> Track:  # fmt: skip
    kind = sight.kind[0]
    valid = _found(sight.visible[0], times, levels, rng)
    exact = camera.project(np.maximum(keypoints, (-np.inf, -np.inf, 0.2)))
    outlier = episodes(rng, times, (25,), levels.outlier_share, levels.outlier_seconds)
    noisy = exact + _pixel_noise(exact, kind, outlier, times, levels, rng)
    confidence = _confidence(kind, outlier, times, levels, rng)
    landmarks = _regress(actor, exact, camera, times, levels, rng)
    rows = np.flatnonzero(valid)
    return Track(
        id=track_id,
        valid=valid,
        keypoints=_held(noisy, rows, times).astype(np.float32),
        confidence=np.where(valid[:, None], confidence, 0).astype(np.float32),
        landmarks=_held(landmarks, rows, times).astype(np.float32),
        score=float(confidence[valid].mean()) if len(rows) else 0.0,
    )


def _found(visible: Array, times: Array, levels: NoiseLevels, rng: np.random.Generator) -> NDArray[np.bool_]:
    share = levels.dropouts_per_second * levels.dropout_seconds
    return (visible >= levels.least_visible) & ~episodes(rng, times, (), share, levels.dropout_seconds)


def _pixel_noise(
    exact: Array, kind: NDArray[np.uint8], outlier: NDArray[np.bool_], times: Array, levels: NoiseLevels,
    rng: np.random.Generator,
) -> Array:  # fmt: skip
    size = np.ptp(exact, axis=1).max(axis=1)[:, None, None]
    factor = np.where(kind == 0, 1.0, levels.hidden_factor)[..., None]
    noise = levels.keypoint * factor * drifting(rng, times, (25, 2), levels.keypoint_seconds)
    far = drifting(rng, times, (25, 2), 3 * levels.outlier_seconds)
    # The length of a 2D Gaussian of unit spread is sqrt(pi / 2) on average.
    return size * np.where(outlier[..., None], levels.outlier_size * far / np.sqrt(np.pi / 2), noise)


def _confidence(
    kind: NDArray[np.uint8], outlier: NDArray[np.bool_], times: Array, levels: NoiseLevels, rng: np.random.Generator
) -> Array:
    mean = np.array(levels.confidence)[kind]
    spread = levels.confidence_spread * drifting(rng, times, (25,), levels.keypoint_seconds)
    return np.clip(np.where(outlier, 0.6, 1.0) * (mean + spread), 0, 1)


def _regress(
    actor: Actor, exact: Array, camera: Camera, times: Array, levels: NoiseLevels, rng: np.random.Generator
) -> Array:
    """Landmarks (T, 25, 3) of an average adult in almost the right pose, along the ray to the person."""
    body = actor.body
    sigma = np.radians(np.where(np.arange(24) == 0, levels.root_degrees, levels.pose_degrees))[:, None]
    error = matrix_from_rotvec(sigma * drifting(rng, times, (24, 3), levels.pose_seconds))
    theta = rotvec_from_matrix(matrix_from_rotvec(actor.theta) @ error)
    rest = body.rest_joints(body.neutral_betas)
    rotations, positions = kinematics.pose_joints(theta, rest)
    points = kinematics.skin(body.rest_keypoints(body.neutral_betas), body.keypoint_weights, rotations, positions, rest)
    points = points - points[:, _MID_HIPS].mean(axis=1, keepdims=True)
    ray = camera.rays(exact.mean(axis=1))
    return points @ align_vectors(np.broadcast_to([0.0, 0.0, 1.0], ray.shape), ray)


def _held(values: Array, rows: NDArray[np.int64], times: Array) -> Array:
    """(T, ...) with the frames outside `rows` filled: linear in gaps, the nearest value outside; all kept without."""
    if len(rows) == 0:
        return values
    flat = values[rows].reshape(len(rows), -1)
    filled = np.stack([np.interp(times, times[rows], column) for column in flat.T], axis=-1)
    return filled.reshape(values.shape)
