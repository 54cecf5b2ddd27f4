"""A first pose straight from 3D keypoints: torso by least squares, limbs by the direction of each bone.

The rest pose is a T-pose in SMPL's axes: arms along +-x, legs along -y, both folding in the (bone, z) plane.
"""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import PARENTS, joint_index, keypoint_index
from core_solver.geometry import align_vectors, rotvec_from_matrix

Array = NDArray[np.float64]

_TORSO = [keypoint_index(n) for n in ("left_shoulder", "right_shoulder", "left_hip", "right_hip")]
# Upper joint, lower joint, end joint; their keypoints; whether the lower bone folds towards +z (arms) or -z (legs).
_LIMBS = [
    (f"{side}_{upper}", f"{side}_{lower}", f"{side}_{end}", sign)
    for side in ("left", "right")
    for upper, lower, end, sign in (("shoulder", "elbow", "wrist", 1.0), ("hip", "knee", "ankle", -1.0))
]
# Below this sine of the bend the fold says little about the twist of the upper bone.
_CLEAR_BEND = 0.35


def limb_pose(keypoints: Array, rest_keypoints: Array, rest_joints: Array) -> Array:
    """Axis-angle pose whose torso and limbs point as the keypoints do.

    Args:
        keypoints: (T, 25, 3) metres, any origin.
        rest_keypoints: (25, 3) metres.
        rest_joints: (24, 3) metres.

    Returns:
        (T, 24, 3) theta in radians.
    """
    count = len(keypoints)
    torso = _torso_rotation(keypoints, rest_keypoints)
    turns = np.repeat(torso[:, None], 24, axis=1)
    for upper, lower, end, sign in _LIMBS:
        a, b, c = (keypoints[:, keypoint_index(n)] for n in (upper, lower, end))
        upper_joint, lower_joint = joint_index(upper), joint_index(lower)
        rest_upper = rest_joints[lower_joint] - rest_joints[upper_joint]
        rest_lower = rest_joints[joint_index(end)] - rest_joints[lower_joint]
        turns[:, upper_joint] = _turn_with_fold(rest_upper, b - a, sign * (c - b), turns[:, upper_joint])
        carried = turns[:, upper_joint] @ rest_lower
        turns[:, lower_joint] = align_vectors(carried, _safe(c - b, carried)) @ turns[:, upper_joint]
        for child in _below(lower_joint):
            turns[:, child] = turns[:, lower_joint]
    parents = np.array(PARENTS)
    local = turns.copy()
    local[:, 1:] = np.swapaxes(turns[:, parents[1:]], -1, -2) @ turns[:, 1:]
    return rotvec_from_matrix(local).reshape(count, 24, 3)


def _torso_rotation(keypoints: Array, rest_keypoints: Array) -> Array:
    source = rest_keypoints[_TORSO] - rest_keypoints[_TORSO].mean(axis=0)
    target = keypoints[:, _TORSO] - keypoints[:, _TORSO].mean(axis=1, keepdims=True)
    U, _, Vt = np.linalg.svd(np.swapaxes(target, -1, -2) @ source)
    signs = np.ones((len(keypoints), 3))
    signs[:, 2] = np.sign(np.linalg.det(U @ Vt))
    return (U * signs[:, None, :]) @ Vt


def _turn_with_fold(rest: Array, bone: Array, fold: Array, inherited: Array) -> Array:
    """Turn `rest` into `bone` with the twist that lets the joint below fold about its own hinge."""
    bone = _safe(bone, inherited @ rest)
    plain = align_vectors(inherited @ rest, bone) @ inherited
    direction = bone / np.linalg.norm(bone, axis=-1, keepdims=True)
    across = fold - np.sum(fold * direction, axis=-1, keepdims=True) * direction
    bend = np.linalg.norm(across, axis=-1, keepdims=True) / np.maximum(
        np.linalg.norm(fold, axis=-1, keepdims=True), 1e-9
    )
    front = plain[..., 2]
    front = front - np.sum(front * direction, axis=-1, keepdims=True) * direction
    trust = np.clip(bend / _CLEAR_BEND, 0, 1) ** 2
    wanted = trust * across / np.maximum(np.linalg.norm(across, axis=-1, keepdims=True), 1e-9) + (1 - trust) * front
    return _twist(direction, front, wanted) @ plain


def _twist(axis: Array, source: Array, target: Array) -> Array:
    """Rotation about the unit `axis` that brings `source` towards `target`, both across it."""
    sine = np.sum(axis * np.cross(source, target), axis=-1)[..., None, None]
    cosine = np.sum(source * target, axis=-1)[..., None, None]
    length = np.maximum(np.hypot(sine, cosine), 1e-12)
    sine, cosine = np.where(length > 1e-9, sine / length, 0), np.where(length > 1e-9, cosine / length, 1)
    outer = axis[..., :, None] * axis[..., None, :]
    zero = np.zeros_like(axis[..., 0])
    x, y, z = np.moveaxis(axis, -1, 0)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(*axis.shape[:-1], 3, 3)
    return cosine * np.eye(3) + sine * K + (1 - cosine) * outer


def _safe(direction: Array, fallback: Array) -> Array:
    return np.where(np.linalg.norm(direction, axis=-1, keepdims=True) > 1e-6, direction, fallback)


def _below(joint: int) -> list[int]:
    found = [j for j, parent in enumerate(PARENTS) if parent == joint]
    return found + [k for j in found for k in _below(j)]
