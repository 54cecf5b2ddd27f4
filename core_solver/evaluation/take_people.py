"""What a take says, in points that truth of any skeleton can be compared with."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body import pose_joints, skin
from core_solver.body.skeleton import joint_index
from core_solver.camera import camera_from_model
from core_solver.evaluation.metrics import Array, Mask, first_to_last
from core_solver.take import JOINT_NAMES, Person, Take

HEAD_TOP = "head_top"
POINT_NAMES = (*JOINT_NAMES, HEAD_TOP)
"""The joints of a take, and the highest point of the body in rest, which follows the head."""


@dataclass(frozen=True)
class TakePeople:
    """P people over the take's T frames, camera frame, metres.

    Attributes:
        points: (P, T, 25, 3) in the order of `POINT_NAMES`.
        found: (P, T) from a person's first to their last frame with evidence, gaps between included.
        scores: (P, T) mean confidence of the joints.
        pixels: (P, T, 25, 2) the points in the footage, through the take's own camera; NaN behind it.
        heights: (P,) statures.
        ids: of the people in the take.
        frames: (T,) frame numbers in the video.
        frame_rate: frames of the take a second.
    """

    points: Array
    found: Mask
    scores: Array
    pixels: Array
    heights: Array
    ids: tuple[int, ...]
    frames: NDArray[np.int64]
    frame_rate: float

    @property
    def roots(self) -> Array:
        """(P, T, 3) midway between the hips."""
        return self.points[:, :, _HIPS].mean(axis=2)

    @property
    def root_pixels(self) -> Array:
        """(P, T, 2) midway between the hips in the footage."""
        return self.pixels[:, :, _HIPS].mean(axis=2)


_HIPS = [joint_index("left_hip"), joint_index("right_hip")]


def people_of(take: Take) -> TakePeople:
    """Pose everybody of a take: scale * FK(theta, rest joints) + gamma."""
    meta, count = take.meta, take.frame_count
    points = np.zeros((len(take.people), count, len(POINT_NAMES), 3))
    for index, person in enumerate(take.people):
        points[index] = _pose(person)
    in_front = np.where(points[..., 2:] > 0, points, np.nan)
    return TakePeople(
        points=points,
        found=np.array([first_to_last(person.valid) for person in take.people], bool).reshape(-1, count),
        scores=np.array([person.confidence.mean(axis=1) for person in take.people]).reshape(-1, count),
        pixels=camera_from_model(meta.camera).project(in_front),
        heights=np.array([person.height_m for person in take.people]),
        ids=tuple(person.id for person in take.people),
        frames=meta.first_frame + meta.frame_step * np.arange(count),
        frame_rate=float(meta.frame_rate),
    )


def _pose(person: Person) -> Array:
    """(T, 25, 3)."""
    rotations, joints = pose_joints(person.theta, person.rest_joints)
    top = _head_top(person, rotations, joints)
    return person.scale * np.concatenate([joints, top], axis=1) + person.gamma[:, None]


def _head_top(person: Person, rotations: Array, joints: Array) -> Array:
    """(T, 1, 3) the highest vertex of the rest pose, skinned; NaN for a take without a surface."""
    if len(person.rest_vertices) == 0:
        return np.full((len(joints), 1, 3), np.nan)
    vertex = int(np.argmax(person.rest_vertices[:, 1]))  # rest poses stand along y
    weights = np.zeros((1, len(JOINT_NAMES)))
    np.add.at(weights[0], person.weight_joints[vertex], person.weights[vertex])
    return skin(person.rest_vertices[[vertex]], weights, rotations, joints, person.rest_joints)
