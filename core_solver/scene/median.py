"""The median of each pixel over a stream of masked pictures, in memory that does not grow with their number."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_SORTED_AT_ONCE = 1 << 14  # pixels


class StreamingMedian:
    """Per-pixel median of what was known of it.

    Each pixel keeps up to `most` of its own observations. When its places are full, it lets every second one go and
    from then on takes only every second, fourth, ... new one: what it keeps is spread evenly over all it was shown,
    however many that were. So the median is exact up to `most` observations and beyond that the exact median of at
    least half as many, evenly spread.
    """

    def __init__(self, shape: tuple[int, int], most: int = 128) -> None:
        """Start with nothing seen.

        Args:
            shape: (h, w) of the pictures.
            most: observations kept a pixel, even; memory is 4 h w most bytes.
        """
        if most < 2 or most % 2:
            raise ValueError(f"the number of observations to keep must be even and positive, not {most}")
        self._shape, self._most = shape, most
        pixels = shape[0] * shape[1]
        self._kept = np.full((pixels, most), np.inf, np.float32)
        self._count = np.zeros(pixels, np.int32)
        self._stride = np.ones(pixels, np.int32)
        self._seen = np.zeros(pixels, np.int32)

    def add(self, values: NDArray, known: NDArray[np.bool_]) -> None:
        """Take in one picture.

        Args:
            values: (h, w), finite where known.
            known: (h, w), which pixels to take in.
        """
        pixel = np.flatnonzero(known)
        wanted = pixel[self._seen[pixel] % self._stride[pixel] == 0]
        self._seen[pixel] += 1
        self._kept[wanted, self._count[wanted]] = values.ravel()[wanted]
        self._count[wanted] += 1
        self._thin(wanted[self._count[wanted] == self._most])

    def result(self) -> Floats:
        """(h, w) medians, NaN where nothing was known; of an even number the mean of the middle two."""
        medians = np.full(len(self._count), np.nan, np.float32)
        for pixel in np.array_split(np.arange(len(medians)), max(1, len(medians) // _SORTED_AT_ONCE)):
            ordered = np.sort(self._kept[pixel], axis=1)  # places not filled hold infinity and come last
            count = self._count[pixel]
            middle = np.stack([np.maximum(count - 1, 0) // 2, count // 2], axis=1)
            pair = np.take_along_axis(ordered, middle, axis=1)
            medians[pixel] = np.where(count > 0, pair.mean(axis=1), np.nan)
        return medians.reshape(self._shape)

    def _thin(self, full: NDArray[np.int64]) -> None:
        half = self._most // 2
        for pixel in np.array_split(full, max(1, len(full) // _SORTED_AT_ONCE)):
            self._kept[pixel, :half] = self._kept[pixel, ::2]
            self._kept[pixel, half:] = np.inf
        self._count[full] = half
        self._stride[full] *= 2
