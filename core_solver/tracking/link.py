"""Identity over time: from detections without names to people over the whole clip."""

from collections.abc import Sequence

import numpy as np

from core_solver.perception.observations import FrameObservations
from core_solver.tracking.association import associate
from core_solver.tracking.filling import fill_track
from core_solver.tracking.gaps import link_gaps
from core_solver.tracking.masks import Labels, label_frame
from core_solver.tracking.selection import select_people
from core_solver.tracking.sights import FrameSights, Sight, frame_sights
from core_solver.tracking.tracklets import Tracklet
from core_solver.tracking.tracks import UNCLAIMED, Modalities


def track_people(
    observations: Sequence[FrameObservations],
    image_size: tuple[int, int],
    label_size: tuple[int, int],
    *,
    people: int | None = None,
) -> Modalities:
    """Give every detection a person, fill gaps, and share out the pixels.

    The order of the detections within a frame does not matter, and the same input gives the same output.

    Args:
        observations: one a frame of the take, in order of time.
        image_size: (width, height) pixels of the footage.
        label_size: (width, height) cells of the label grid, the grid of the detections' masks.
        people: solve at most this many, the best seen ones; None for everybody.

    Returns:
        The solver's input. `tracks` is empty when nobody was seen long enough; ids count from 1 by first appearance,
        then from left to right.
    """
    times = np.array([o.frame.time for o in observations], np.float64)
    frames = [frame_sights(o, row) for row, o in enumerate(observations)]
    tracklets = link_gaps(associate([f.sights for f in frames]))
    selection = select_people(tracklets, len(frames), people)
    return Modalities(
        times=times,
        frames=np.array([o.frame.index for o in observations], np.int64),
        image_size=image_size,
        tracks=tuple(fill_track(person, index + 1, times) for index, person in enumerate(selection.people)),
        labels=_label_frames(frames, selection.people, image_size, label_size),
        disparity=_stack_disparity(observations),
        dropped=selection.dropped,
    )


def _label_frames(
    frames: Sequence[FrameSights],
    people: Sequence[Tracklet],
    image_size: tuple[int, int],
    label_size: tuple[int, int],
) -> Labels:
    owner: dict[Sight, int] = {sight: index + 1 for index, person in enumerate(people) for sight in person.sights}
    labels = np.zeros((len(frames), label_size[1], label_size[0]), np.uint8)
    for row, frame in enumerate(frames):
        named = [(sight, owner.get(sight, UNCLAIMED)) for sight in frame.sights]
        labels[row] = label_frame(frame.masks, named, image_size, label_size)
    return labels


def _stack_disparity(observations: Sequence[FrameObservations]) -> np.ndarray | None:
    """(T, h, w), or None when any frame comes without."""
    grids = [o.disparity for o in observations if o.disparity is not None]
    return np.stack(grids) if grids and len(grids) == len(observations) else None
