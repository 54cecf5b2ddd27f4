# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's motion as the pose channels of a Blender armature that stands at the world's origin. numpy only."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import Similarity, matrix_from_rotvec, quaternion_from_matrix, quaternion_from_rotvec
from core_solver.take import Person

from ..retarget.skeleton import without_flips
from .world import REST_FROM_BODY, root_path

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PoseChannels:
    """What is keyed on the pose bones.

    Attributes:
        rotations: (T, 24, 4) quaternions (w, x, y, z) in each bone's own rest axes; neighbours in time never flip sign.
        root: (T, 3) location of the pelvis bone in its own rest axes, metres.
    """

    rotations: Array
    root: Array


def pose_channels(person: Person, world: Similarity, bone_axes: Array, root_head: Array) -> PoseChannels:
    """Turn a person's theta and gamma into pose channels.

    With B from the body's axes to the rest pose's and Q_j the rest axes of bone j, a rotation R_j of the body reads
    Q_j^T B R_j B^T Q_j in the bone: the same angle about a turned axis. The root also carries the way from the
    camera's frame to the world, W: its rotation is Q_0^T W R_0 B^T Q_0.

    Args:
        person: motion in the camera's frame.
        world: camera frame to world.
        bone_axes: (24, 3, 3) columns are the bones' x, y, z axes at rest, in the armature's space.
        root_head: (3,) head of the pelvis bone at rest, metres.

    Returns:
        The channels; the joints' world positions are then world(scale * FK(theta, rest_joints) + gamma).
    """
    theta = np.asarray(person.theta, float)
    bone_from_body = np.swapaxes(bone_axes, -1, -2) @ REST_FROM_BODY
    rotations = quaternion_from_rotvec(np.einsum("jab,tjb->tja", bone_from_body, theta))
    root_axes = bone_axes[0]
    turn = root_axes.T @ world.rotation @ matrix_from_rotvec(theta[:, 0]) @ REST_FROM_BODY.T @ root_axes
    rotations[:, 0] = quaternion_from_matrix(turn)
    return PoseChannels(without_flips(rotations), (root_path(person, world) - root_head) @ root_axes)
