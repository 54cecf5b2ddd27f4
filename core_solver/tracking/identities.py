"""What the user says about who is who: `identities.json`, its edits, and what they do to people.

An edit works on sights alone, so that it needs no network: who was seen where stays, only whose it is changes.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from core_solver.errors import UserError
from core_solver.tracking.sights import Sight
from core_solver.tracking.tracklets import Tracklet

MOST_PEOPLE = 254  # ids are the values of a label grid of bytes, where 0 and 255 mean something else
_LONGEST_NAME = 60


@dataclass(frozen=True, eq=False)
class Somebody:
    """A person of the clip, or somebody seen too briefly to be solved.

    Attributes:
        tracklet: the sights.
        name: given by the user; empty for the default one.
        solved: whether this person goes into the take.
    """

    tracklet: Tracklet
    name: str = ""
    solved: bool = True


People = dict[int, Somebody]


@dataclass(frozen=True)
class Merge:
    """All of these are the first one; what is merged is solved."""

    ids: tuple[int, ...]


@dataclass(frozen=True)
class Split:
    """From this frame of the video on it is somebody else, who gets the next free id."""

    id: int
    frame: int


@dataclass(frozen=True)
class Swap:
    """From this frame of the video on the two are each other."""

    ids: tuple[int, int]
    frame: int


@dataclass(frozen=True)
class Drop:
    """These are not solved; their pixels are nobody's evidence."""

    ids: tuple[int, ...]


@dataclass(frozen=True)
class Rename:
    """Names for the take."""

    names: Mapping[int, str]


Edit = Merge | Split | Swap | Drop | Rename


def read_edits(path: Path) -> tuple[Edit, ...]:
    """The edits of an identities file.

    Raises:
        UserError: missing, not JSON, or an entry that is none of the five edits; the message names the entry.
    """
    try:
        raw = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"there is no identities file {path}: check --identities") from error
    except ValueError as error:
        raise UserError(f"{path.name} is not JSON: {error}") from error
    entries = raw.get("edits", []) if isinstance(raw, dict) else None
    if not isinstance(entries, list):
        raise UserError(f'{path.name} must be an object with a list "edits"')
    return tuple(_parse(entry, f"{path.name}: edit {number}") for number, entry in enumerate(entries, 1))


def apply_edits(people: Mapping[int, Somebody], edits: Sequence[Edit], frames: Sequence[int]) -> People:
    """The people after the edits, in the order of their ids.

    Args:
        people: whom tracking found, by id.
        edits: applied one after the other.
        frames: (T,) number in the video of every row.

    Raises:
        UserError: an edit names a person or frame that is not there; the message names the edit.
    """
    edited = dict(people)
    for number, edit in enumerate(edits, 1):
        try:
            _apply(edited, edit, frames)
        except _EditError as refusal:
            raise UserError(f"identities: edit {number} ({type(edit).__name__.lower()}): {refusal}") from refusal
    return dict(sorted(edited.items()))


def write_identities(
    path: Path,
    found: Mapping[int, Somebody],
    edits: Sequence[Edit],
    frames: Sequence[int],
    colours: Mapping[int, tuple[float, float, float]],
) -> None:
    """Write whom tracking found, in a form to be edited; the edits that were applied are kept in it.

    An older file with other edits is kept beside it as `NAME.old.json`: they may be somebody's work.

    Args:
        path: where to.
        found: before the edits, because edits name these ids.
        edits: applied.
        frames: (T,) number in the video of every row.
        colours: in the take, of those who are in it.

    Raises:
        UserError: the file cannot be written.
    """
    people = [_described(i, somebody, frames, colours) for i, somebody in found.items()]
    lines = [f"  {json.dumps(person, ensure_ascii=False)}" for person in people]
    changes = [f"  {json.dumps(_as_json(edit), ensure_ascii=False)}" for edit in edits]
    text = '{\n "people": [\n' + ",\n".join(lines) + '\n ],\n "edits": [\n' + ",\n".join(changes) + "\n ]\n}\n"
    partial = path.with_suffix(".partial")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if _holds_other_edits(path, edits):
            os.replace(path, path.with_suffix(".old.json"))  # noqa: PTH105
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)  # noqa: PTH105 - the pair of calls that is atomic everywhere
    except OSError as error:
        raise UserError(f"cannot write {path} ({error.strerror or error}): choose another output path") from error


def _holds_other_edits(path: Path, edits: Sequence[Edit]) -> bool:
    if not path.is_file():
        return False
    try:
        return read_edits(path) not in ((), tuple(edits))
    except UserError:  # half written by hand
        return True


class _EditError(Exception):
    """What is wrong with an edit, without its number."""


def _described(
    number: int, somebody: Somebody, frames: Sequence[int], colours: Mapping[int, tuple[float, float, float]]
) -> dict[str, object]:
    rows = [s.row for s in somebody.tracklet.sights]
    described: dict[str, object] = {
        "id": number,
        "name": somebody.name or f"Person {number}",
        "first_frame": int(frames[rows[0]]),
        "last_frame": int(frames[rows[-1]]),
        "seen_frames": len(rows),
        "solved": somebody.solved,
    }
    return described | ({"colour": list(colours[number])} if number in colours else {})


