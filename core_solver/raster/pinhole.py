"""The ideal camera of a raster grid."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.take.model import CameraModel


@dataclass(frozen=True)
class Pinhole:
    """Pinhole intrinsics in pixels of a raster grid; the centre of its top-left pixel is at (0.5, 0.5).

    Attributes:
        width: pixels of the grid.
        height: pixels of the grid.
        fx: focal length in pixels of the grid.
        fy: focal length in pixels of the grid.
        cx: principal point in pixels of the grid.
        cy: principal point in pixels of the grid.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @classmethod
    def on_grid(cls, camera: CameraModel, width: int, height: int) -> "Pinhole":
        """The camera seen on a grid laid over its whole image; distortion is ignored (masks must be undistorted)."""
        across, down = width / camera.width, height / camera.height
        return cls(width, height, camera.fx * across, camera.fy * down, camera.cx * across, camera.cy * down)

    @property
    def lens(self) -> NDArray[np.float32]:
        """(4,) fx fy cx cy such that pixel CENTRES are at whole numbers, as the kernels count."""
        return np.array([self.fx, self.fy, self.cx - 0.5, self.cy - 0.5], np.float32)
