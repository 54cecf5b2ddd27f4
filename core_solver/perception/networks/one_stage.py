"""Reading poses of all people of a picture at once: RTMO and YOLO-pose."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.perception.networks.boxes import corners_from_centres, suppress

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class FoundPeople:
    """People in pixels of the network's input.

    Attributes:
        scores: (n,).
        boxes: (n, 4) left, top, right, bottom.
        points: (n, K, 2).
        confidence: (n, K).
    """

    scores: Floats
    boxes: Floats
    points: Floats
    confidence: Floats


def read_rtmo(dets: Floats, keypoints: Floats, score: float, overlap: float) -> FoundPeople:
    """RTMO: boxes with scores (1, n, 5) and keypoints (1, n, K, 3) x, y, confidence."""
    return _chosen(dets[0, :, 4], dets[0, :, :4], keypoints[0], score, overlap)


def read_yolo(predictions: Floats, score: float, overlap: float) -> FoundPeople:
    """YOLO-pose as it leaves the head: (1, 5 + 3 K, n): centre, size, score, then x, y, confidence a keypoint."""
    rows = predictions[0].T
    sure = rows[rows[:, 4] >= score]  # thousands of rows, of which a handful are people
    return _chosen(sure[:, 4], corners_from_centres(sure[:, :4]), _points(sure[:, 5:]), score, overlap)


def read_yolo_end2end(predictions: Floats, score: float, overlap: float) -> FoundPeople:
    """YOLO-pose without need of suppression: (1, n, 6 + 3 K): corners, score, class, then x, y, confidence each."""
    rows = predictions[0]
    return _chosen(rows[:, 4], rows[:, :4], _points(rows[:, 6:]), score, overlap)


def _points(flat: Floats) -> Floats:
    return flat.reshape(len(flat), flat.shape[1] // 3, 3)


def _chosen(scores: Floats, boxes: Floats, points: Floats, score: float, overlap: float) -> FoundPeople:
    """The finds of at least this score, one a person, surest first."""
    sure = np.flatnonzero(scores >= score)
    kept = sure[suppress(boxes[sure], scores[sure], overlap)]
    return FoundPeople(scores[kept], boxes[kept], points[kept, :, :2], points[kept, :, 2])
