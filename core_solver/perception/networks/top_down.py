"""Reading poses of one person on a crop: heatmaps (ViTPose, HRNet) and SimCC (RTMPose)."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]

_BLUR_SIGMA = 2.0  # cells; evens a peak before its logarithm is differentiated
_SMALLEST = 1e-10


def read_heatmaps(maps: Floats, size: tuple[int, int], refine: str, *, udp: bool) -> tuple[Floats, Floats]:
    """Where heatmaps are highest.

    Args:
        maps: (N, K, h, w).
        size: (width, height) of the crop.
        refine: "none", "quarter" (a quarter cell towards the higher neighbour) or "dark" (a parabola through the
            logarithm of the blurred peak).
        udp: the centres of the corner cells lie on those of the crop's corner pixels; else their corners do.

    Returns:
        (N, K, 2) pixels of the crop, and (N, K) peak heights.
    """
    people, count, rows, columns = maps.shape
    flat = maps.reshape(people, count, -1)
    peak = flat.argmax(axis=-1)
    height = flat.max(axis=-1)
    cells = np.stack([peak % columns, peak // columns], axis=-1).astype(np.float32)
    if refine != "none":
        step = _quarter_step if refine == "quarter" else _dark_step
        offsets = [
            step(plane, cell) for plane, cell in zip(maps.reshape(-1, rows, columns), cells.reshape(-1, 2), strict=True)
        ]
        cells = cells + np.array(offsets, np.float32).reshape(cells.shape)
    grid, crop = np.array([columns, rows]), np.array(size)
    if udp:
        return (cells * ((crop - 1) / (grid - 1)) + 0.5).astype(np.float32), height
    # Training puts the peak of pixel index i at cell i * grid / crop; pixel index i has its centre at i + 0.5.
    return (cells * (crop / grid) + 0.5).astype(np.float32), height


def read_simcc(across: Floats, down: Floats, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Where the two classifications of columns and rows are surest.

    Args:
        across: (N, K, c) scores of fractions of columns.
        down: (N, K, r) scores of fractions of rows.
        size: (width, height) of the crop.

    Returns:
        (N, K, 2) pixels of the crop, and (N, K) the lesser of both best scores.
    """
    bins = np.stack([across.argmax(axis=-1), down.argmax(axis=-1)], axis=-1)
    per_bin = np.array(size) / (across.shape[-1], down.shape[-1])
    confidence = np.minimum(across.max(axis=-1), down.max(axis=-1))
    return (bins * per_bin + 0.5).astype(np.float32), confidence


def _quarter_step(plane: Floats, cell: Floats) -> Floats:
    x, y = cell.astype(int)
    rows, columns = plane.shape
    if not (0 < x < columns - 1 and 0 < y < rows - 1):
        return np.zeros(2, np.float32)
    slope = (plane[y, x + 1] - plane[y, x - 1], plane[y + 1, x] - plane[y - 1, x])
    return (0.25 * np.sign(slope)).astype(np.float32)


def _dark_step(plane: Floats, cell: Floats) -> Floats:
    """Newton's step to the top of the logarithm of the blurred peak, which is a parabola for a Gaussian."""
    x, y = cell.astype(int)
    rows, columns = plane.shape
    if not (1 < x < columns - 2 and 1 < y < rows - 2):
        return np.zeros(2, np.float32)
    blurred = cv2.GaussianBlur(plane, (0, 0), _BLUR_SIGMA, borderType=cv2.BORDER_CONSTANT)
    part = np.log(np.maximum(blurred[y - 2 : y + 3, x - 2 : x + 3], _SMALLEST))
    slope = np.array([part[2, 3] - part[2, 1], part[3, 2] - part[1, 2]]) / 2
    across = (part[2, 4] - 2 * part[2, 2] + part[2, 0]) / 4
    down = (part[4, 2] - 2 * part[2, 2] + part[0, 2]) / 4
    both = (part[3, 3] - part[1, 3] - part[3, 1] + part[1, 1]) / 4
    curvature = np.array([[across, both], [both, down]])
    if np.linalg.det(curvature) <= _SMALLEST or across >= 0:
        return np.zeros(2, np.float32)
    return np.clip(-np.linalg.solve(curvature, slope), -1, 1).astype(np.float32)
