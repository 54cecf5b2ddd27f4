"""What files of the user say about a clip's people, which tracking takes at its word."""

from collections.abc import Callable, Sequence

import cv2
import numpy as np

from core_solver.perception.observations import CroppedMask, FrameObservations
from core_solver.tracking.masks import Labels
from core_solver.tracking.sights import Sight
from core_solver.tracking.tracklets import Tracklet
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED

_HALF = 127  # probability 0.5


def known_people_first(
    frames: Sequence[Sequence[Sight]], track: Callable[[Sequence[Sequence[Sight]]], list[Tracklet]]
) -> list[Tracklet]:
    """One tracklet a person, in order of the first sight: a known identity is neither split nor joined.

    Args:
        frames: the sights of each frame, in order of time.
        track: makes people of sights without identity.
    """
    known: dict[int, list[Sight]] = {}
    for sights in frames:
        for sight in sights:
            if sight.detection.identity is not None:
                known.setdefault(sight.detection.identity, []).append(sight)
    strangers = [[sight for sight in sights if sight.detection.identity is None] for sights in frames]
    named = [Tracklet(tuple(sights)) for sights in known.values()]
    return sorted([*named, *track(strangers)], key=lambda tracklet: tracklet.sights[0].row)


def without_unclaimed(labels: Labels, observations: Sequence[FrameObservations]) -> Labels:
    """Labels (T, h, w) in which no place where somebody may be counts as background; on the grid of their masks."""
    for plane, frame in zip(labels, observations, strict=True):
        for mask in frame.unclaimed:
            covered = _on_grid(mask, plane.shape)
            plane[(plane == BACKGROUND) & covered] = UNCLAIMED
    return labels


def _on_grid(mask: CroppedMask, shape: tuple[int, ...]) -> np.ndarray:
    """(h, w) bool, widened by a cell or two as the masks of known people are."""
    grid = np.zeros(shape, np.uint8)
    rows, columns = mask.values.shape
    grid[mask.top : mask.top + rows, mask.left : mask.left + columns] = mask.values > _HALF
    return cv2.dilate(grid, np.ones((5, 5), np.uint8)).astype(bool)
