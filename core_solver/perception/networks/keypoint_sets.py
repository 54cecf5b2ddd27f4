"""Sets of body keypoints in common use, and which of their points are ours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class NamedKeypoints:
    """Keypoints of a picture in the order of `body.KEYPOINT_NAMES`.

    Attributes:
        points: (25, 2) pixels; 0 for unknown ones.
        confidence: (25,) in [0, 1]; 0 for unknown ones.
        known: (25,) bool, whether the set has this keypoint at all.
    """

    points: Floats
    confidence: Floats
    known: NDArray[np.bool_]


@dataclass(frozen=True)
class KeypointSet:
    """A set of keypoints.

    Attributes:
        count: how many it has.
        places: for each of our keypoints its number in the set, -1 where the set lacks it.
    """

    count: int
    places: tuple[int, ...]

    def named(self, points: NDArray, confidence: NDArray) -> NamedKeypoints:
        """Our keypoints from a person's (count, 2) pixels and (count,) confidences."""
        places = np.array(self.places)
        known = places >= 0
        return NamedKeypoints(
            np.where(known[:, None], points[places], 0).astype(np.float32),
            np.where(known, np.clip(confidence[places], 0, 1), 0).astype(np.float32),
            known,
        )


def _set(count: int, **numbers: int) -> KeypointSet:
    return KeypointSet(count, tuple(numbers.get(name, -1) for name in KEYPOINT_NAMES))


_COCO = {name: number for number, name in enumerate(KEYPOINT_NAMES[:17])}

KEYPOINT_SETS: dict[str, KeypointSet] = {
    "coco17": _set(17, **_COCO),
    "halpe26": _set(26, **_COCO, left_toe=20, right_toe=21, left_heel=24, right_heel=25),
    # Feet, face and hands follow the body; the hands' points at the base of index and little finger are ours.
    "coco_wholebody133": _set(
        133, **_COCO, left_toe=17, left_heel=19, right_toe=20, right_heel=22,
        left_index=96, left_pinky=108, right_index=117, right_pinky=129,
    ),
    "body25": _set(
        25, nose=0, right_shoulder=2, right_elbow=3, right_wrist=4, left_shoulder=5, left_elbow=6, left_wrist=7,
        right_hip=9, right_knee=10, right_ankle=11, left_hip=12, left_knee=13, left_ankle=14, right_eye=15, left_eye=16,
        right_ear=17, left_ear=18, left_toe=19, left_heel=21, right_toe=22, right_heel=24,
    ),
}  # fmt: skip
"""By the name that `keypoints` gives."""
