"""Blurred depth edges to steps: what lies between a thing and the wall behind it would hang in the air.

A network blurs the step between two surfaces over a few pixels. There the disparity is steeper than on either side,
which tells an edge from a floor: a floor may be steep, but it is as steep beside the pixel as on it.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_WIDEST_BLUR = 0.02  # of the longer side: as far as a pixel looks for either side of its edge
_EXCESS = 0.08  # of the disparity's range over one blur's width, by which an edge is steeper than its surroundings


def sharpen(disparity: NDArray) -> NDArray:
    """Replace every pixel on a blurred edge by the side of the edge that it is closer to.

    Args:
        disparity: (h, w) or (T, h, w) in [0, 1] or of any other range; near = large.

    Returns:
        The same shape and type. Flat and sloping surfaces, steps that are sharp already and NaN stay as they are.
    """
    if disparity.ndim == 3:
        return np.stack([sharpen(frame) for frame in disparity]) if len(disparity) else disparity.copy()
    values = disparity.astype(np.float32)
    known = np.isfinite(values)
    if min(values.shape) < 3 or not known.any():
        return disparity.copy()
    low, high = float(values[known].min()), float(values[known].max())
    values = np.where(known, values, low)
    reach = max(3, round(_WIDEST_BLUR * max(values.shape)))
    down, across = cv2.Sobel(values, cv2.CV_32F, 0, 1, scale=1 / 8), cv2.Sobel(values, cv2.CV_32F, 1, 0, scale=1 / 8)
    slope = np.asarray(cv2.magnitude(across, down), np.float32)
    steep = _excess(slope, reach) > _EXCESS * (high - low) / reach
    row, column = np.nonzero(steep & known)
    if not len(row):
        return disparity.copy()
    length = np.maximum(slope[row, column], 1e-12)
    direction = np.stack([down[row, column], across[row, column]]) / length
    nearer = _first_calm(values, steep | ~known, row, column, direction, reach)
    farther = _first_calm(values, steep | ~known, row, column, -direction, reach)
    here = values[row, column]
    choice = np.where(nearer - here <= here - farther, nearer, farther)
    result = disparity.copy()
    # With one side out of reach it is no edge but a steep thing.
    result[row, column] = np.where(np.isfinite(choice), choice, here)
    return result


def _excess(slope: Floats, reach: int) -> Floats:
    """How much steeper a pixel is than what surrounds it within `reach`: the slope less its morphological opening."""
    return slope - cv2.morphologyEx(slope, cv2.MORPH_OPEN, np.ones((2 * reach + 1, 2 * reach + 1), np.uint8))


def _first_calm(
    values: Floats, steep: NDArray[np.bool_], row: NDArray, column: NDArray, direction: NDArray, reach: int
) -> Floats:
    """Value of the first pixel off the edge along `direction` (2, n), at most `reach` steps away; NaN without one."""
    height, width = values.shape
    found = np.full(len(row), np.nan, np.float32)
    searching = np.arange(len(row))
    for step in range(1, 2 * reach + 1):
        r = np.rint(row[searching] + step * direction[0, searching]).astype(int)
        c = np.rint(column[searching] + step * direction[1, searching]).astype(int)
        inside = (r >= 0) & (r < height) & (c >= 0) & (c < width)
        searching, r, c = searching[inside], r[inside], c[inside]
        calm = ~steep[r, c]
        found[searching[calm]] = values[r[calm], c[calm]]
        searching = searching[~calm]
    return found
