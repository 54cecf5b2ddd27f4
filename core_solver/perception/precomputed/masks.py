"""Masks of people: pictures of ids, a picture for each person, or COCO's run-length masks."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.perception.precomputed.files import as_identity, read_json, read_png
from core_solver.perception.precomputed.joints import image_numbers, read_images
from core_solver.perception.precomputed.numbering import frame_numbers
from core_solver.perception.precomputed.rle import decode_rle

Picture = NDArray[np.uint8]

_MOST_PEOPLE = 100  # in a picture of ids: more are shades of grey
_PERSON = 1  # COCO's category
_OF_A_PERSON = re.compile(r"^(?P<frame>.*\d.*)_person_?(?P<person>\d+)$", re.IGNORECASE)


@dataclass(frozen=True)
class GivenMask:
    """One mask in one frame.

    Attributes:
        values: (h, w) probability of the person times 255, laid over the whole picture.
        identity: the same number for the same person in all frames; None where the file does not say.
    """

    values: Picture
    identity: int | None


class GivenMasks(Protocol):
    """Masks by frame number, read when they are wanted."""

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that the files speak of, as they count."""
        ...

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the masks."""
        ...

    def read(self, number: int) -> tuple[GivenMask, ...]:
        """The masks of a frame that is among `numbers`.

        Raises:
            UserError: the file is damaged, or its picture has another size than the others.
        """
        ...


def read_masks(path: Path) -> GivenMasks:
    """Masks from a folder or a JSON file.

    Args:
        path: a folder of pictures with ids (0 is the background), a folder with one folder of black and white pictures
            for each person or with `FRAME_person_ID.png` files, a JSON file of COCO's run-length masks, or a folder
            with one.

    Raises:
        UserError: nothing there, damaged, or of another kind.
    """
    if path.is_file():
        return _read_rle(path)
    of_people = {folder: sorted(folder.glob("*.png")) for folder in sorted(path.iterdir()) if folder.is_dir()}
    of_people = {folder: files for folder, files in of_people.items() if files}
    pictures, documents = sorted(path.glob("*.png")), sorted(path.glob("*.json"))
    kinds = [bool(of_people), bool(pictures), bool(documents)]
    if sum(kinds) != 1 or len(documents) > 1:
        found = "nothing of the kind" if not any(kinds) else "several kinds"
        raise UserError(f"{path} must hold masks as PNG files or one COCO JSON file, and holds {found}")
    if documents:
        return _read_rle(documents[0])
    if of_people:
        return _person_folders(of_people)
    named = [_OF_A_PERSON.match(file.stem) for file in pictures]
    if all(named):
        return _person_files(pictures, [m for m in named if m is not None])
    files = dict(zip(frame_numbers([p.name for p in pictures]), pictures, strict=True))
    return IdPictures(files, _size(pictures[0]))


@dataclass(frozen=True)
class IdPictures:
    """One picture a frame; a pixel's value is its person's id, 0 the background."""

    files: Mapping[int, Path]
    size: tuple[int, int]

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that there are pictures of."""
        return frozenset(self.files)

    def read(self, number: int) -> tuple[GivenMask, ...]:
        """One mask for each id in the picture."""
        file = self.files[number]
        ids = picture_ids(read_png(file))
        _require_size(ids, self.size, file)
        present = np.unique(ids[ids > 0])
        if len(present) > _MOST_PEOPLE:
            raise UserError(f"{file} holds {len(present)} different values: it is no picture of people's ids")
        return tuple(GivenMask(np.where(ids == i, 255, 0).astype(np.uint8), int(i)) for i in present)


@dataclass(frozen=True)
class PersonPictures:
    """One black and white picture a person and frame."""

    files: Mapping[int, Mapping[int, Path]]
    size: tuple[int, int]

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that there are pictures of."""
        return frozenset(self.files)

    def read(self, number: int) -> tuple[GivenMask, ...]:
        """One mask for each person with a picture of this frame."""
        masks = []
        for person, file in self.files[number].items():
            picture = grey(read_png(file), file)
            _require_size(picture, self.size, file)
            masks.append(GivenMask(picture, person))
        return tuple(masks)


@dataclass(frozen=True)
class RunLengthMasks:
    """COCO's masks by frame number, with the identity where there is one."""

    entries: Mapping[int, tuple[tuple[Any, int | None], ...]]
    size: tuple[int, int]
    file: Path

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that the file speaks of."""
        return frozenset(self.entries)

    def read(self, number: int) -> tuple[GivenMask, ...]:
        """The frame's masks."""
        masks = []
        for segmentation, identity in self.entries[number]:
            inside = _decode(segmentation, self.file)
            _require_size(inside, self.size, self.file)
            masks.append(GivenMask(np.where(inside, 255, 0).astype(np.uint8), identity))
        return tuple(masks)


