"""Files of other programs, read with suspicion: what is damaged gives one line that names the file."""

import io
import json
import zipfile
import zlib
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

# The one restricted unpickler of the project lives where user's body models are read.
from core_solver.body.smpl_file import unpickle_arrays
from core_solver.errors import UserError

Array = NDArray[np.float64]

_PNG_HEAD = b"\x89PNG\r\n\x1a\n"
_INDEXED = 3  # PNG's colour type of pictures with a palette
_MOST_PIXELS = 1 << 28


def read_bytes(path: Path) -> bytes:
    """A whole file.

    Raises:
        UserError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise UserError(f"{path} cannot be read ({error.strerror or error}): check the file") from error


def read_json(path: Path) -> Any:
    """What a JSON file says.

    Raises:
        UserError: it cannot be read, or is no JSON.
    """
    try:
        return json.loads(read_bytes(path).decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise UserError(f"{path} is no whole JSON file: write it again") from error


def as_numbers(value: Any, path: Path, what: str) -> Array:
    """A list of numbers, however nested, as an array; not all of them need be finite.

    Raises:
        UserError: there is something else in it.
    """
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: {what} must be numbers: write the file again") from error


def as_whole_number(value: Any) -> int | None:
    """A whole number that may be written as 3, 3.0 or [3]; None for anything else."""
    while isinstance(value, list) and len(value) == 1:
        value = value[0]
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return None
    return int(value) if abs(value) < 2**53 and value == int(value) else None


def as_identity(value: Any) -> int | None:
    """Whose id this is; None for what is no id, and for the -1 that programs write for nobody known."""
    number = as_whole_number(value)
    return number if number is not None and number >= 0 else None


def read_png(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The pixels of a PNG file: (h, w), or (h, w, 3) or (h, w, 4) in the order blue, green, red, alpha.

    A picture with a palette gives its indices (h, w), since these are what such files are written for.

    Raises:
        UserError: missing, cut off, damaged or no PNG.
    """
    data = read_bytes(path)
    palette = _checked_palette(data, path)
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise UserError(f"{path} is a damaged PNG file: write it again") from error
    if picture is None or picture.dtype not in (np.uint8, np.uint16):
        raise UserError(f"{path} is a damaged PNG file: write it again")
    if palette is not None and picture.ndim == 3:
        return _indices(picture, palette, path)
    return picture  # type: ignore[return-value] - checked above to be of 8 or 16 bits


def _checked_palette(data: bytes, path: Path) -> NDArray[np.uint8] | None:
    """Walk through a PNG file's parts, which carry checksums: the decoder would show a cut file half black.

    Returns:
        (n, 3) red, green, blue for a picture whose pixels are indices, else None.
    """
    palette, place, indexed, ended = None, len(_PNG_HEAD), False, False
    while data.startswith(_PNG_HEAD) and not ended and place + 12 <= len(data):
        length = int.from_bytes(data[place : place + 4], "big")
        kind, body = data[place + 4 : place + 8], data[place + 8 : place + 8 + length]
        check = data[place + 8 + length : place + 12 + length]
        if int.from_bytes(check, "big") != zlib.crc32(kind + body) or len(check) != 4:
            break
        if kind == b"IHDR":
            indexed = len(body) == 13 and body[9] == _INDEXED
            if int.from_bytes(body[:4], "big") * int.from_bytes(body[4:8], "big") > _MOST_PIXELS:
                raise UserError(f"{path} has more pixels than a video: it is no picture of this clip")
        if kind == b"PLTE" and len(body) % 3 == 0:
            palette = np.frombuffer(body, np.uint8).reshape(-1, 3)
        ended = kind == b"IEND"
        place += 12 + length
    if not ended:
        raise UserError(f"{path} is a damaged or cut PNG file: write it again")
    return palette if indexed else None


def _indices(picture: NDArray, palette: NDArray[np.uint8], path: Path) -> NDArray[np.uint8]:
    """Back from the palette's colours, which the decoder has put in, to the indices."""
    colours = palette.astype(np.int64) @ (1 << 16, 1 << 8, 1)
    known, first = np.unique(colours, return_index=True)
    pixels = picture[..., 2::-1].astype(np.int64) @ (1 << 16, 1 << 8, 1)
    place = np.clip(np.searchsorted(known, pixels), 0, len(known) - 1)
    if not np.array_equal(known[place], pixels):
        raise UserError(f"{path}: its palette does not name all of its colours: save it as a grey PNG")
    return first[place].astype(np.uint8)


def read_archive(path: Path, *, with_objects: bool = False) -> dict[str, Any]:
    """The arrays of an .npz file.

    Args:
        path: the archive.
        with_objects: let tables of arrays (dicts and lists) through, which other programs write into such files; they
            are unpickled by a reader that knows arrays and plain values and refuses every other name.

    Raises:
        UserError: missing, damaged, or with something else in it.
    """
    data = read_bytes(path)
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
        return {name: _array(member, with_objects=with_objects) for name, member in members.items()}
    except UserError as error:
        raise UserError(f"{path}: {error}") from error
    except Exception as error:  # a damaged archive raises almost anything
        raise UserError(f"{path} is no whole .npz file: write it again") from error


def _array(data: bytes, *, with_objects: bool) -> Any:
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    read_header = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
    shape, fortran_order, dtype = read_header(stream)
    if dtype.hasobject:
        if not with_objects:
            raise UserError("it holds Python objects where plain arrays are needed: save plain arrays")
        return unpickle_arrays(stream)
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    return flat.reshape(shape, order="F" if fortran_order else "C")
