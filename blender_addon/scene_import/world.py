# SPDX-License-Identifier: GPL-3.0-or-later
"""Axes and frames: the one place that says how a take's space and time map to Blender's. numpy only.

Space: a take lives in the camera's frame (OpenCV); Blender's world has z up along minus gravity and its origin on the
ground. Bodies rest in SMPL's axes (y up, z to the front, x to the body's left); a rest pose in Blender stands upright
and faces -y, so that "front view" shows its face.
Time: the first frame of a take is frame 1 of Blender's scene.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.geometry import GroundFrame, Similarity, world_from_camera
from core_solver.take import Meta

Array = NDArray[np.float64]

FIRST_FRAME = 1

UP = (0.0, 0.0, 1.0)
FRONT = (0.0, -1.0, 0.0)

REST_FROM_BODY: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turns SMPL's axes into those of a rest pose in Blender."""

_CAMERA_FROM_LENS: Array = np.diag([1.0, -1.0, -1.0])
"""Blender's camera looks along -z with y up; OpenCV's looks along z with y down."""


def world_of(meta: Meta) -> Similarity:
    """The rigid motion from a take's camera frame to Blender's world, metres."""
    ground = GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)
    return world_from_camera(ground)


def lens_matrix(world: Similarity) -> Array:
    """(4, 4) world matrix of Blender's camera object."""
    matrix = np.eye(4)
    matrix[:3, :3] = world.rotation @ _CAMERA_FROM_LENS
    matrix[:3, 3] = world.translation
    return matrix


def rest_from_body(points: ArrayLike, scale: float) -> Array:
    """(..., 3) points of a body's rest pose, in Blender's axes and at the person's real size, metres."""
    return scale * np.asarray(points, float) @ REST_FROM_BODY.T


def frame_numbers(frame_count: int) -> Array:
    """(T,) scene frames of a take's frames."""
    return np.arange(frame_count, dtype=np.float64) + float(FIRST_FRAME)
