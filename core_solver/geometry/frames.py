"""From the camera's frame to a gravity-aligned world."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.geometry.rigid import Similarity


@dataclass(frozen=True)
class GroundFrame:
    """Gravity and ground, in the camera's frame.

    Attributes:
        gravity: (3,) unit vector that points down.
        normal: (3,) unit normal of the ground, pointing up (against gravity).
        offset: metres; ground points x satisfy normal . x + offset = 0, so it is the camera's height above the plane.
    """

    gravity: NDArray[np.float64]
    normal: NDArray[np.float64]
    offset: float

    def height_above(self, points: ArrayLike) -> NDArray[np.float64]:
        """Signed distance of (..., 3) camera-frame points from the ground plane, metres, positive above."""
        return np.asarray(points, float) @ self.normal + self.offset


def world_from_camera(ground: GroundFrame) -> Similarity:
    """The rigid motion from the camera's frame (OpenCV) to the world (z up, origin on the ground below the camera).

    The world's z axis is minus gravity. Its y axis is the camera's viewing direction laid flat, so that footage is
    seen from the front; a camera that looks straight down uses the image's upward direction instead.

    Args:
        ground: gravity and ground plane in the camera's frame.

    Returns:
        A transform with scale 1: world = rotation @ camera + translation.
    """
    up = -np.asarray(ground.gravity, float) / np.linalg.norm(ground.gravity)
    forward = np.array([0.0, 0.0, 1.0])
    if np.linalg.norm(np.cross(up, forward)) < 1e-3:
        forward = np.array([0.0, -1.0, 0.0])
    y_axis = forward - (forward @ up) * up
    y_axis /= np.linalg.norm(y_axis)
    rotation = np.stack([np.cross(y_axis, up), y_axis, up])
    # The point where the vertical through the camera centre meets the ground plane becomes the origin.
    origin = -up * ground.offset / (ground.normal @ up)
    return Similarity(rotation, -rotation @ origin)
