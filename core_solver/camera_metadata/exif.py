"""The few EXIF facts that fix a field of view. A damaged block gives what can be read of it, or nothing."""

import struct
from dataclasses import dataclass

_MARK = b"Exif\0\0"
_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_MOST_ENTRIES = 256
_ENTRY = 12

_MAKE, _MODEL, _EXIF_FOLDER = 0x010F, 0x0110, 0x8769
_DIGITAL_ZOOM, _FOCAL_35MM, _LENS_MODEL = 0xA404, 0xA405, 0xA434
_ASCII, _SHORT, _LONG, _RATIONAL = 2, 3, 4, 5


@dataclass(frozen=True)
class ExifLens:
    """What EXIF says of a lens.

    Attributes:
        focal_35mm: equivalent focal length, millimetres; 0 where unknown.
        digital_zoom: at least 1.
        make: of the camera.
        lens: model of the lens, else of the camera.
    """

    focal_35mm: float
    digital_zoom: float
    make: str
    lens: str


def find_exif(content: bytes) -> ExifLens | None:
    """The first EXIF block in a box's content that states an equivalent focal length."""
    starts = [0] if content[:4] in _ORDERS else []
    place = content.find(_MARK)
    while place >= 0 and len(starts) < 8:
        starts.append(place + len(_MARK))
        place = content.find(_MARK, place + 1)
    lenses = (_read_tiff(content[start:]) for start in starts)
    return next((lens for lens in lenses if lens is not None and lens.focal_35mm > 0), None)


def _read_tiff(tiff: bytes) -> ExifLens | None:
    order = _ORDERS.get(tiff[:4])
    if order is None or len(tiff) < 8:
        return None
    first = _folder(tiff, order, *struct.unpack_from(order + "I", tiff, 4))
    inner = first.get(_EXIF_FOLDER)
    # A few makers store the inner folder alone.
    facts = {**first, **(_folder(tiff, order, inner) if isinstance(inner, int) else {})}
    zoom = _number(facts.get(_DIGITAL_ZOOM))
    return ExifLens(
        focal_35mm=_number(facts.get(_FOCAL_35MM)),
        digital_zoom=zoom if zoom > 1 else 1.0,
        make=str(facts.get(_MAKE, "")),
        lens=str(facts.get(_LENS_MODEL) or facts.get(_MODEL) or ""),
    )


def _number(value: float | str | None) -> float:
    return float(value) if isinstance(value, int | float) else 0.0


def _folder(tiff: bytes, order: str, start: int) -> dict[int, float | str]:
    """Tag to value, of the kinds read here."""
    if start + 2 > len(tiff):
        return {}
    (count,) = struct.unpack_from(order + "H", tiff, start)
    facts = {}
    for number in range(min(count, _MOST_ENTRIES)):
        place = start + 2 + _ENTRY * number
        if place + _ENTRY > len(tiff):
            break
        tag, kind, amount = struct.unpack_from(order + "HHI", tiff, place)
        value = _value(tiff, order, place + 8, kind, amount)
        if value is not None:
            facts[tag] = value
    return facts


def _value(tiff: bytes, order: str, place: int, kind: int, amount: int) -> float | str | None:
    if kind == _SHORT:
        return int(struct.unpack_from(order + "H", tiff, place)[0])
    (word,) = struct.unpack_from(order + "I", tiff, place)
    if kind == _LONG:
        return int(word)
    if kind == _RATIONAL and word + 8 <= len(tiff):
        above, below = struct.unpack_from(order + "II", tiff, word)
        return above / below if below else None
    if kind == _ASCII:
        text = tiff[place : place + amount] if amount <= 4 else tiff[word : word + min(amount, 200)]
        return text.partition(b"\0")[0].decode("ascii", "replace").strip()
    return None
