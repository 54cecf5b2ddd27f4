"""MATLAB's .mat files of versions 5 to 7: numbers, cells and structs.

scipy's reader ends the whole process on some damaged files; this one checks every length before it is used.

A file is a header of 128 bytes and elements. An element is a tag (type and number of bytes) and its data, padded to
eight bytes; up to four bytes of data stand inside the tag. A matrix is an element of elements: flags, dimensions, name,
and contents by its class. Compressed elements hold another element.
"""

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

HEADER = 128

_MATRIX, _COMPRESSED = 14, 15
_NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
_CELL, _STRUCT = 1, 2
_NUMERIC = range(6, 16)  # double, single and the integers; what is true or false is an integer with a flag
_COMPLEX = 0x800
_DEEPEST = 16  # matrices within matrices
_MOST_AXES = 32  # numpy's limit


class MatlabError(ValueError):
    """The bytes are no such file, or hold something that this reader does not know."""


class NewerMatlabError(MatlabError):
    """A file of version 7.3, which is HDF5 inside."""


@dataclass(frozen=True)
class _Element:
    """Type and data of an element, and where the next one begins."""

    kind: int
    data: bytes
    end: int


def read_variable(content: bytes, name: str) -> NDArray[Any]:
    """One variable of a file.

    Args:
        content: of the file.
        name: of the variable.

    Returns:
        Numbers as an array of their shape; a cell array as an object array of such values; a struct array as an object
        array of dictionaries from field to value; an empty text for what is neither.

    Raises:
        MatlabError: damaged, of another kind, or without that variable.
    """
    order = _byte_order(content)
    for element in _elements(content, HEADER, order):
        whole = element
        if element.kind == _COMPRESSED:
            whole = _element(_inflate(element.data), 0, order)
        if whole.kind == _MATRIX and whole.data:
            matrix = _Matrix(whole.data, order, 0)
            if matrix.name == name:
                return matrix.value()
    raise MatlabError(f"there is no variable {name}")


def _byte_order(content: bytes) -> str:
    """Little (<) or big (>) end first, from the header."""
    if len(content) < HEADER:
        raise MatlabError("shorter than a header")
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise MatlabError("not a MATLAB file")
    (version,) = struct.unpack(f"{order}H", content[124:126])
    if version == 0x0200:
        raise NewerMatlabError("a file of version 7.3")
    if version != 0x0100:
        raise MatlabError("not a MATLAB file of version 5 to 7")
    return order


def _inflate(data: bytes) -> bytes:
    try:
        return zlib.decompress(data)
    except zlib.error as error:
        raise MatlabError("compressed data are damaged") from error


def _elements(data: bytes, start: int, order: str) -> Iterator[_Element]:
    while start < len(data):
        element = _element(data, start, order)
        yield element
        start = element.end


def _element(data: bytes, start: int, order: str) -> _Element:
    if start + 8 > len(data):
        raise MatlabError("cut off")
    kind, size = struct.unpack_from(f"{order}II", data, start)
    if kind >> 16:  # the short form: two halves, then the data
        kind, size = kind & 0xFFFF, kind >> 16
        if size > 4:
            raise MatlabError("a tag is damaged")
        return _Element(kind, data[start + 4 : start + 4 + size], start + 8)
    begin, end = start + 8, start + 8 + size
    if end > len(data):
        raise MatlabError("cut off")
    padding = 0 if kind == _COMPRESSED else -size % 8
    return _Element(kind, data[begin:end], end + padding)


class _Matrix:
    """The inside of a matrix element, read as far as its name until somebody wants its value."""

    def __init__(self, data: bytes, order: str, depth: int) -> None:
        if depth > _DEEPEST:
            raise MatlabError("nested too deeply")
        self._parts = _elements(data, 0, order)
        self._order, self._depth, self._room = order, depth, len(data)
        flags = self._numbers()
        if flags.size < 1:
            raise MatlabError("a matrix without flags")
        self._kind, self._is_complex = int(flags[0]) & 0xFF, bool(int(flags[0]) & _COMPLEX)
        self._shape = tuple(int(length) for length in self._numbers())
        if not 2 <= len(self._shape) <= _MOST_AXES or min(self._shape) < 0:
            raise MatlabError("a matrix with wrong dimensions")
        self.name = _text(self._next().data)

    def value(self) -> NDArray[Any]:
        """As `read_variable` describes."""
        if self._kind == _CELL:
            return self._filled(1, self._inner)
        if self._kind == _STRUCT:
            return self._structs()
        if self._kind in _NUMERIC and not self._is_complex:
            values = self._numbers()
            if values.size != math.prod(self._shape):
                raise MatlabError("a matrix has not as many numbers as its dimensions say")
            return values.reshape(self._shape, order="F")
        return np.full((1, 1), "")  # text and the like: whoever takes it for numbers finds that it is none

    def _structs(self) -> NDArray[Any]:
        lengths, names = self._numbers(), self._next().data
        width = int(lengths[0]) if lengths.size else 0
        if width < 1:
            raise MatlabError("a struct without field names")
        fields = [_text(names[start : start + width]) for start in range(0, len(names), width)]
        return self._filled(len(fields), lambda: {field: self._inner() for field in fields})

    def _filled(self, elements: int, make: Callable[[], Any]) -> NDArray[Any]:
        """An object array of the matrix's shape, in MATLAB's order; each entry is made of so many inner elements."""
        count = math.prod(self._shape)
        if count * elements * 8 > self._room:
            raise MatlabError("an array is larger than its data")
        array = np.empty(count, object)
        for index in range(count):
            array[index] = make()
        return array.reshape(self._shape, order="F")

    def _inner(self) -> NDArray[Any]:
        element = self._next()
        if element.kind != _MATRIX:
            raise MatlabError("something else stands where a matrix should")
        if not element.data:
            return np.zeros((0, 0))
        return _Matrix(element.data, self._order, self._depth + 1).value()

    def _numbers(self) -> NDArray[Any]:
        element = self._next()
        if element.kind not in _NUMBERS:
            raise MatlabError("something else stands where numbers should")
        dtype = np.dtype(self._order + _NUMBERS[element.kind])
        if len(element.data) % dtype.itemsize:
            raise MatlabError("numbers are cut off")
        return np.frombuffer(element.data, dtype)

    def _next(self) -> _Element:
        element = next(self._parts, None)
        if element is None:
            raise MatlabError("a matrix is cut off")
        return element


def _text(data: bytes) -> str:
    return data.partition(b"\0")[0].decode("ascii", errors="replace")
