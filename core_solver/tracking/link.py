"""Identity over time: from detections without names to people over the whole clip."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.perception.observations import FrameObservations
from core_solver.tracking.association import associate
from core_solver.tracking.filling import fill_track
from core_solver.tracking.gaps import link_gaps
from core_solver.tracking.identities import MOST_PEOPLE, Drop, Edit, Somebody, apply_edits
from core_solver.tracking.known import known_people_first, without_unclaimed
from core_solver.tracking.masks import Labels, label_frame
from core_solver.tracking.returns import link_returns
from core_solver.tracking.selection import describe_dropped, select_people
from core_solver.tracking.sights import FrameSights, Sight, frame_sights
from core_solver.tracking.tracks import UNCLAIMED, Modalities


@dataclass(frozen=True)
class FoundPeople:
    """Who is in a clip, before anything is computed for the solver.

    Attributes:
        frames: the sights of every frame of the take.
        people: by id: first those to be solved, then those left out.
    """

    frames: tuple[FrameSights, ...]
    people: Mapping[int, Somebody]


def track_people(
    observations: Sequence[FrameObservations],
    image_size: tuple[int, int],
    label_size: tuple[int, int],
    *,
    people: int | None = None,
    edits: Sequence[Edit] = (),
) -> Modalities:
    """Give every detection a person, fill gaps, and share out the pixels.

    The order of the detections within a frame does not matter, and the same input gives the same output.

    Args:
        observations: one a frame of the take, in order of time.
        image_size: (width, height) pixels of the footage.
        label_size: (width, height) cells of the label grid, the grid of the detections' masks.
        people: solve at most this many, the best seen ones; None for everybody.
        edits: what the user says about who is who.

    Returns:
        The solver's input. `tracks` is empty when nobody was seen long enough; ids count from 1 by first appearance,
        then from left to right.

    Raises:
        UserError: an edit names a person or frame that is not there.
    """
    found = find_people(observations, image_size, people=people)
    return gather(observations, found, image_size, label_size, edits)


def find_people(
    observations: Sequence[FrameObservations], image_size: tuple[int, int], *, people: int | None = None
) -> FoundPeople:
    """Give every detection a person.

    Args:
        observations: one a frame of the take, in order of time.
        image_size: (width, height) pixels of the footage.
        people: solve at most this many, the best seen ones; None for everybody.
    """
    times = _times(observations)
    frames = tuple(frame_sights(o, row) for row, o in enumerate(observations))
    tracklets = known_people_first(
        [f.sights for f in frames], lambda strangers: link_returns(link_gaps(associate(strangers)), image_size)
    )
    selection = select_people(tracklets, times, people)
    everybody = [Somebody(t) for t in selection.people] + [Somebody(t, solved=False) for t in selection.left_out]
    return FoundPeople(frames, dict(enumerate(everybody[:MOST_PEOPLE], 1)))


def gather(
    observations: Sequence[FrameObservations],
    found: FoundPeople,
    image_size: tuple[int, int],
    label_size: tuple[int, int],
    edits: Sequence[Edit] = (),
) -> Modalities:
    """The solver's input for the people that were found, after the user's edits; see `track_people`.

    Raises:
        UserError: an edit names a person or frame that is not there.
    """
    times, numbers = _times(observations), np.array([o.frame.index for o in observations], np.int64)
    people = apply_edits(found.people, edits, numbers.tolist())
    solved = {number: somebody for number, somebody in people.items() if somebody.solved}
    refused = {number for edit in edits if isinstance(edit, Drop) for number in edit.ids}
    return Modalities(
        times=times,
        frames=numbers,
        image_size=image_size,
        tracks=tuple(fill_track(somebody, number, times) for number, somebody in solved.items()),
        labels=without_unclaimed(_label_frames(found.frames, solved, image_size, label_size), observations),
        disparity=_stack_disparity(observations),
        dropped=tuple(
            describe_dropped(somebody.tracklet, times)
            for number, somebody in people.items()
            if not somebody.solved and number not in refused
        ),
    )


def _times(observations: Sequence[FrameObservations]) -> NDArray[np.float64]:
    return np.array([o.frame.time for o in observations], np.float64)


def _label_frames(
    frames: Sequence[FrameSights],
    people: Mapping[int, Somebody],
    image_size: tuple[int, int],
    label_size: tuple[int, int],
) -> Labels:
    owner: dict[Sight, int] = {sight: number for number, p in people.items() for sight in p.tracklet.sights}
    labels = np.zeros((len(frames), label_size[1], label_size[0]), np.uint8)
    for row, frame in enumerate(frames):
        named = [(sight, owner.get(sight, UNCLAIMED)) for sight in frame.sights]
        labels[row] = label_frame(frame.masks, named, image_size, label_size)
    return labels


def _stack_disparity(observations: Sequence[FrameObservations]) -> np.ndarray | None:
    """(T, h, w), or None when any frame comes without."""
    grids = [o.disparity for o in observations if o.disparity is not None]
    return np.stack(grids) if grids and len(grids) == len(observations) else None
