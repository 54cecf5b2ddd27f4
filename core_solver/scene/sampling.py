"""Reading disparity under body vertices and around feet."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.tracking.tracks import BACKGROUND, Modalities

Array = NDArray[np.float64]

_CELLS_PER_PERSON = 14  # a visibility cell is about a hand's width on the body
_THICKNESS = 0.08  # metres within which vertices of one cell count as one surface


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
    shape = points.shape[:3]
    visible, disparity = np.zeros(shape, bool), np.zeros(shape, np.float32)
    mean, weight = np.zeros(shape[:2]), np.zeros(shape[:2])
    for n, track in enumerate(modalities.tracks):
        for t in np.flatnonzero(valid[n]):
            pixels = camera.project(np.maximum(points[n, t], (-np.inf, -np.inf, 0.05)))
            inside = sample_grid(modalities.labels[t], pixels, camera, outside=BACKGROUND) == track.id
            visible[n, t] = inside & _front(pixels, points[n, t, :, 2])
            count = visible[n, t].sum()
            weight[n, t] = min(1.0, 4 * count / shape[2])
            if count and modalities.disparity is not None:
                values = sample_grid(modalities.disparity[t], pixels[visible[n, t]], camera, outside=0)
                disparity[n, t, visible[n, t]] = values
                mean[n, t] = float(values.astype(float).mean())
    return BodyDepth(visible, disparity, mean, weight)


def sample_grid(grid: NDArray, pixels: Array, camera: Camera, outside: float) -> NDArray:
    """Nearest value of a (h, w) grid laid over the whole image at (..., 2) footage pixels."""
    height, width = grid.shape
    finite = np.isfinite(pixels).all(axis=-1)
    safe = np.where(finite[..., None], np.clip(pixels, -1e6, 1e6), -1)
    column = np.floor(safe[..., 0] * width / camera.width).astype(int)
    row = np.floor(safe[..., 1] * height / camera.height).astype(int)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    values = grid[np.where(inside, row, 0), np.where(inside, column, 0)]
    return np.where(inside, values, outside)


def _front(pixels: Array, depth: Array) -> NDArray[np.bool_]:
    """Vertices within a surface's thickness of the nearest one in their cell of the picture."""
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    cell = max(float((high - low).max()) / _CELLS_PER_PERSON, 1e-6)
    column, row = ((pixels - low) / cell).astype(int).T
    index = row * (_CELLS_PER_PERSON + 1) + column
    nearest = np.full(index.max() + 1, np.inf)
    np.minimum.at(nearest, index, depth)
    return (depth < nearest[index] + _THICKNESS) & (depth > 0.05)


@dataclass(frozen=True)
class FloorSamples:
    """Background places close to planted feet, where the picture shows the floor.

    Attributes:
        rays: (M, 3) with z = 1.
        disparity: (M,).
        frames: (M,) frame of each sample.
    """

    rays: Array
    disparity: Array
    frames: NDArray[np.int64]


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
    pixels, values, frames = [], [], []
    for n, t, side in chosen:
        # To both sides of the foot and below it: a tenth of the person's size away lies floor, not leg.
        steps = size[n, t] * np.array([(-0.12, 0.0), (0.12, 0.0), (-0.08, 0.06), (0.08, 0.06)])
        around = feet[n, t, side] + steps
        bare = sample_grid(modalities.labels[t], around, camera, outside=255) == BACKGROUND
        pixels.append(around[bare])
        values.append(sample_grid(disparity[t], around[bare], camera, outside=0))
        frames.append(np.full(bare.sum(), t))
    if not pixels:
        return nothing
    return FloorSamples(
        camera.rays(np.concatenate(pixels)), np.concatenate(values).astype(float), np.concatenate(frames)
    )
