"""Reading disparity under body vertices and around feet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.tracking.tracks import BACKGROUND, Modalities

Array = NDArray[np.float64]

_CELLS_PER_PERSON = 14  # a visibility cell is about a hand's width on the body
_THICKNESS = 0.08  # metres within which vertices of one cell count as one surface
_NEAREST = 0.05  # metres; what is nearer or behind the camera is not seen
_CHUNK_POINTS = 1 << 15


@dataclass(frozen=True)
class BodyDepth:
    """Disparity under the visible vertices of all people.

    Attributes:
        visible: (N, T, P) vertex seen by the camera and inside the person's own mask.
        disparity: (N, T, P) under each vertex, 0 where not visible.
        mean_disparity: (N, T) over the visible vertices, 0 without any.
        weight: (N, T) in [0, 1], 0 where body and mask do not meet.
    """

    visible: NDArray[np.bool_]
    disparity: NDArray[np.float32]
    mean_disparity: Array
    weight: Array


def sample_bodies(points: Array, valid: NDArray[np.bool_], modalities: Modalities, camera: Camera) -> BodyDepth:
    """Find visible proxy vertices and read the disparity below them.

    Args:
        points: (N, T, P, 3) metres, camera frame.
        valid: (N, T).
        modalities: labels and disparity.
        camera: intrinsics.
    """
    people, frames, count = points.shape[:3]
    visible, disparity = np.zeros((people, frames, count), bool), np.zeros((people, frames, count), np.float32)
    # Chunks fit the cache and keep memory the same for a clip of any length.
    chunk = max(1, _CHUNK_POINTS // count)
    for n, track in enumerate(modalities.tracks):
        seen = np.flatnonzero(valid[n])
        for rows in np.split(seen, range(chunk, len(seen), chunk)):
            # Points that are nowhere are put infinitely far: nobody sees them and they hide nobody.
            finite = np.isfinite(points[n, rows]).all(axis=-1, keepdims=True)
            body = np.where(finite, points[n, rows], (0.0, 0.0, np.inf))
            pixels = camera.project(np.maximum(body, (-np.inf, -np.inf, _NEAREST)))
            owners = sample_frames(modalities.labels, rows[:, None], pixels, camera, outside=BACKGROUND)
            shown = (owners == track.id) & _front(pixels, body[..., 2])
            visible[n, rows] = shown
            if modalities.disparity is not None:
                values = sample_frames(modalities.disparity, rows[:, None], pixels, camera, outside=0)
                visible[n, rows] &= np.isfinite(values)
                disparity[n, rows] = np.where(visible[n, rows], values, 0)
    total = visible.sum(axis=-1)
    mean = disparity.sum(axis=-1, dtype=float) / np.maximum(total, 1)
    return BodyDepth(visible, disparity, mean, np.minimum(1.0, 4 * total / count))


def sample_grid(grid: NDArray, pixels: Array, camera: Camera, outside: float) -> NDArray:
    """Nearest value of a (h, w) grid laid over the whole image at (..., 2) footage pixels."""
    return sample_frames(grid[None], np.zeros((), int), pixels, camera, outside)


def sample_frames(
    grids: NDArray, frames: NDArray[np.int64], pixels: Array, camera: Camera, outside: float
) -> NDArray:  # fmt: skip
    """Nearest values of (T, h, w) grids, each laid over the whole image.

    Args:
        grids: one a frame.
        frames: the grid to read for each pixel; broadcasts against (...).
        pixels: (..., 2) in the footage.
        camera: intrinsics.
        outside: value beyond the image and at pixels that are not finite.

    Returns:
        (...) values.
    """
    height, width = grids.shape[1:]
    u, v = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
    # Far outside is as good as infinitely far, and fits an integer; NaN lies outside too.
    column = np.floor(np.nan_to_num(u * width / camera.width, nan=-1.0).clip(-1, width)).astype(int)
    row = np.floor(np.nan_to_num(v * height / camera.height, nan=-1.0).clip(-1, height)).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    values = grids[frames, np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.where(inside, values, outside)


def _front(pixels: Array, depth: Array) -> NDArray[np.bool_]:
    """Vertices (F, P) within a surface's thickness of the nearest one in their cell of that frame's picture."""
    # The two coordinates one after the other: each in one piece of memory is several times faster.
    u, v = np.ascontiguousarray(np.moveaxis(pixels, -1, 0))
    left, top = u.min(axis=1, keepdims=True), v.min(axis=1, keepdims=True)
    extent = np.maximum(u.max(axis=1, keepdims=True) - left, v.max(axis=1, keepdims=True) - top)
    cell = np.maximum(extent / _CELLS_PER_PERSON, 1e-6)
    side = _CELLS_PER_PERSON + 1
    column, row = (np.nan_to_num(x / cell).clip(0, side - 1).astype(int) for x in (u - left, v - top))
    index = (np.arange(len(pixels))[:, None] * side + row) * side + column
    nearest = np.full(len(pixels) * side * side, np.inf)
    np.minimum.at(nearest, index.ravel(), depth.ravel())
    return (depth < nearest[index] + _THICKNESS) & (depth > _NEAREST)


@dataclass(frozen=True)
class FloorSamples:
    """Background places close to planted feet, where the picture shows the floor.

    Attributes:
        rays: (M, 3) with z = 1.
        disparity: (M,).
        people: (M,) whose feet each sample is beside.
    """

    rays: Array
    disparity: Array
    people: NDArray[np.int64]


def sample_floor(
    feet: Array, planted: Array, size: Array, modalities: Modalities, camera: Camera, most: int = 600
) -> FloorSamples:
    """Disparity just beside planted feet.

    Args:
        feet: (N, T, 2, 2) pixels of each foot in the footage.
        planted: (N, T, 2) probability.
        size: (N, T) extent of the person in pixels.
        modalities: labels and disparity.
        camera: intrinsics.
        most: samples at most, spread evenly.
    """
    disparity = modalities.disparity
    nothing = FloorSamples(np.zeros((0, 3)), np.zeros(0), np.zeros(0, int))
    if disparity is None:
        return nothing
    chosen = np.argwhere(planted > 0.5)
    chosen = chosen[:: max(1, len(chosen) * 4 // most)]
    pixels, values, people = [], [], []
    for n, t, side in chosen:
        # To both sides of the foot and below it: a tenth of the person's size away lies floor, not leg.
        steps = size[n, t] * np.array([(-0.12, 0.0), (0.12, 0.0), (-0.08, 0.06), (0.08, 0.06)])
        around = feet[n, t, side] + steps
        below = sample_grid(disparity[t], around, camera, outside=0)
        bare = (sample_grid(modalities.labels[t], around, camera, outside=255) == BACKGROUND) & np.isfinite(below)
        pixels.append(around[bare])
        values.append(below[bare])
        people.append(np.full(bare.sum(), n))
    if not pixels:
        return nothing
    return FloorSamples(
        camera.rays(np.concatenate(pixels)), np.concatenate(values).astype(float), np.concatenate(people)
    )
