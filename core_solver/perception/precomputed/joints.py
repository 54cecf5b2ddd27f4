"""2D joints from AlphaPose, OpenPose and COCO JSON files."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.perception.precomputed.files import as_identity, as_numbers, as_whole_number, read_json
from core_solver.perception.precomputed.joint_tables import OPENPOSE_TABLES, RESULT_TABLES, our_keypoints
from core_solver.perception.precomputed.numbering import frame_numbers

Floats = NDArray[np.float32]

_PERSON = 1  # COCO's category
_FARTHEST = 1e5  # pixels; no picture is that large
_MOST_CONFIDENT = 1.2  # networks without a sigmoid overshoot 1 a little: cut off there; more is no confidence
_LABELLED = 0.5  # confidence of a keypoint that COCO's annotations call labelled, but hidden
_ALPHAPOSE = "alphapose-results.json"


@dataclass(frozen=True)
class GivenPerson:
    """One person's joints as a file gives them.

    Attributes:
        score: in [0, 1].
        keypoints: (25, 2) pixels of the file's picture, in the order of `body.KEYPOINT_NAMES`.
        confidence: (25,) in [0, 1]; 0 for what the file's skeleton lacks.
        identity: the same number for the same person in all frames; None where the file does not say.
    """

    score: float
    keypoints: Floats
    confidence: Floats
    identity: int | None = None


@dataclass(frozen=True)
class GivenJoints:
    """People by frame number.

    Attributes:
        people: of each frame that the files speak of, as they count.
        names_empty_frames: whether a frame without people would have a file, too: a missing one is then unknown, and
            not empty.
        size: (width, height) of the pictures, where the files say.
        notes: sentences about what was repaired.
    """

    people: Mapping[int, tuple[GivenPerson, ...]]
    names_empty_frames: bool
    size: tuple[int, int] | None = None
    notes: tuple[str, ...] = ()


def read_joints(path: Path) -> GivenJoints:
    """Joints from one JSON file or a folder of them.

    Args:
        path: AlphaPose's results, COCO keypoint results (a list, or a table with "annotations" and "images"), or a
            folder with one of these, with COCO results and a second file with "images", or with OpenPose's files.

    Raises:
        UserError: nothing there, damaged, of another kind, or with numbers that cannot be joints.
    """
    files = _json_files(path)
    documents = {file: read_json(file) for file in files}
    frames = {file: d for file, d in documents.items() if isinstance(d, dict) and "people" in d}
    if frames:
        strange = next((file for file in files if file not in frames), None)
        if strange is not None:
            raise UserError(f"{strange} is no OpenPose file like the others of its folder: take it away")
        return _unique_identities(_read_openpose(frames), path)
    images = next((d["images"] for d in documents.values() if isinstance(d, dict) and "images" in d), None)
    results = [(file, d) for file, d in documents.items() if isinstance(d, list) or "annotations" in _table(d)]
    if len(results) != 1:
        raise UserError(f"{path} holds {len(results)} lists of joints where one is needed: name it in modalities.toml")
    file, document = results[0]
    people = document if isinstance(document, list) else document["annotations"]
    return _unique_identities(_read_results(people, images, file), file)


def _json_files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    files = sorted(path.glob("*.json"))
    if not files:
        raise UserError(f"{path} holds no JSON files with joints: put AlphaPose's, OpenPose's or COCO's there")
    return [path / _ALPHAPOSE] if path / _ALPHAPOSE in files else files


def _table(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def _read_openpose(frames: Mapping[Path, dict[str, Any]]) -> GivenJoints:
    numbers = frame_numbers([file.name for file in frames])
    people = {}
    for number, (file, document) in zip(numbers, frames.items(), strict=True):
        listed = document["people"]
        if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
            raise UserError(f'{file}: "people" must be a list of tables: write it again with OpenPose')
        found = [
            _person(entry.get("pose_keypoints_2d"), OPENPOSE_TABLES, file, None, as_identity(entry.get("person_id")))
            for entry in listed
        ]
        people[number] = tuple(p for p in found if p is not None)
    return GivenJoints(people, names_empty_frames=True)


def _read_results(entries: Any, images: Any, file: Path) -> GivenJoints:
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise UserError(f"{file} must hold a list of people: write it again with AlphaPose or in COCO's form")
    names, size = read_images(images, file)
    persons = [entry for entry in entries if entry.get("category_id", _PERSON) == _PERSON]
    numbers = image_numbers([entry.get("image_id") for entry in persons], names, file)
    people: dict[int, tuple[GivenPerson, ...]] = {}
    for number, entry in zip(numbers, persons, strict=True):
        identity = as_identity(entry.get("idx", entry.get("track_id")))
        person = _person(entry.get("keypoints"), RESULT_TABLES, file, entry.get("score"), identity)
        people[number] = people.get(number, ()) + ((person,) if person is not None else ())
    return GivenJoints(people, names_empty_frames=False, size=size)


def image_numbers(image_ids: Iterable[Any], names: Mapping[Any, str], file: Path) -> list[int]:
    """The frame numbers that image ids stand for.

    Args:
        image_ids: whole numbers or file names.
        names: file names of ids, where a list of images gives them.
        file: where they stand, for the message.

    Raises:
        UserError: an id says nothing about its frame.
    """
    ids = [image_id if isinstance(image_id, str) else as_whole_number(image_id) for image_id in image_ids]
    if any(image_id is None for image_id in ids):
        raise UserError(f'{file}: each "image_id" must be a file name or a number: write the file again')
    listed = [names.get(image_id, image_id) for image_id in ids]
    named = sorted({str(name) for name in listed if isinstance(name, str)})
    number_of = dict(zip(named, frame_numbers(named), strict=True)) if named else {}
    return [number_of[name] if isinstance(name, str) else int(name) for name in listed]  # type: ignore[arg-type]


def read_images(images: Any, file: Path) -> tuple[dict[Any, str], tuple[int, int] | None]:
    """A COCO list of images: the file name of each id, and the (width, height) of all.

    Raises:
        UserError: no such list, or pictures of several sizes.
    """
    if images is None:
        return {}, None
    if not isinstance(images, list) or not all(isinstance(i, dict) and not _unhashable(i.get("id")) for i in images):
        raise UserError(f'{file}: "images" must be a list of tables with "id" and "file_name": write it again')
    names = {i.get("id"): i["file_name"] for i in images if isinstance(i.get("file_name"), str)}
    sizes = {(as_whole_number(i.get("width")), as_whole_number(i.get("height"))) for i in images}
    if len(sizes) > 1:
        raise UserError(f"{file}: its images have several sizes: a clip has one")
    width, height = sizes.pop() if sizes else (None, None)
    return names, (width, height) if width and height and min(width, height) > 0 else None


def _unhashable(value: Any) -> bool:
    return isinstance(value, list | dict)


def _person(
    raw: Any, tables: Mapping[int, tuple[int, ...]], file: Path, score: Any, identity: int | None
) -> GivenPerson | None:
    """A person from a flat list of x, y, confidence; None when no joint of theirs was seen."""
    values = as_numbers([] if raw is None else raw, file, "keypoints").ravel()
    count, rest = divmod(values.size, 3)
    if rest or count not in tables:
        known = ", ".join(map(str, sorted(tables)))
        raise UserError(f"{file}: {values.size} numbers for a person are not x, y, confidence of {known} keypoints")
    points = _seen(values.reshape(count, 3), file)
    keypoints, confidence = our_keypoints(points, tables[count])
    if not (confidence > 0).any():
        return None
    # AlphaPose's score of a whole person is a sum of several and runs to 4: the joints' mean says more.
    given = as_numbers(np.nan if score is None else score, file, "score")
    in_range = given.ndim == 0 and 0 <= float(given) <= 1
    own = confidence[confidence > 0].mean()
    return GivenPerson(float(given) if in_range else float(own), keypoints, confidence, identity)


def _seen(points: NDArray[np.float64], file: Path) -> NDArray[np.float64]:
    """Points (n, 3) with confidences in [0, 1]; what is no number, or no place, was not seen."""
    missing = np.asarray(~np.isfinite(points).all(axis=1) | (np.abs(points[:, :2]) > _FARTHEST).any(axis=1))
    points = np.where(missing[:, None], 0, points)
    confidence = points[:, 2]
    is_mark = np.isin(confidence, (0, 1, 2))
    if bool(is_mark.all()) and confidence.max() == 2:  # COCO's marks: not there, hidden, seen
        confidence = np.array([0, _LABELLED, 1])[confidence.astype(int)]
    if confidence.min() < 0 or confidence.max() > _MOST_CONFIDENT:
        raise UserError(
            f"{file}: a confidence of {confidence[np.argmax(np.abs(confidence - 0.5))]:g} is none: they run from 0 to 1"
        )
    return np.column_stack([points[:, :2], np.minimum(confidence, 1)])


def _unique_identities(joints: GivenJoints, path: Path) -> GivenJoints:
    """Identities as they are; none at all if they name two people of one frame, as untracked results do."""
    for people in joints.people.values():
        known = [p.identity for p in people if p.identity is not None]
        if len(known) != len(set(known)):
            note = f"{path.name} gives two people of a frame the same id: its ids are not used, people are tracked"
            return replace(without_identities(joints), notes=(*joints.notes, note))
    return joints


def without_identities(joints: GivenJoints) -> GivenJoints:
    """The same people, to be tracked."""
    people = {number: tuple(replace(p, identity=None) for p in frame) for number, frame in joints.people.items()}
    return replace(joints, people=people)
