# SPDX-License-Identifier: GPL-3.0-or-later
"""Axes and frames: the one place that says how a take's space maps to Blender's. numpy only.

Space: a take lives in the camera's frame (OpenCV); Blender's world has z up along minus gravity and its origin on the
ground. Bodies rest in SMPL's axes (y up, z to the front, x to the body's left); a rest pose in Blender stands upright
and faces -y, so that "front view" shows its face. Time has its own place: `clock`.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.geometry import GroundFrame, Similarity, matrix_from_rotvec, world_from_camera
from core_solver.take import Meta, Person

Array = NDArray[np.float64]

UP = (0.0, 0.0, 1.0)
FRONT = (0.0, -1.0, 0.0)

REST_FROM_BODY: Array = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""Turns SMPL's axes into those of a rest pose in Blender."""

_CAMERA_FROM_LENS: Array = np.diag([1.0, -1.0, -1.0])
"""Blender's camera looks along -z with y up; OpenCV's looks along z with y down."""


class Anchor(Enum):
    """What stands at the world's origin."""

    CAMERA = "the ground under the camera"
    PERSON = "the ground under the first person, where first seen"


@dataclass(frozen=True)
class Origin:
    """Where a take stands in Blender's world: what lies at the origin is turned about the vertical, then moved.

    Attributes:
        anchor: what lies at the origin.
        turn: radians, counter-clockwise seen from above.
        offset: metres.
    """

    anchor: Anchor = Anchor.CAMERA
    turn: float = 0.0
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


CAMERA_OVER_ORIGIN = Origin()


def world_of(meta: Meta, people: tuple[Person, ...] = (), origin: Origin = CAMERA_OVER_ORIGIN) -> Similarity:
    """The rigid motion from a take's camera frame to Blender's world, metres.

    Args:
        meta: gravity and ground.
        people: who is brought in; the first can be the origin's anchor.
        origin: where the take shall stand.
    """
    ground = GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)
    world = world_from_camera(ground)
    shift = np.zeros(3)
    if origin.anchor is Anchor.PERSON and people:
        shift[:2] = -_first_place(people[0], world)[:2]
    turn = matrix_from_rotvec([0.0, 0.0, origin.turn])
    return Similarity(turn @ world.rotation, turn @ (world.translation + shift) + np.array(origin.offset))


def root_path(person: Person, world: Similarity) -> Array:
    """(T, 3) the pelvis in the world, metres."""
    return world.apply(person.scale * np.asarray(person.rest_joints[0], float) + np.asarray(person.gamma, float))


def _first_place(person: Person, world: Similarity) -> Array:
    return root_path(person, world)[int(np.argmax(person.valid))]


def lens_matrix(world: Similarity) -> Array:
    """(4, 4) world matrix of Blender's camera object."""
    matrix = np.eye(4)
    matrix[:3, :3] = world.rotation @ _CAMERA_FROM_LENS
    matrix[:3, 3] = world.translation
    return matrix


def rest_from_body(points: ArrayLike, scale: float) -> Array:
    """(..., 3) points of a body's rest pose, in Blender's axes and at the person's real size, metres."""
    return scale * np.asarray(points, float) @ REST_FROM_BODY.T
