"""The nested boxes of an MP4 or QuickTime file, read one header at a time: a file of any size costs a few kilobytes.

Nothing here is trusted: sizes are held to their parent's, and depth, number of boxes and bytes read are bounded. What
does not fit ends its branch in silence, for a damaged index is no reason to refuse a picture that can be decoded.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO

_MOST_BOXES = 4096
_MOST_DEPTH = 10
_MOST_PAYLOAD = 1 << 20
_MOST_BYTES = 8 << 20

_CONTAINERS = frozenset({b"moov", b"trak", b"mdia", b"minf", b"stbl", b"udta", b"meta"})
_HEADER = 8
_VERSION = 4  # of a full box, before its content
_SAMPLE_ENTRY = _HEADER + 78  # header and fixed fields of a visual sample entry; its boxes follow


@dataclass(frozen=True)
class Box:
    """One box.

    Attributes:
        path: kinds from the outermost box to this one, such as (b"moov", b"udta", b"meta").
        start: of the payload in the file.
        end: of the payload in the file.
        parent: place of the payload of the box around this one, so that neighbours find each other; -1 at the top.
    """

    path: tuple[bytes, ...]
    start: int
    end: int
    parent: int

    @property
    def kind(self) -> bytes:
        """Four characters."""
        return self.path[-1]


class BoxReader:
    """Walks the boxes of an open file within fixed bounds."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._size = file.seek(0, 2)
        self._boxes = _MOST_BOXES
        self._bytes = _MOST_BYTES

    def walk(self) -> Iterator[Box]:
        """All boxes inside the movie header, a box before its content; the file's media are passed over."""
        for box in self._level(0, self._size, (), -1):
            if box.kind == b"moov":
                yield from self._descend(box)
                return  # whatever follows is no second movie

    def payload(self, box: Box) -> bytes:
        """A box's content, empty where it is too long to be a fact about a lens."""
        return self._read(box.start, box.end - box.start) if box.end - box.start <= _MOST_PAYLOAD else b""

    def sample_boxes(self, description: Box) -> Iterator[tuple[bytes, Box]]:
        """The fixed fields of each visual sample entry of an `stsd` box, with each box inside that entry."""
        for entry in self._level(description.start + _HEADER, description.end, description.path, description.start):
            fields = self._read(entry.start, _SAMPLE_ENTRY - _HEADER)
            for box in self._level(entry.start + _SAMPLE_ENTRY - _HEADER, entry.end, entry.path, entry.start):
                yield fields, box

    def _descend(self, box: Box) -> Iterator[Box]:
        yield box
        if box.kind not in _CONTAINERS or len(box.path) >= _MOST_DEPTH:
            return
        for child in self._level(self._content(box), box.end, box.path, box.start):
            yield from self._descend(child)

    def _content(self, box: Box) -> int:
        """Where the boxes inside begin: ISO's `meta` has a version before them, QuickTime's has not."""
        is_full = box.kind == b"meta" and self._read(box.start, _HEADER)[4:] != b"hdlr"
        return box.start + (_VERSION if is_full else 0)

    def _level(self, start: int, end: int, path: tuple[bytes, ...], parent: int) -> Iterator[Box]:
        while start + _HEADER <= end and self._boxes > 0:
            self._boxes -= 1
            header = self._read(start, _HEADER + 8)
            if len(header) < _HEADER:
                return
            size, kind, begin = int.from_bytes(header[:4], "big"), header[4:8], start + _HEADER
            if size == 1:  # a 64-bit size follows
                size, begin = int.from_bytes(header[8:16], "big"), start + _HEADER + 8
            elif size == 0:  # to the end
                size = end - start
            if start + size < begin or start + size > end:
                return
            yield Box((*path, kind), begin, start + size, parent)
            start += size

    def _read(self, start: int, length: int) -> bytes:
        length = min(length, self._bytes)
        self._bytes -= length
        self._file.seek(start)
        return self._file.read(length)
