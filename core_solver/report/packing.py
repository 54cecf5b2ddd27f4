"""Arrays in one block of bytes, in 16 bits where that is enough, for a page to read as typed arrays."""

import base64
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

_ALIGNMENT = 8  # typed arrays start at multiples of their item's size
_STEPS = 65534  # of a quantised range; the last code of 16 bits means "no value"
_NO_VALUE = 65535


@dataclass(frozen=True)
class PackedArray:
    """Where an array lies in the block and how to read it.

    Attributes:
        at: first byte.
        kind: "uint8", "uint16", "int16", "uint32", "float32" or "float64", little endian.
        shape: lengths of the axes.
        low: value of code 0, one for each entry of the last axis, or a single one; empty for plain numbers.
        step: value of one code, likewise. Code 65535 means that there is no value.
    """

    at: int
    kind: str
    shape: tuple[int, ...]
    low: tuple[float, ...] = ()
    step: tuple[float, ...] = ()


class Packer:
    """Collects arrays."""

    def __init__(self) -> None:
        self._block = bytearray()

    def plain(self, values: ArrayLike, kind: str) -> PackedArray:
        """Keep an array as numbers of this kind."""
        array = np.ascontiguousarray(values, np.dtype(kind).newbyteorder("<"))
        self._block += bytes(-len(self._block) % _ALIGNMENT)
        at = len(self._block)
        self._block += array.tobytes()
        return PackedArray(at, kind, array.shape)

    def quantised(self, values: ArrayLike, *, by_column: bool = False) -> PackedArray:
        """Keep an array in 16 bits over its range (with `by_column` that of each entry of the last axis); NaN stays.

        The error is at most half a step: 1/131068 of the range.
        """
        array = np.asarray(values, float)
        axes = tuple(range(array.ndim - 1)) if by_column else None
        low, step = _range(array, axes)
        codes = np.where(np.isfinite(array), np.round((array - low) / step), _NO_VALUE)
        packed = self.plain(codes.astype(np.uint16), "uint16")
        return PackedArray(packed.at, "uint16", array.shape, _floats(low), _floats(step))

    def text(self) -> str:
        """The block in base64."""
        return base64.b64encode(bytes(self._block)).decode("ascii")


def _range(array: NDArray[np.float64], axes: tuple[int, ...] | None) -> tuple[NDArray, NDArray]:
    finite = np.isfinite(array)
    low = np.min(array, axis=axes, where=finite, initial=np.inf)
    high = np.max(array, axis=axes, where=finite, initial=-np.inf)
    low, high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    return low, np.maximum((high - low) / _STEPS, 1e-9)


def _floats(values: NDArray) -> tuple[float, ...]:
    return tuple(float(v) for v in np.atleast_1d(values))
