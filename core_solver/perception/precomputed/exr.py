"""OpenEXR pictures of one part in scan lines, stored plain or in ZIP, which is what depth is written as.

OpenCV's own reader is switched off unless an environment variable is set, and is not made for files from strangers.
"""

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_MAGIC = b"\x76\x2f\x31\x01"
_TILED_OR_DEEP_OR_PARTS = 0x200 | 0x800 | 0x1000
_NONE, _ZIPS, _ZIP = 0, 2, 3
_ROWS = {_NONE: 1, _ZIPS: 1, _ZIP: 16}  # in each chunk
_TYPES = (np.dtype("<u4"), np.dtype("<f2"), np.dtype("<f4"))
_PREFERRED = ("Z", "Y", "depth.Z", "depth", "D", "R", "G", "B")
_LONGEST_SIDE = 1 << 15
_MOST_SHRUNK = 1100  # ZIP cannot pack more bytes into one


@dataclass(frozen=True)
class _Head:
    """What the chunks' meaning rests on: the picture's size, its channels in file order, and the compression."""

    width: int
    top: int
    height: int
    channels: tuple[tuple[str, np.dtype], ...]
    compression: int
    end: int


def decode_exr(data: bytes) -> NDArray[np.float32]:
    """The depth of an EXR file (h, w): the channel Z, else Y, else the only one, else R.

    Raises:
        ValueError: damaged, cut off, no EXR file, or stored in a way that this reader does not know.
    """
    try:
        head = _read_head(data)
        chosen = _choose([name for name, _ in head.channels])
        return _read_rows(data, head, chosen)
    except (struct.error, IndexError, zlib.error, KeyError, OverflowError) as error:
        raise ValueError("it is damaged or cut off") from error


def _read_head(data: bytes) -> _Head:
    if data[:4] != _MAGIC:
        raise ValueError("it is no EXR file")
    if struct.unpack_from("<I", data, 4)[0] & _TILED_OR_DEEP_OR_PARTS:
        raise ValueError("it is tiled, deep or of several parts: save it as plain scan lines")
    attributes, place = {}, 8
    while data[place] != 0:
        name, place = _text(data, place)
        _, place = _text(data, place)
        (length,) = struct.unpack_from("<i", data, place)
        attributes[name] = data[place + 4 : place + 4 + max(length, 0)]
        place += 4 + max(length, 0)
    left, top, right, bottom = struct.unpack("<4i", attributes["dataWindow"])
    width, height = right - left + 1, bottom - top + 1
    if not (0 < width <= _LONGEST_SIDE and 0 < height <= _LONGEST_SIDE):
        raise ValueError(f"{width}x{height} is no size of a picture")
    compression = attributes["compression"][0]
    if compression not in _ROWS:
        raise ValueError("its compression is not known here: save it uncompressed or with ZIP")
    return _Head(width, top, height, _channels(attributes["channels"]), compression, place + 1)


def _channels(data: bytes) -> tuple[tuple[str, np.dtype], ...]:
    channels, place = [], 0
    while data[place] != 0:
        name, place = _text(data, place)
        kind, _, across, down = struct.unpack_from("<iIii", data, place)
        if not 0 <= kind < len(_TYPES) or (across, down) != (1, 1):
            raise ValueError("it has channels of an unknown kind")
        channels.append((name, _TYPES[kind]))
        place += 16
    return tuple(channels)


def _choose(names: list[str]) -> str:
    if len(names) == 1:
        return names[0]
    for name in _PREFERRED:
        if name in names:
            return name
    raise ValueError(f"none of its channels {', '.join(names)} is depth: name it Z")


def _read_rows(data: bytes, head: _Head, chosen: str) -> NDArray[np.float32]:
    rows_each = _ROWS[head.compression]
    count = -(-head.height // rows_each)
    bytes_of_row = head.width * sum(kind.itemsize for _, kind in head.channels)
    if head.height * bytes_of_row > _MOST_SHRUNK * len(data):
        raise ValueError("it is cut off")
    result = np.empty((head.height, head.width), np.float32)
    filled = set()
    for place in struct.unpack_from(f"<{count}Q", data, head.end):
        first, size = struct.unpack_from("<ii", data, place)
        first -= head.top
        if not 0 <= first < head.height or first % rows_each or first in filled:
            raise ValueError("it is damaged")
        filled.add(first)
        rows = min(rows_each, head.height - first)
        packed = data[place + 8 : place + 8 + size]
        raw = _unpack(packed, rows * bytes_of_row, head.compression)
        result[first : first + rows] = _channel(raw, head, chosen, rows)
    return result


def _unpack(packed: bytes, size: int, compression: int) -> bytes:
    """Undo ZIP: the bytes are stored as differences, all even ones before all odd ones; what did not shrink is raw."""
    if compression == _NONE or len(packed) == size:
        raw = packed
    else:
        unpacker = zlib.decompressobj()
        steps = np.frombuffer(unpacker.decompress(packed, size + 1), np.uint8).astype(np.int64)
        steps[1:] -= 128
        values = np.cumsum(steps).astype(np.uint8)
        half = -(-len(values) // 2)
        woven = np.empty_like(values)
        woven[0::2], woven[1::2] = values[:half], values[half:]
        raw = woven.tobytes()
    if len(raw) != size:
        raise ValueError("it is damaged or cut off")
    return raw


def _channel(raw: bytes, head: _Head, chosen: str, rows: int) -> NDArray[np.float32]:
    """(rows, width) of one channel: each row holds all channels, one after the other."""
    lines = np.frombuffer(raw, np.uint8).reshape(rows, -1)
    start = 0
    for name, kind in head.channels:
        stop = start + head.width * kind.itemsize
        if name == chosen:
            return np.ascontiguousarray(lines[:, start:stop]).view(kind).astype(np.float32)
        start = stop
    raise KeyError(chosen)


def _text(data: bytes, place: int) -> tuple[str, int]:
    end = data.index(b"\0", place)
    return data[place:end].decode("latin1"), end + 1
