"""Drawn people who walk about: the truth of every frame is known, and detections are made from it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations

Array = NDArray[np.float64]

IMAGE_SIZE = (640, 480)
LABEL_SIZE = (160, 120)

# A standing figure: (across, down) in body heights, hips at the origin, soles at 0.5.
_FIGURE = {
    "nose": (0, -0.43), "left_eye": (0.015, -0.44), "right_eye": (-0.015, -0.44), "left_ear": (0.03, -0.43),
    "right_ear": (-0.03, -0.43), "left_shoulder": (0.1, -0.3), "right_shoulder": (-0.1, -0.3),
    "left_elbow": (0.13, -0.14), "right_elbow": (-0.13, -0.14), "left_wrist": (0.14, 0.0), "right_wrist": (-0.14, 0.0),
    "left_hip": (0.06, 0.0), "right_hip": (-0.06, 0.0), "left_knee": (0.06, 0.24), "right_knee": (-0.06, 0.24),
    "left_ankle": (0.06, 0.46), "right_ankle": (-0.06, 0.46), "left_heel": (0.06, 0.48), "right_heel": (-0.06, 0.48),
    "left_toe": (0.09, 0.5), "right_toe": (-0.09, 0.5), "left_index": (0.14, 0.04), "right_index": (-0.14, 0.04),
    "left_pinky": (0.13, 0.04), "right_pinky": (-0.13, 0.04),
}  # fmt: skip
FIGURE = np.array([_FIGURE[name] for name in KEYPOINT_NAMES])
_LEFT = np.array([name.startswith("left") for name in KEYPOINT_NAMES])
_LEGS = np.array([any(part in name for part in ("knee", "ankle", "heel", "toe")) for name in KEYPOINT_NAMES])


@dataclass(frozen=True)
class Walker:
    """A person: `path` gives the hips' pixel at a time, `seen` says whether the detector can see them then."""

    path: Callable[[float], tuple[float, float]]
    height: float = 120.0
    clothes: int = 0
    seen: Callable[[float], bool] = lambda _time: True
    score: float = 0.8

    def keypoints(self, time: float) -> Array:
        swing = 0.08 * np.sin(2 * np.pi * time) * np.where(_LEFT, 1, -1) * _LEGS
        figure = FIGURE + np.stack([swing, np.zeros(25)], axis=-1)
        return figure * self.height + np.array(self.path(time))


def straight(start: tuple[float, float], velocity: tuple[float, float]) -> Callable[[float], tuple[float, float]]:
    return lambda time: (start[0] + velocity[0] * time, start[1] + velocity[1] * time)


def clothes_vector(clothes: int) -> Array:
    vector = np.full(8, 0.3)
    vector[clothes] = 1.0
    return vector / np.linalg.norm(vector)


def rectangle_mask(box: Array, probability: int = 220) -> CroppedMask:
    scale = np.array([LABEL_SIZE[0] / IMAGE_SIZE[0], LABEL_SIZE[1] / IMAGE_SIZE[1]] * 2)
    left, top, right, bottom = np.floor(box * scale).astype(int)
    return CroppedMask(int(top), int(left), np.full((bottom - top, right - left), probability, np.uint8))


def detection_of(walker: Walker, time: float, rng: np.random.Generator, noise: float = 0.01) -> Detection:
    keypoints = walker.keypoints(time) + rng.normal(0, noise * walker.height, (25, 2))
    margin = 0.05 * walker.height
    box = np.concatenate([keypoints.min(0) - margin, keypoints.max(0) + margin])
    appearance = clothes_vector(walker.clothes) + rng.normal(0, 0.03, 8)
    landmarks = np.concatenate([FIGURE * 1.7, np.zeros((25, 1))], axis=-1)
    return Detection(
        score=walker.score,
        box=box.astype(np.float32),
        keypoints=keypoints.astype(np.float32),
        confidence=np.full(25, 0.9, np.float32),
        landmarks=landmarks.astype(np.float32),
        appearance=(appearance / np.linalg.norm(appearance)).astype(np.float32),
        mask=rectangle_mask(box),
    )


def film(walkers: Sequence[Walker], seconds: float, rate: float = 30.0, noise: float = 0.01) -> list[FrameObservations]:
    """Everything a perfect but noisy detector reports."""
    rng = np.random.default_rng(7)
    frames: list[FrameObservations] = []
    for row in range(round(seconds * rate)):
        time = row / rate
        seen = tuple(detection_of(w, time, rng, noise) for w in walkers if w.seen(time))
        frames.append(FrameObservations(FrameInfo(row, time), seen, None))
    return frames


def with_detections(frame: FrameObservations, detections: Sequence[Detection]) -> FrameObservations:
    return replace(frame, detections=tuple(detections))


def walker_of(track_keypoints: Array, time: float, walkers: Sequence[Walker]) -> int:
    """Which walker a track's keypoints show; -1 if none is near."""
    distance = [np.median(np.linalg.norm(w.keypoints(time) - track_keypoints, axis=-1)) / w.height for w in walkers]
    nearest = int(np.argmin(distance))
    return nearest if distance[nearest] < 0.12 else -1
