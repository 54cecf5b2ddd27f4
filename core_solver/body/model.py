"""One body model for everything downstream, whether it came from the open default or from a user's SMPL file."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyModel:
    """A linear body: shape moves the rest vertices, skinning poses them.

    Rest frame: SMPL's axes (y up, z to the front, x to the body's left), T-pose, metres.

    Attributes:
        id: "open-body-1" or "smpl-" and the first 8 digits of the file's sha256: betas mean nothing without it.
        licence: one line for the take file.
        template: (V, 3) rest vertices at betas = 0.
        shape_directions: (V, 3, 10) metres per unit of beta.
        pose_directions: (V, 3, 207) SMPL's pose corrections, or None.
        joint_regressor: (24, V) rows sum to 1.
        weights: (V, 24) skinning weights, rows sum to 1.
        faces: (F, 3) triangles, anticlockwise seen from outside.
        keypoint_regressor: (25, V) rows are non-negative and sum to 1.
        neutral_betas: (10,) an average adult. The open body's zero is a mean over all ages.
        proxy: (P,) about 500 vertices spread over the body with soles and hands: enough for vertex terms.
    """

    id: str
    licence: str
    template: Array
    shape_directions: Array
    pose_directions: Array | None
    joint_regressor: Array
    weights: Array
    faces: NDArray[np.int32]
    keypoint_regressor: Array
    neutral_betas: Array
    proxy: NDArray[np.int32]

    @cached_property
    def joint_template(self) -> Array:
        """(24, 3) rest joints at betas = 0, metres."""
        return self.joint_regressor @ self.template

    @cached_property
    def joint_directions(self) -> Array:
        """(24, 3, 10) how the rest joints move with betas."""
        return np.tensordot(self.joint_regressor, self.shape_directions, axes=1)

    @cached_property
    def keypoint_template(self) -> Array:
        """(25, 3) rest keypoints at betas = 0, metres."""
        return self.keypoint_regressor @ self.template

    @cached_property
    def keypoint_directions(self) -> Array:
        """(25, 3, 10) how the rest keypoints move with betas."""
        return np.tensordot(self.keypoint_regressor, self.shape_directions, axes=1)

    @cached_property
    def keypoint_weights(self) -> Array:
        """(25, 24) skinning weights of the keypoints: each is carried along like one more vertex."""
        return self.keypoint_regressor @ self.weights

    def rest_joints(self, betas: ArrayLike) -> Array:
        """Joints (24, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.joint_template + _directed(self.joint_directions, betas)

    def rest_vertices(self, betas: ArrayLike) -> Array:
        """Vertices (V, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.template + _directed(self.shape_directions, betas)

    def rest_keypoints(self, betas: ArrayLike) -> Array:
        """Keypoints (25, 3) of the rest pose in metres, for (10,) betas; leading dimensions of betas are kept."""
        return self.keypoint_template + _directed(self.keypoint_directions, betas)

    def height(self, betas: ArrayLike) -> float:
        """Stature in metres: the vertical extent of the rest vertices, soles to crown."""
        return float(np.ptp(self.rest_vertices(betas)[:, 1]))


def _directed(directions: Array, betas: ArrayLike) -> Array:
    """(n, 3, 10) directions applied to (..., 10) betas: (..., n, 3) offsets."""
    return np.tensordot(np.asarray(betas, float), directions, axes=([-1], [-1]))
