"""From a video's metadata to intrinsics, with an honest deviation.

A stored focal length describes the lens; the video shows part of what the lens sees. Stabilisation and many video modes
crop, and makers disagree whether 36 mm of film lie along the picture's side or 43.3 mm along its diagonal.
"""

import logging
import math
import re
from dataclasses import dataclass
from pathlib import Path

from core_solver.camera import Camera, CameraEstimate
from core_solver.camera_metadata.boxes import Box, BoxReader
from core_solver.camera_metadata.exif import find_exif
from core_solver.camera_metadata.items import Value, gopro_settings, keyed_items

_log = logging.getLogger(__name__)

_FILM_WIDTH_MM = 36.0
_CROP_SIGMA = 0.10  # log focal length: crops of 0 to 20 %, and 5 % between side and diagonal
_STATED_SIGMA = 0.03  # a field of view that is stated for this very video
_LINEAR_SIGMA = 0.05
_FISHEYE_SIGMA = 0.15
_BELIEVABLE = (0.2, 8.0)  # focal length in longer sides of the picture: 136 to 7 degrees
_APPLE_KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
_APPLE_LENS = "com.apple.quicktime.camera.lens_model"
_MODEL_KEYS = ("com.apple.quicktime.model", "com.android.model")
_GOPRO_LINEAR = "L"
_ISO_META_SIBLINGS = (b"keys", b"ilst")


@dataclass(frozen=True)
class StoredLens:
    """What a file says about its lens.

    Attributes:
        focal: focal length in longer sides of the picture.
        sigma: deviation of its logarithm.
        source: where it stands in the file, for people.
    """

    focal: float
    sigma: float
    source: str


def camera_from_metadata(path: Path, width: int, height: int) -> CameraEstimate | None:
    """The camera that a video's metadata state, or None where they state none.

    Pixels are square and the principal point is the middle, so the picture's rotation does not matter.

    Args:
        path: the video.
        width: of the video as shown, pixels.
        height: of the video as shown, pixels.
    """
    lens = stored_lens(path, width, height)
    if lens is None:
        return None
    focal = lens.focal * max(width, height)
    return CameraEstimate(
        Camera(width, height, focal, focal, width / 2, height / 2, source=f"metadata: {lens.source}"), lens.sigma
    )


def stored_lens(path: Path, width: int, height: int) -> StoredLens | None:
    """What an MP4 or QuickTime file says about its lens; None for other files, and where nothing believable is said.

    Args:
        path: the video.
        width: of the video, pixels.
        height: of the video, pixels.
    """
    try:
        with path.open("rb") as file:
            facts = _gather(BoxReader(file))
    except OSError as error:
        _log.info("the metadata of %s cannot be read (%s)", path.name, error.strerror)
        return None
    diagonal = math.hypot(width, height) / max(width, height)
    candidates = (_spatial(facts), _gopro(facts.gopro, diagonal), _apple(facts.items), facts.exif)
    return next((lens for lens in candidates if lens is not None and _is_believable(lens)), None)


@dataclass
class _Facts:
    """What was found on the way through the boxes."""

    items: dict[str, Value]
    gopro: dict[str, Value]
    exif: StoredLens | None = None
    field_degrees: float = 0.0
    size: tuple[int, int] = (0, 0)


def _gather(reader: BoxReader) -> _Facts:
    facts = _Facts({}, {})
    keys: dict[int, bytes] = {}
    for box in reader.walk():
        if box.kind == b"keys":
            keys[box.parent] = reader.payload(box)
        elif box.kind == b"ilst" and box.parent in keys:
            facts.items |= keyed_items(keys[box.parent], reader.payload(box))
        elif box.kind == b"GPMF":
            facts.gopro |= gopro_settings(reader.payload(box))
        elif box.kind == b"stsd":
            _read_samples(reader, box, facts)
        elif _may_hold_exif(box) and facts.exif is None:
            facts.exif = _exif(reader.payload(box))
    return facts


def _may_hold_exif(box: Box) -> bool:
    """Makers put EXIF blocks into boxes of their own, but always among the metadata."""
    inside = box.kind == b"uuid" or b"udta" in box.path[:-1] or b"meta" in box.path[:-1]
    return inside and box.kind not in (b"udta", b"meta", *_ISO_META_SIBLINGS)


def _read_samples(reader: BoxReader, description: Box, facts: _Facts) -> None:
    """Apple's spatial videos state the field of view along the stored picture's width, in thousandths of a degree."""
    for fields, box in reader.sample_boxes(description):
        if box.kind == b"hfov":
            facts.field_degrees = int.from_bytes(reader.payload(box)[:4], "big") / 1000
            facts.size = int.from_bytes(fields[24:26], "big"), int.from_bytes(fields[26:28], "big")


def _spatial(facts: _Facts) -> StoredLens | None:
    if not 1 < facts.field_degrees < 170 or min(facts.size) < 1:
        return None
    across = 0.5 / math.tan(math.radians(facts.field_degrees) / 2)
    focal = across * facts.size[0] / max(facts.size)
    return StoredLens(focal, _STATED_SIGMA, f"field of view {facts.field_degrees:.1f} degrees stated for the video")


def _gopro(facts: dict[str, Value], diagonal: float) -> StoredLens | None:
    """GoPros state the diagonal's field of view; only their linear mode shows a pinhole's picture."""
    degrees = facts.get("ZFOV")
    if not isinstance(degrees, int | float) or not 1 < degrees < 175:
        return None
    mode = str(facts.get("VFOV", ""))
    half, angle = diagonal / 2, math.radians(degrees) / 2
    if mode == _GOPRO_LINEAR:
        return StoredLens(half / math.tan(angle), _LINEAR_SIGMA, f"GoPro linear mode, {degrees:.0f} degrees diagonal")
    # Fisheye: equal angles lie about equally far apart, at the middle of the picture as a pinhole has them.
    source = f"GoPro mode {mode or 'unknown'}, {degrees:.0f} degrees diagonal, a fisheye picture: better calibrate it"
    return StoredLens(half / angle, _FISHEYE_SIGMA, source)


def _apple(items: dict[str, Value]) -> StoredLens | None:
    focal = _millimetres(items.get(_APPLE_KEY))
    if focal <= 0:
        return None
    names = [str(items[key]) for key in (_APPLE_LENS, *_MODEL_KEYS) if items.get(key)]
    return _equivalent(focal, 1.0, names[0] if names else "")


def _millimetres(value: Value | None) -> float:
    """A number, or a text such as 26.0mm."""
    if isinstance(value, str):
        number = re.match(r"\d{1,4}(\.\d{1,6})?", value)
        return float(number[0]) if number else 0.0
    return float(value) if value is not None and math.isfinite(value) else 0.0


def _exif(content: bytes) -> StoredLens | None:
    lens = find_exif(content)
    if lens is None:
        return None
    # Apple's equivalent focal length has the digital zoom in it already.
    zoom = 1.0 if lens.make.lower().startswith("apple") else lens.digital_zoom
    return _equivalent(lens.focal_35mm, zoom, lens.lens)


def _equivalent(focal_mm: float, zoom: float, lens: str) -> StoredLens:
    zoomed = f" with a digital zoom of {zoom:.2g}" if zoom > 1 else ""
    named = f" ({lens})" if lens else ""
    source = f"35 mm equivalent focal length {focal_mm:g} mm{zoomed}{named}"
    return StoredLens(focal_mm * zoom / _FILM_WIDTH_MM, _CROP_SIGMA, source)


def _is_believable(lens: StoredLens) -> bool:
    return _BELIEVABLE[0] <= lens.focal <= _BELIEVABLE[1]
