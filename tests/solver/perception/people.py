"""Stand-ins for what the networks give, and a frame of the demo clip."""

from pathlib import Path

import numpy as np
import pytest

from core_solver.errors import ModelError
from core_solver.perception.blazepose import BodyLandmarks, Roi, inverse, transform
from core_solver.perception.multipose import Pose
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.video import open_video

# A person of 170 x 400 pixels facing the camera, in COCO's order, from the middle of the top of the head.
_STANDING = np.float32(
    [[0, 30], [10, 22], [-10, 22], [20, 28], [-20, 28], [45, 80], [-45, 80], [65, 140], [-65, 140], [75, 195],
     [-75, 195], [28, 200], [-28, 200], [30, 290], [-30, 290], [32, 380], [-32, 380]]
)  # fmt: skip
_HANDS_AND_FEET = np.float32(
    [[32, 388], [-32, 388], [40, 398], [-40, 398], [80, 212], [-80, 212], [72, 212], [-72, 212]]
)


def standing_pose(x: float, y: float, score: float = 0.7, turn: float = 0.0) -> Pose:
    """A person whose head top is at (x, y), turned clockwise about it by radians."""
    c, s = np.cos(turn), np.sin(turn)
    keypoints = (_STANDING @ np.array([[c, s], [-s, c]]) + (x, y)).astype(np.float32)
    low, high = keypoints.min(axis=0) - 10, keypoints.max(axis=0) + 10
    return Pose(score, np.concatenate([low, high]).astype(np.float32), keypoints, np.full(17, 0.8, np.float32))


def standing_body(pose: Pose, crop_side: float = 560.0) -> BodyLandmarks:
    """BlazePose in perfect agreement with an upright `standing_pose`."""
    origin = pose.keypoints[0] - _STANDING[0]
    keypoints = np.concatenate([pose.keypoints, _HANDS_AND_FEET + origin]).astype(np.float32)
    roi = Roi(pose.keypoints[[11, 12]].mean(axis=0), crop_side, 0.0)
    mask = np.zeros((256, 256), np.float32)
    low, high = transform(inverse(roi.crop_to_image()), pose.box.reshape(2, 2)).round().astype(int)
    mask[max(low[1], 0) : high[1], max(low[0], 0) : high[0]] = 1
    return BodyLandmarks(
        presence=1.0,
        keypoints=keypoints,
        visibility=np.ones(25, np.float32),
        landmarks=np.zeros((25, 3), np.float32),
        mask=mask,
        crop=np.full((256, 256, 3), (200, 30, 30), np.uint8),
        roi=roi,
    )


def random_observations(rng: np.random.Generator, index: int, people: int, depth: bool = True) -> FrameObservations:
    """Numbers of the right shapes."""

    def floats(*shape: int) -> np.ndarray:
        return rng.random(shape, np.float32)

    detections = tuple(
        Detection(
            float(rng.random()), floats(4), floats(25, 2), floats(25), floats(25, 3), floats(36),
            CroppedMask(int(rng.integers(50)), int(rng.integers(50)),
                        rng.integers(0, 255, tuple(rng.integers(0, 9, 2)), np.uint8)),
        )
        for _ in range(people)
    )  # fmt: skip
    disparity = floats(6, 8).astype(np.float16) if depth else None
    return FrameObservations(FrameInfo(index, index / 30), detections, disparity)


def demo_clip(models) -> Path:
    """The demo's video, as the store keeps it."""
    try:
        return models.require("lab-two-people")
    except ModelError as error:
        pytest.skip(f"the demo clip cannot be had: {error}")


def first_frame(models) -> np.ndarray:
    """(1920, 1088, 3) picture: a man in the middle, a woman near at the right, a bystander at the left."""
    _, picture = next(iter(open_video(demo_clip(models)).frames()))
    return picture
