"""Static scenes made of boxes, seen exactly: depth maps whose every point is known in closed form."""

from dataclasses import dataclass

import numpy as np

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import GroundFrame, matrix_from_rotvec

FAR = 1e9


@dataclass(frozen=True)
class Room:
    """World: z up, the floor at z = 0 below the camera, y ahead of it.

    Attributes:
        boxes: (B, 2, 3) least and greatest corners, metres.
        camera_height: metres.
        tilt: radians by which the camera looks down.
        slope: rise of the floor per metre ahead; gravity stays vertical.
    """

    boxes: np.ndarray
    camera_height: float = 1.7
    tilt: float = 0.35
    slope: float = 0.0

    @property
    def camera(self) -> Camera:
        return camera_from_fov(448, 256, 65, "test")

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3) world to camera."""
        level = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        return matrix_from_rotvec([self.tilt, 0, 0]) @ level

    @property
    def up(self) -> np.ndarray:
        return self.rotation[:, 2]

    @property
    def ground(self) -> GroundFrame:
        normal = self.rotation @ (np.array([0, -self.slope, 1.0]) / np.hypot(1, self.slope))
        return GroundFrame(-self.up, normal, self.camera_height / np.hypot(1, self.slope))

    def to_camera(self, points: np.ndarray) -> np.ndarray:
        return (np.asarray(points, float) - (0, 0, self.camera_height)) @ self.rotation.T

    def height_of(self, points: np.ndarray) -> np.ndarray:
        """Camera-frame up . x to the world's z."""
        return points + self.camera_height

    def depth(self, rows: int = 256, columns: int = 448) -> np.ndarray:
        """(rows, columns) metres; NaN where nothing is seen within 20 m."""
        rays = self.camera.grid_rays(rows, columns) @ self.rotation
        eye = np.array([0, 0, self.camera_height])
        with np.errstate(divide="ignore", invalid="ignore"):
            fall = self.slope * rays[..., 1] - rays[..., 2]
            depth = np.where(fall > 0, self.camera_height / fall, FAR)
            for low, high in self.boxes:
                first, second = (low - eye) / rays, (high - eye) / rays
                enter, leave = np.minimum(first, second).max(-1), np.maximum(first, second).min(-1)
                depth = np.where((enter < leave) & (enter > 0), np.minimum(depth, enter), depth)
        return np.where(depth < 20, depth, np.nan).astype(np.float32)


def box(x: tuple[float, float], y: tuple[float, float], z: tuple[float, float]) -> np.ndarray:
    return np.stack([x, y, z], axis=1)


NOTHING = np.zeros((0, 2, 3))
BARE = Room(NOTHING)
STAIRS = Room(np.array([box((-1, 1), (3 + 0.28 * i, 8), (0, 0.17 * (i + 1))) for i in range(6)]), camera_height=2.6)
BOX = Room(box((-0.4, 0.4), (3, 3.8), (0, 0.45))[None])