def picture_ids(picture: NDArray) -> NDArray[np.int64]:
    """Ids (h, w) of a grey picture, or of a coloured one: every colour is an id, as in COCO's panoptic pictures."""
    if picture.ndim == 2:
        return picture.astype(np.int64)
    blue, green, red = (picture[..., c].astype(np.int64) for c in range(3))
    if np.array_equal(blue, green) and np.array_equal(green, red):
        return red
    return red + 256 * green + 65536 * blue


def grey(picture: NDArray, file: Path) -> Picture:
    """Probability times 255 of a picture of 8 or 16 bits; pictures of 0 and 1 are stretched."""
    if picture.ndim == 3:
        picture = picture[..., :3].max(axis=2)
    if picture.dtype == np.uint16:
        picture = (picture >> 8).astype(np.uint8) if picture.max(initial=0) > 255 else picture.astype(np.uint8)
    if picture.size == 0:
        raise UserError(f"{file} is an empty picture: write it again")
    return picture * np.uint8(255) if picture.max() == 1 else picture


def to_label_grid(mask: GivenMask, labels: tuple[int, int]) -> Picture:
    """The mask's values on the label grid (width, height)."""
    shrinks = mask.values.shape[1] > labels[0]
    return cv2.resize(mask.values, labels, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)  # type: ignore[return-value]


def _person_folders(folders: Mapping[Path, list[Path]]) -> PersonPictures:
    people = frame_numbers([folder.name for folder in folders])
    frames: dict[int, dict[int, Path]] = {}
    for person, files in zip(people, folders.values(), strict=True):
        for number, file in zip(frame_numbers([f.name for f in files]), files, strict=True):
            frames.setdefault(number, {})[person] = file
    return PersonPictures(frames, _size(next(iter(folders.values()))[0]))


def _person_files(files: list[Path], names: list[re.Match[str]]) -> PersonPictures:
    stems = sorted({match["frame"] for match in names})
    number_of = dict(zip(stems, frame_numbers(stems), strict=True))
    frames: dict[int, dict[int, Path]] = {}
    for file, match in zip(files, names, strict=True):
        frames.setdefault(number_of[match["frame"]], {})[int(match["person"])] = file
    return PersonPictures(frames, _size(files[0]))


def _read_rle(file: Path) -> RunLengthMasks:
    document = read_json(file)
    table = document if isinstance(document, dict) else {"annotations": document}
    listed = table.get("annotations")
    if not isinstance(listed, list) or not all(isinstance(entry, dict) for entry in listed):
        raise UserError(f"{file} holds no list of COCO masks: write it again")
    names, size = read_images(table.get("images"), file)
    persons = [entry for entry in listed if entry.get("category_id", _PERSON) == _PERSON]
    numbers = image_numbers([entry.get("image_id") for entry in persons], names, file)
    entries: dict[int, tuple[tuple[Any, int | None], ...]] = {}
    for number, entry in zip(numbers, persons, strict=True):
        identity = as_identity(entry.get("track_id"))
        entries[number] = (*entries.get(number, ()), (entry.get("segmentation"), identity))
    if not entries:
        raise UserError(f"{file} holds no mask of a person: take it away or write it again")
    first = _decode(next(iter(entries.values()))[0][0], file)
    height, width = first.shape
    if size is not None and size != (width, height):
        raise UserError(f"{file}: its images are {size[0]}x{size[1]}, but its masks {width}x{height}: write it again")
    return RunLengthMasks(entries, (width, height), file)


def _decode(segmentation: Any, file: Path) -> NDArray[np.bool_]:
    try:
        return decode_rle(segmentation)
    except (ValueError, TypeError, OverflowError) as error:
        raise UserError(f"{file} holds a damaged mask ({error}): write it again") from error


def _size(file: Path) -> tuple[int, int]:
    height, width = read_png(file).shape[:2]
    return width, height


def _require_size(picture: NDArray, size: tuple[int, int], file: Path) -> None:
    height, width = picture.shape[:2]
    if (width, height) != size:
        raise UserError(f"{file} is {width}x{height}, others are {size[0]}x{size[1]}: a clip's masks have one size")
