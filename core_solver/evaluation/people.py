"""Are the people of a clip found, and kept apart? Tracks against a reference in which a human named everybody.

The measures are those of CLEAR MOT: precision and recall of boxes, switches of identity, fragmentations. People whom
the reference calls hidden and people below the asked height are neutral: who finds them is neither praised nor blamed.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from core_solver.errors import UserError
from core_solver.footage import move_box
from core_solver.tracking.identities import Somebody

Array = NDArray[np.float64]

LEAST_HEIGHT = 60.0  # pixels
LEAST_OVERLAP = 0.4  # intersection over union; a box around joints is narrower than one around clothes and bags

_KEEPS = 1.0  # of overlap: the pair of the frame before is kept where it still fits


@dataclass(frozen=True)
class NamedPerson:
    """Somebody in one frame of the reference.

    Attributes:
        id: the same over the whole clip.
        box: left, top, right, bottom in pixels, round the whole person.
        hidden: less than about half of them can be seen.
    """

    id: int
    box: tuple[float, float, float, float]
    hidden: bool

    @property
    def height(self) -> float:
        """Pixels."""
        return self.box[3] - self.box[1]

    def moved(self, to_first: Array) -> "NamedPerson":
        """The same in a picture moved by a (3, 3) map of pixels."""
        left, top, right, bottom = (float(side) for side in move_box(to_first, np.array(self.box)))
        return replace(self, box=(left, top, right, bottom))


@dataclass(frozen=True)
class PeopleReference:
    """Who is where in some frames of a clip: {frame of the video: people}."""

    image_size: tuple[int, int]
    frames: Mapping[int, tuple[NamedPerson, ...]]

    def within(self, frames: Sequence[int]) -> "PeopleReference":
        """The same for those frames alone that are among these."""
        return PeopleReference(self.image_size, {f: self.frames[f] for f in sorted(self.frames.keys() & set(frames))})

    def moved(self, maps: Mapping[int, Array]) -> "PeopleReference":
        """The same with the boxes of each frame moved by its (3, 3) map of pixels; `maps` has all its frames."""
        return PeopleReference(
            self.image_size, {f: tuple(p.moved(maps[f]) for p in people) for f, people in self.frames.items()}
        )


@dataclass(frozen=True)
class FrameFault:
    """One frame in which something is wrong.

    Attributes:
        frame: of the video.
        missed: ids of the reference that no track shows.
        false: ids of tracks that show nobody.
        switched: ids of the reference that another track shows than the last time.
    """

    frame: int
    missed: tuple[int, ...]
    false: tuple[int, ...]
    switched: tuple[int, ...]


@dataclass(frozen=True)
class PeopleScores:
    """How well people were found and kept apart.

    Attributes:
        people: how many different people the reference asks for.
        wanted: how many boxes it asks for.
        found: how many of those a track shows.
        false: boxes of tracks that show nobody.
        switches: how often a person is shown by another track than the last time.
        fragmentations: how often a person's track is interrupted and goes on later.
        tracks_of: {id of the reference: ids of the tracks that show this person, by first appearance}.
        faults: the frames in which something is wrong.
    """

    people: int
    wanted: int
    found: int
    false: int
    switches: int
    fragmentations: int
    tracks_of: Mapping[int, tuple[int, ...]]
    faults: tuple[FrameFault, ...]

    @property
    def precision(self) -> float:
        """Share of the tracks' boxes that show somebody; 1 without any."""
        shown = self.found + self.false
        return self.found / shown if shown else 1.0

    @property
    def recall(self) -> float:
        """Share of the wanted boxes that a track shows; 1 without any."""
        return self.found / self.wanted if self.wanted else 1.0


