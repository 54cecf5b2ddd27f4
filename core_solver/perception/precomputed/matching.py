"""Who is who among the modalities of one frame: SMPL poses and masks go to the people with joints."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from core_solver.perception.observations import CroppedMask, Detection
from core_solver.perception.precomputed.joint_tables import COCO_JOINTS, SMPL_JOINTS

Array = NDArray[np.float64]
Grid = NDArray[np.uint8]

_CONFIDENT = 0.3
_LEAST_SHARED = 3  # joints
_GATE = 0.25  # of a person's size: mean distance beyond which a pose is somebody else's
_IMPOSSIBLE = 1e6
_INSIDE = 127  # of 255
_MASK_EDGE = 25  # of 255: cells below are outside


def match_poses(people: Sequence[Detection], pixels: Sequence[Array]) -> dict[int, int]:
    """The SMPL pose of each person: Hungarian assignment on the mean distance of confident joints, with a gate.

    Args:
        people: the frame's.
        pixels: (24, 2) of each pose's joints.

    Returns:
        {person: pose}; who has no pose within the gate is left out.
    """
    if not people or not pixels:
        return {}
    costs = np.array([[_distance(person, pose) for pose in pixels] for person in people])
    pairs = zip(*linear_sum_assignment(np.where(costs < _GATE, costs, _IMPOSSIBLE)), strict=True)
    return {int(person): int(pose) for person, pose in pairs if costs[person, pose] < _GATE}


def _distance(person: Detection, pose: Array) -> float:
    """Mean distance of the joints that are confident, in sizes of the person."""
    seen = person.confidence[COCO_JOINTS] > _CONFIDENT
    if np.count_nonzero(seen) < _LEAST_SHARED:
        return _IMPOSSIBLE
    apart = np.linalg.norm(person.keypoints[COCO_JOINTS] - pose[SMPL_JOINTS], axis=1)[seen]
    size = max(float(np.max(person.box[2:] - person.box[:2])), 1.0)
    return float(apart.mean()) / size


@dataclass(frozen=True)
class SharedMasks:
    """Whose masks are whose.

    Attributes:
        owned: for each person their masks, the one that holds most of their joints first.
        nobodys: masks in which nobody's joints lie.
    """

    owned: tuple[tuple[int, ...], ...]
    nobodys: tuple[int, ...]


def share_masks(people: Sequence[Detection], masks: Sequence[Grid], picture: tuple[int, int]) -> SharedMasks:
    """Each mask goes to the person with most confident joints inside.

    Args:
        people: the frame's.
        masks: (h, w) probability times 255, all on one grid laid over the picture.
        picture: (width, height) pixels.
    """
    votes = np.array([[_votes(person, mask, picture) for mask in masks] for person in people])
    votes = votes.reshape(len(people), len(masks))
    owner = [int(votes[:, m].argmax()) if votes[:, m].any() else None for m in range(len(masks))]
    owned = tuple(
        tuple(sorted((m for m, o in enumerate(owner) if o == person), key=lambda m: -votes[person, m]))
        for person in range(len(people))
    )
    return SharedMasks(owned, tuple(m for m, o in enumerate(owner) if o is None))


def _votes(person: Detection, mask: Grid, picture: tuple[int, int]) -> int:
    """How many of a person's confident joints lie inside a mask."""
    height, width = mask.shape
    confident = person.keypoints[person.confidence > _CONFIDENT]
    cells = np.floor(confident * (np.array([width, height]) / picture)).astype(np.int64)
    cells = cells[np.all((cells >= 0) & (cells < (width, height)), axis=1)]
    return int(np.count_nonzero(mask[cells[:, 1], cells[:, 0]] > _INSIDE))


def cropped(values: Grid) -> CroppedMask:
    """A mask (h, w) on the whole label grid, cut to where it is."""
    rows = np.flatnonzero((values >= _MASK_EDGE).any(axis=1))
    columns = np.flatnonzero((values >= _MASK_EDGE).any(axis=0))
    if len(rows) == 0:
        return empty_mask()
    inner = values[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return CroppedMask(int(rows[0]), int(columns[0]), np.ascontiguousarray(inner))


def empty_mask() -> CroppedMask:
    """The mask of somebody of whom no mask is known."""
    return CroppedMask(0, 0, np.zeros((0, 0), np.uint8))
