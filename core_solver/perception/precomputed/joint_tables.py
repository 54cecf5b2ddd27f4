"""Where the keypoints of other programs' skeletons stand among our 25."""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES

_NOWHERE = -1
_COCO = (*range(17),)

RESULT_TABLES: dict[int, tuple[int, ...]] = {
    17: _COCO,
    26: (*_COCO, 24, 25, 20, 21),
    133: (*_COCO, 19, 22, 17, 20, 96, 117, 108, 129),
    136: (*_COCO, 24, 25, 20, 21, 99, 120, 111, 132),
}
"""By the number of keypoints: COCO, Halpe, COCO-WholeBody and Halpe with face and hands."""

OPENPOSE_TABLES: dict[int, tuple[int, ...]] = {
    18: (0, 15, 14, 17, 16, 5, 2, 6, 3, 7, 4, 11, 8, 12, 9, 13, 10),
    25: (0, 16, 15, 18, 17, 5, 2, 6, 3, 7, 4, 12, 9, 13, 10, 14, 11, 21, 24, 19, 22),
}
"""By the number of keypoints: COCO-18 and BODY_25."""

# A keypoint that a skeleton lacks lies at its wrist or ankle, unseen: a place must be there, and none is nearer.
_STAND_INS = np.array([*range(17), 15, 16, 15, 16, 9, 10, 9, 10])

SMPL_JOINTS = np.array([16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8])
"""SMPL's shoulders, elbows, wrists, hips, knees and ankles..."""

COCO_JOINTS = np.arange(5, 17)
"""...and the keypoints that mark the same places."""


def our_keypoints(
    points: NDArray[np.float64], table: tuple[int, ...]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Keypoints (25, 2) and confidence (25,) from a skeleton's (n, 3) x, y, confidence."""
    source = np.array([*table, *[_NOWHERE] * (len(KEYPOINT_NAMES) - len(table))])
    known = source != _NOWHERE
    keypoints = np.where(known[:, None], points[source, :2], 0)
    keypoints = np.where(known[:, None], keypoints, keypoints[_STAND_INS])
    return keypoints.astype(np.float32), np.where(known, points[source, 2], 0).astype(np.float32)