def _as_json(edit: Edit) -> dict[str, object]:
    match edit:
        case Merge(ids):
            return {"merge": list(ids)}
        case Split(number, frame):
            return {"split": {"id": number, "frame": frame}}
        case Swap(ids, frame):
            return {"swap": {"ids": list(ids), "frame": frame}}
        case Drop(ids):
            return {"drop": list(ids)}
        case Rename(names):
            return {"rename": {str(number): name for number, name in names.items()}}


def _parse(entry: object, where: str) -> Edit:
    if not isinstance(entry, dict) or len(entry) != 1 or next(iter(entry)) not in _PARSE:
        raise UserError(f"{where} must be one of {', '.join(_PARSE)}, like {{{_EXAMPLE}}}")
    ((kind, value),) = entry.items()
    try:
        return _PARSE[kind](value)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UserError(f"{where} ({kind}) must look like {{{_FORMS[kind]}}}") from error


_EXAMPLE = '"merge": [1, 4]'
_FORMS = {
    "merge": _EXAMPLE,
    "split": '"split": {"id": 2, "frame": 120}',
    "swap": '"swap": {"ids": [1, 3], "frame": 88}',
    "drop": '"drop": [5]',
    "rename": '"rename": {"1": "Anna"}',
}


def _whole(value: object) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise TypeError(value)
    return value


def _ids(value: object, least: int = 1, most: int = MOST_PEOPLE) -> tuple[int, ...]:
    if not isinstance(value, list):
        raise TypeError(value)
    ids = tuple(_whole(v) for v in value)
    if not least <= len(ids) <= most or len(set(ids)) < len(ids):
        raise ValueError(value)
    return ids


def _only(value: dict[str, object], *keys: str) -> dict[str, object]:
    if set(value) != set(keys):
        raise KeyError(*keys)
    return value


def _parse_split(value: dict[str, object]) -> Split:
    return Split(_whole(_only(value, "id", "frame")["id"]), _whole(value["frame"]))


def _parse_swap(value: dict[str, object]) -> Swap:
    first, second = _ids(_only(value, "ids", "frame")["ids"], 2, 2)
    return Swap((first, second), _whole(value["frame"]))


def _parse_rename(value: dict[str, str]) -> Rename:
    names = {int(number): name.strip() for number, name in value.items()}
    if not names or not all(n and len(n) <= _LONGEST_NAME and n.isprintable() for n in names.values()):
        raise ValueError(value)
    return Rename(names)


_PARSE: dict[str, Callable[..., Edit]] = {
    "merge": lambda value: Merge(_ids(value, 2)),
    "split": _parse_split,
    "swap": _parse_swap,
    "drop": lambda value: Drop(_ids(value)),
    "rename": _parse_rename,
}


def _apply(people: People, edit: Edit, frames: Sequence[int]) -> None:
    match edit:
        case Merge(ids):
            _merge(people, ids)
        case Split(number, frame):
            _split(people, number, frame, frames)
        case Swap(ids, frame):
            _swap(people, ids, frame, frames)
        case Drop(ids):
            _require(people, *ids)
            people.update({number: replace(people[number], solved=False) for number in ids})
        case Rename(names):
            _require(people, *names)
            people.update({number: replace(people[number], name=name) for number, name in names.items()})


def _require(people: People, *ids: int) -> None:
    for number in ids:
        if number not in people:
            raise _EditError(f"there is no person {number} here; there are {', '.join(map(str, sorted(people)))}")


def _merge(people: People, ids: tuple[int, ...]) -> None:
    _require(people, *ids)
    parts = [people.pop(number) for number in ids]
    by_row = {s.row: s for part in reversed(parts) for s in part.tracklet.sights}  # where two were seen: the first
    tracklet = Tracklet(tuple(by_row[row] for row in sorted(by_row)))
    people[ids[0]] = Somebody(tracklet, next((p.name for p in parts if p.name), ""))


def _split(people: People, number: int, frame: int, frames: Sequence[int]) -> None:
    _require(people, number)
    before, after = _cut(people[number].tracklet, frame, frames)
    if not before or not after:
        when = f"before frame {frame}" if after else f"from frame {frame} on"
        raise _EditError(f"person {number} was never seen {when}")
    new = max(people) + 1
    if new > MOST_PEOPLE:
        raise _EditError(f"there can be no more than {MOST_PEOPLE} people")
    people[new] = Somebody(Tracklet(after), solved=people[number].solved)
    people[number] = replace(people[number], tracklet=Tracklet(before))


def _cut(tracklet: Tracklet, frame: int, frames: Sequence[int]) -> tuple[tuple[Sight, ...], tuple[Sight, ...]]:
    """The sights before a frame of the video, and those from it on."""
    before = tuple(s for s in tracklet.sights if frames[s.row] < frame)
    return before, tracklet.sights[len(before) :]


def _swap(people: People, ids: tuple[int, int], frame: int, frames: Sequence[int]) -> None:
    _require(people, *ids)
    first, second = ids
    first_before, first_after = _cut(people[first].tracklet, frame, frames)
    second_before, second_after = _cut(people[second].tracklet, frame, frames)
    for number, sights in ((first, first_before + second_after), (second, second_before + first_after)):
        if not sights:
            raise _EditError(f"nothing of person {number} would be left: use rename instead")
        people[number] = replace(people[number], tracklet=Tracklet(sights))
