"""Whose pixels are whose: soft masks compete, and each belongs to the person whose joints it holds."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.perception.observations import CroppedMask
from core_solver.tracking.sights import Sight
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED

Labels = NDArray[np.uint8]

_HALF = 127  # probability 0.5
_CONFIDENT = 0.3
_ERODE = np.ones((3, 3), np.uint8)
_DILATE = np.ones((5, 5), np.uint8)
_REACH = 2  # cells by which erosion and dilation can change an outline


def label_frame(
    masks: Sequence[CroppedMask],
    people: Sequence[tuple[Sight, int]],
    image_size: tuple[int, int],
    label_size: tuple[int, int],
) -> Labels:
    """One frame's label grid.

    Where a person without a mask may be, nothing is background.

    Args:
        masks: of all detections.
        people: the frame's sights, each with its track's id, or UNCLAIMED if nobody solves it.
        image_size: (width, height) pixels.
        label_size: (width, height) cells over the whole image.

    Returns:
        (height, width): BACKGROUND, an id, or UNCLAIMED.
    """
    width, height = label_size
    cells = [_confident_cells(sight, image_size, label_size) for sight, _ in people]
    surest = np.full((height, width), _HALF, np.uint8)
    labels = np.full((height, width), BACKGROUND, np.uint8)
    for mask in masks:
        values, place = _clipped(mask, label_size)
        votes = [_votes(values, place, own) for own in cells]
        # Whoever has no mask stands mostly behind somebody else, whose mask then holds the joints of both.
        owned = [
            vote if sight.detection.mask.values.size else 0 for vote, (sight, _) in zip(votes, people, strict=True)
        ]
        votes = owned if any(owned) else votes
        owner = people[int(np.argmax(votes))][1] if votes and max(votes) > 0 else UNCLAIMED
        wins = values > surest[place]
        surest[place][wins] = values[wins]
        labels[place][wins] = owner
    for sight, _ in people:
        if not sight.detection.mask.values.size:
            place = labels[_box_cells(sight, image_size, label_size)]
            place[place == BACKGROUND] = UNCLAIMED
    return _smoothed(labels)


def _box_cells(sight: Sight, image_size: tuple[int, int], label_size: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of the label grid that a sight's box touches."""
    left, top, right, bottom = sight.detection.box * np.tile(np.array(label_size) / image_size, 2)
    rows = slice(max(int(top), 0), max(int(np.ceil(bottom)), 0))
    return rows, slice(max(int(left), 0), max(int(np.ceil(right)), 0))


def _confident_cells(sight: Sight, image_size: tuple[int, int], label_size: tuple[int, int]) -> NDArray[np.int64]:
    """(n, 2) column and row of each confident keypoint on the label grid."""
    confident = sight.detection.confidence > _CONFIDENT
    scale = np.array(label_size, float) / image_size
    return np.floor(sight.detection.keypoints[confident] * scale).astype(np.int64)


def _clipped(mask: CroppedMask, label_size: tuple[int, int]) -> tuple[NDArray[np.uint8], tuple[slice, slice]]:
    """The part of a mask that lies on the grid, and where."""
    width, height = label_size
    rows, columns = mask.values.shape
    top, left = max(mask.top, 0), max(mask.left, 0)
    bottom, right = max(min(mask.top + rows, height), top), max(min(mask.left + columns, width), left)
    values = mask.values[top - mask.top : bottom - mask.top, left - mask.left : right - mask.left]
    return values, (slice(top, top + values.shape[0]), slice(left, left + values.shape[1]))


def _votes(values: NDArray[np.uint8], place: tuple[slice, slice], cells: NDArray[np.int64]) -> int:
    """How many of a person's confident keypoints lie inside a mask."""
    column, row = cells[:, 0] - place[1].start, cells[:, 1] - place[0].start
    inside = (row >= 0) & (row < values.shape[0]) & (column >= 0) & (column < values.shape[1])
    return int(np.count_nonzero(values[row[inside], column[inside]] > _HALF))


def _smoothed(labels: Labels) -> Labels:
    """Erode each label by 3x3, then dilate it by 5x5 into the background, never into another label's cells.

    A person's cell that erosion took away stays UNCLAIMED: it is nobody's evidence and not background either.
    """
    result = np.where(labels == BACKGROUND, BACKGROUND, UNCLAIMED).astype(np.uint8)
    for owner in np.unique(labels[labels != BACKGROUND]):
        place = _around(labels == owner)
        own = labels[place] == owner
        grown = cv2.dilate(cv2.erode(own.astype(np.uint8), _ERODE), _DILATE).astype(bool)
        free = (labels[place] == BACKGROUND) & (result[place] == BACKGROUND)
        result[place][grown & (own | free)] = owner
    return result


def _around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The smallest window of a mask, widened so that dilation stays inside it."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return (
        slice(max(int(rows[0]) - _REACH, 0), int(rows[-1]) + 1 + _REACH),
        slice(max(int(columns[0]) - _REACH, 0), int(columns[-1]) + 1 + _REACH),
    )