def read_people(path: Path) -> PeopleReference:
    """A reference file: JSON with `image_size` and `frames` of people, each with `id`, `box` and perhaps `hidden`.

    Raises:
        UserError: missing, or not such a file.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
        width, height = (int(v) for v in raw["image_size"])
        frames = {int(f["frame"]): tuple(_person(p) for p in f["people"]) for f in raw["frames"]}
    except OSError as error:
        raise UserError(f"there is no reference {path}: check the path") from error
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{path.name} is no reference of people: it needs image_size and frames ({error})") from error
    return PeopleReference((width, height), frames)


def people_boxes(
    people: Mapping[int, Somebody], frames: Sequence[int], longest_gap: int = 0
) -> dict[int, dict[int, Array]]:
    """{frame of the video: {id: box (4,)}} of the people who are solved.

    Args:
        people: by id.
        frames: (T,) number in the video of every row.
        longest_gap: rows without a sight over which a track is taken to go on in a straight line; 0 for seen rows only.
    """
    boxes: dict[int, dict[int, Array]] = {int(frame): {} for frame in frames}
    for number, somebody in people.items():
        if not somebody.solved:
            continue
        rows = np.array([s.row for s in somebody.tracklet.sights])
        seen = np.stack([s.detection.box for s in somebody.tracklet.sights]).astype(float)
        for row in range(rows[0], rows[-1] + 1):
            after = int(np.searchsorted(rows, row))
            if rows[after] == row or rows[after] - rows[after - 1] - 1 <= longest_gap:
                boxes[int(frames[row])][number] = np.array([np.interp(row, rows, side) for side in seen.T])
    return boxes


def score_people(
    reference: PeopleReference,
    boxes: Mapping[int, Mapping[int, Array]],
    *,
    least_height: float = LEAST_HEIGHT,
    least_overlap: float = LEAST_OVERLAP,
) -> PeopleScores:
    """Compare tracks with the reference, over the reference's frames.

    Args:
        reference: who is where.
        boxes: {frame: {track id: box (4,)}}.
        least_height: pixels; smaller people are neutral.
        least_overlap: intersection over union from which a box shows a person.
    """
    wanted = found = false = switches = fragmentations = 0
    shown_by: dict[int, list[int]] = {}
    interrupted: set[int] = set()
    faults: list[FrameFault] = []
    before: dict[int, int] = {}
    for frame in sorted(reference.frames):
        people, tracks = reference.frames[frame], boxes.get(frame, {})
        pairs = _match(people, tracks, before, least_overlap)
        asked = [p.id for p in people if not p.hidden and p.height >= least_height]
        missed = [i for i in asked if i not in pairs]
        strangers = [t for t in tracks if t not in pairs.values()]
        switched = [i for i in asked if i in pairs and shown_by.get(i) and shown_by[i][-1] != pairs[i]]
        fragmentations += sum(i in interrupted and i in pairs for i in asked)
        interrupted = (interrupted - pairs.keys()) | {i for i in missed if i in shown_by}
        wanted, found, false = wanted + len(asked), found + len(asked) - len(missed), false + len(strangers)
        switches += len(switched)
        for person in asked:
            if person in pairs and shown_by.setdefault(person, [])[-1:] != [pairs[person]]:
                shown_by[person].append(pairs[person])
        before = {**before, **pairs}
        if missed or strangers or switched:
            faults.append(FrameFault(frame, tuple(missed), tuple(strangers), tuple(switched)))
    everybody = {p.id for people in reference.frames.values() for p in people if _is_asked(p, least_height)}
    tracks_of = {i: tuple(dict.fromkeys(shown_by.get(i, ()))) for i in sorted(everybody)}
    return PeopleScores(len(everybody), wanted, found, false, switches, fragmentations, tracks_of, tuple(faults))


def describe_scores(scores: PeopleScores) -> list[str]:
    """Lines for people to read."""
    boxes = f"{scores.found} of {scores.wanted} boxes, {scores.false} false"
    lines = [
        f"people {scores.people}, precision {scores.precision:.3f}, recall {scores.recall:.3f} ({boxes})",
        f"identity switches {scores.switches}, fragmentations {scores.fragmentations}",
    ]
    lines += [f"person {i}: {_listed('track', tracks)}" for i, tracks in scores.tracks_of.items()]
    for fault in scores.faults:
        what = (("missed person", fault.missed), ("false track", fault.false), ("switched person", fault.switched))
        lines.append(f"frame {fault.frame}: " + "; ".join(_listed(name, ids) for name, ids in what if ids))
    return lines


def _listed(name: str, ids: Sequence[int]) -> str:
    return f"{name} {', '.join(map(str, ids))}" if ids else f"no {name}"


def _is_asked(person: NamedPerson, least_height: float) -> bool:
    return not person.hidden and person.height >= least_height


def _person(raw: Mapping[str, object]) -> NamedPerson:
    left, top, right, bottom = (float(v) for v in raw["box"])  # type: ignore[attr-defined]
    return NamedPerson(int(raw["id"]), (left, top, right, bottom), bool(raw.get("hidden", False)))  # type: ignore[call-overload]


def _match(
    people: Sequence[NamedPerson], tracks: Mapping[int, Array], before: Mapping[int, int], least_overlap: float
) -> dict[int, int]:
    """{id of the reference: track id}; a pair of earlier frames is kept where it still overlaps enough."""
    if not people or not tracks:
        return {}
    ids = list(tracks)
    overlap = np.array([[_overlap(np.array(p.box), tracks[t]) for t in ids] for p in people])
    kept = np.array([[before.get(p.id) == t for t in ids] for p in people])
    gain = np.where(overlap >= least_overlap, overlap + _KEEPS * kept, 0.0)
    rows, columns = linear_sum_assignment(-gain)
    return {people[r].id: ids[c] for r, c in zip(rows, columns, strict=True) if gain[r, c] > 0}


def _overlap(a: Array, b: Array) -> float:
    """Intersection over union of two boxes (4,)."""
    size = np.maximum(np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2]), 0)
    both = float(size.prod())
    return both / max(float((a[2:] - a[:2]).prod() + (b[2:] - b[:2]).prod()) - both, 1e-9)
