"""Label and disparity grids as an ideal camera would have seen them, at the solver's resolution."""

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.raster import Pinhole


def raster_grid(camera: Camera, long_side: int) -> Pinhole:
    """An ideal camera whose longer side has this many pixels, or the footage's if that is fewer."""
    factor = min(long_side / max(camera.width, camera.height), 1.0)
    return Pinhole.on_grid(camera, max(1, round(camera.width * factor)), max(1, round(camera.height * factor)))


def ideal_grids(grids: NDArray, camera: Camera, pinhole: Pinhole) -> NDArray:
    """Nearest values of (T, h, w) grids laid over the distorted footage, on the ideal camera's grid: (T, H, W).

    Outside the footage the nearest border's value is repeated.
    """
    column, row = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    rays = np.stack(
        [(column - pinhole.cx) / pinhole.fx, (row - pinhole.cy) / pinhole.fy, np.ones_like(column)], axis=-1
    )
    seen = camera.project(rays.reshape(-1, 3)) * (grids.shape[2] / camera.width, grids.shape[1] / camera.height)
    x, y = np.clip(np.floor(seen).astype(int), 0, (grids.shape[2] - 1, grids.shape[1] - 1)).T
    return np.ascontiguousarray(grids.reshape(len(grids), -1)[:, y * grids.shape[2] + x]).reshape(
        len(grids), pinhole.height, pinhole.width
    )
