"""COCO's run-length masks, plain and packed."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

_MOST_PIXELS = 1 << 28


def decode_rle(segmentation: Any) -> NDArray[np.bool_]:
    """A mask from `{"size": [height, width], "counts": [...] or "..."}`.

    Runs go down the columns, the first one is outside the mask. A text packs them: five bits a character, least first,
    the sixth for "more follows", and from the fourth run on the difference to the run before the last.

    Returns:
        (height, width).

    Raises:
        ValueError: no such mask, or runs that do not fill the picture.
    """
    if not isinstance(segmentation, dict) or "counts" not in segmentation:
        raise ValueError("it is no run-length mask")
    height, width = (int(n) for n in np.asarray(segmentation.get("size"), dtype=float))
    if height <= 0 or width <= 0 or height * width > _MOST_PIXELS:
        raise ValueError(f"{width}x{height} is no size of a picture")
    counts = segmentation["counts"]
    runs = np.asarray(_unpack(counts) if isinstance(counts, str) else counts, dtype=float)
    if runs.ndim != 1 or not np.isfinite(runs).all() or (runs < 0).any() or runs.sum() != height * width:
        raise ValueError("its runs do not fill the picture")
    inside = np.arange(len(runs)) % 2 == 1
    return np.repeat(inside, runs.astype(np.int64)).reshape(width, height).T


def _unpack(text: str) -> list[int]:
    runs: list[int] = []
    value, shift = 0, 0
    for character in text:
        bits = ord(character) - 48
        if not 0 <= bits < 64 or shift > 40:
            raise ValueError("its counts are damaged")
        value |= (bits & 31) << shift
        shift += 5
        if bits & 32:
            continue
        if bits & 16:  # the sign
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value, shift = 0, 0
    if shift:
        raise ValueError("its counts are cut off")
    return runs
