"""Posed bodies before the camera."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from core_solver.body import kinematics
from core_solver.body.model import BodyModel
from core_solver.evaluation.synthetic.perform import Performance
from core_solver.evaluation.synthetic.physique import Physique
from core_solver.evaluation.synthetic.world import View
from core_solver.geometry import rotvec_from_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Actor:
    """One person over T frames: `scale * points(theta, betas) + gamma`, camera frame, metres.

    Attributes:
        body: body model.
        physique: betas and scale.
        theta: (T, 24, 3) radians.
        gamma: (T, 3).
    """

    body: BodyModel
    physique: Physique
    theta: Array
    gamma: Array

    @cached_property
    def _frames(self) -> tuple[Array, Array]:
        return kinematics.pose_joints(self.theta, self.body.rest_joints(self.physique.betas))

    @property
    def joints(self) -> Array:
        """(T, 24, 3)."""
        return self.physique.scale * self._frames[1] + self.gamma[:, None]

    @property
    def keypoints(self) -> Array:
        """(T, 25, 3)."""
        rest = self.body.rest_keypoints(self.physique.betas)
        return self._skin(rest, self.body.keypoint_weights, slice(None))

    def vertices(self, frames: slice, rows: NDArray[np.integer] | None = None) -> Array:
        """(t, P, 3) of some frames; all vertices, or only some rows."""
        rows = np.arange(len(self.body.template)) if rows is None else rows
        rest = self.body.rest_vertices(self.physique.betas)[rows]
        return self._skin(rest, self.body.weights[rows], frames)

    def _skin(self, rest: Array, weights: Array, frames: slice) -> Array:
        rotations, positions = self._frames
        joints = self.body.rest_joints(self.physique.betas)
        points = kinematics.skin(rest, weights, rotations[frames], positions[frames], joints)
        return self.physique.scale * points + self.gamma[frames, None]


def put_before_camera(performance: Performance, physique: Physique, body: BodyModel, view: View) -> Actor:
    """A performance in the camera's frame."""
    rotations = performance.rotations.copy()
    rotations[:, 0] = view.rotation @ rotations[:, 0]
    root = physique.scale * body.rest_joints(physique.betas)[0]
    gamma = view.to_camera(performance.pelvis) - root
    return Actor(body, physique, rotvec_from_matrix(rotations), gamma)
