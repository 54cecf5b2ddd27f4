"""From MakeHuman's A-pose to the T-pose in which every body of this project rests, and the places of its 24 joints.

Batched over n people; y up, z to the front, x to the body's left, metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.kinematics import skin
from core_solver.body.skeleton import JOINT_NAMES, PARENTS, joint_index
from core_solver.geometry import align_vectors, matrix_from_rotvec

Array = NDArray[np.float64]

_SIDES = (("left", "L", 1.0), ("right", "R", -1.0))
_TOES = tuple(f"toe{i}-1" for i in range(1, 6))
_LIMB_BONES = (
    "clavicle", "upperarm01", "lowerarm01", "wrist", "finger2-1", "finger3-1", "finger5-1",
    "upperleg01", "lowerleg01", "foot", *_TOES,
)  # fmt: skip
RIG_BONES: tuple[str, ...] = ("neck02", *(f"{bone}.{side}" for _, side, _ in _SIDES for bone in _LIMB_BONES))

# Bones of a typical adult in this T-pose, from the parent joint, metres. Directions define the rest pose, so that the
# same theta means the same pose as for other bodies of this skeleton; lengths are each person's own, except along the
# spine, where these proportions are scaled to the torso.
_LEFT_BONES = {
    "left_hip": (0.059, -0.086, -0.016), "left_knee": (0.043, -0.385, 0.002), "left_ankle": (-0.017, -0.423, -0.036),
    "left_foot": (0.038, -0.061, 0.126), "spine1": (0.0, 0.124, -0.038), "spine2": (0.0, 0.138, 0.027),
    "spine3": (0.0, 0.056, 0.003), "neck": (0.0, 0.212, -0.033), "head": (0.0, 0.089, 0.050),
    "left_collar": (0.077, 0.113, -0.021), "left_shoulder": (0.118, 0.046, -0.014),
    "left_elbow": (0.258, -0.015, -0.027), "left_wrist": (0.267, 0.010, -0.007), "left_hand": (0.088, -0.010, -0.013),
}  # fmt: skip
_KNEE_SPREAD = 0.059 + 0.043  # the knees' distance from the middle plane, for a person 1.72 m tall
_TYPICAL_STATURE = 1.72
_SHOULDER_LIFT = np.radians(10.0)  # arms raised to the side lift the shoulder girdle


@dataclass(frozen=True)
class RigPoints:
    """Heads of the rig's bones of n people: positions (n, RIG_BONES, 3)."""

    positions: Array

    def at(self, bone: str) -> Array:
        """(n, 3)."""
        return self.positions[:, RIG_BONES.index(bone)]


@dataclass(frozen=True)
class RestPose:
    """How n people go from the A-pose to the T-pose.

    Attributes:
        rotations: (n, 24, 3, 3) of everything that a joint carries.
        sources: (n, 24, 3) a point of each joint's part in the A-pose.
        targets: (n, 24, 3) where that point goes.
        joints: (n, 24, 3) the joints in the T-pose.
    """

    rotations: Array
    sources: Array
    targets: Array
    joints: Array

    def apply(self, points: Array, weights: Array) -> Array:
        """Carry points (n, P, 3) with skinning weights (P, 24) into the T-pose."""
        return skin(points, weights, self.rotations, self.targets, self.sources)


def find_rest_pose(rig: RigPoints, stature: Array) -> RestPose:
    """The T-pose of n people.

    Args:
        rig: bone heads in the A-pose.
        stature: (n,) metres.
    """
    n = len(stature)
    pose = RestPose(np.tile(np.eye(3), (n, 24, 1, 1)), *(np.zeros((n, 24, 3)) for _ in range(3)))
    torso = _place_spine(pose, rig)
    for side in _SIDES:
        _raise_arm(pose, rig, side, torso)
        _straighten_leg(pose, rig, side, torso, stature)
    return pose


def _bone(name: str) -> Array:
    if name.startswith("right_"):
        return np.array(_LEFT_BONES["left_" + name.removeprefix("right_")]) * [-1.0, 1.0, 1.0]
    return np.array(_LEFT_BONES[name])


def _place_spine(pose: RestPose, rig: RigPoints) -> Array:
    """Put pelvis, spine, neck and head; returns each torso's size (n,) relative to the typical one."""
    hips = (rig.at("upperleg01.L") + rig.at("upperleg01.R")) / 2
    column = np.sum([_bone(name) for name in ("spine1", "spine2", "spine3", "neck")], axis=0)
    torso = (rig.at("neck02") - hips)[:, 1] / (column - _bone("left_hip"))[1]
    pose.joints[:, 0] = (hips - torso[:, None] * _bone("left_hip")) * [0, 1, 1]
    for name in ("spine1", "spine2", "spine3", "neck", "head"):
        joint = joint_index(name)
        pose.joints[:, joint] = pose.joints[:, PARENTS[joint]] + torso[:, None] * _bone(name)
    # The typical neck would leave the nape of people who hold the head forward: go half way to where theirs is.
    neck = joint_index("neck")
    pose.joints[:, neck, 2] = (pose.joints[:, neck, 2] + rig.at("neck02")[:, 2]) / 2
    return torso


def _raise_arm(pose: RestPose, rig: RigPoints, side: tuple[str, str, float], torso: Array) -> None:
    name, letter, sign = side
    collar, shoulder, elbow, wrist, knuckle = (
        rig.at(f"{bone}.{letter}") for bone in ("clavicle", "upperarm01", "lowerarm01", "wrist", "finger3-1")
    )
    to_elbow, to_wrist, to_hand = (_bone(f"{name}_{joint}") for joint in ("elbow", "wrist", "hand"))
    girdle = np.broadcast_to(matrix_from_rotvec([0, 0, sign * _SHOULDER_LIFT]), (len(torso), 3, 3))
    upper = _turned_onto(girdle, elbow - shoulder, to_elbow)
    lower = _turned_onto(upper, wrist - elbow, to_wrist)
    hand = _turned_onto(lower, knuckle - wrist, to_hand)
    across = _apply(hand, rig.at(f"finger2-1.{letter}") - rig.at(f"finger5-1.{letter}"))
    twist = _angle_to_front(across, to_hand)
    new_shoulder = collar + _apply(girdle, shoulder - collar)
    new_elbow = new_shoulder + _apply(upper, elbow - shoulder)
    new_wrist = new_elbow + _apply(lower, wrist - elbow)
    # Turning the palm down is pronation: the forearm carries half of it.
    lower = matrix_from_rotvec(0.5 * twist[:, None] * _unit(to_wrist)) @ lower
    hand = matrix_from_rotvec(twist[:, None] * _unit(to_hand)) @ hand
    _carry(pose, f"{name}_collar", girdle, collar, collar)
    _carry(pose, f"{name}_shoulder", upper, shoulder, new_shoulder)
    _carry(pose, f"{name}_elbow", lower, elbow, new_elbow)
    _carry(pose, f"{name}_wrist", hand, wrist, new_wrist)
    _carry(pose, f"{name}_hand", hand, wrist, new_wrist)
    for joint, place in (("shoulder", new_shoulder), ("elbow", new_elbow), ("wrist", new_wrist)):
        pose.joints[:, joint_index(f"{name}_{joint}")] = place
    pose.joints[:, joint_index(f"{name}_hand")] = new_wrist + _apply(hand, knuckle - wrist)
    pose.joints[:, joint_index(f"{name}_collar")] = new_shoulder - torso[:, None] * _bone(f"{name}_shoulder")


def _straighten_leg(pose: RestPose, rig: RigPoints, side: tuple[str, str, float], torso: Array, stature: Array) -> None:
    name, letter, sign = side
    hip, knee, ankle = (rig.at(f"{bone}.{letter}") for bone in ("upperleg01", "lowerleg01", "foot"))
    toes = np.mean([rig.at(f"{toe}.{letter}") for toe in _TOES], axis=0)
    upright = np.broadcast_to(np.eye(3), (len(stature), 3, 3))
    thigh = _turned_onto(upright, knee - hip, _stance(hip, knee, sign * _KNEE_SPREAD * stature / _TYPICAL_STATURE))
    shin = _turned_onto(thigh, ankle - knee, _bone(f"{name}_ankle"))
    new_knee = hip + _apply(thigh, knee - hip)
    new_ankle = new_knee + _apply(shin, ankle - knee)
    # The foot turns about the vertical only, so that the sole stays flat.
    to_toes, forwards = toes - ankle, _bone(f"{name}_foot")
    yaw = np.arctan2(forwards[0], forwards[2]) - np.arctan2(to_toes[:, 0], to_toes[:, 2])
    foot = matrix_from_rotvec(yaw[:, None] * np.array([0, 1.0, 0]))
    _carry(pose, f"{name}_hip", thigh, hip, hip)
    _carry(pose, f"{name}_knee", shin, knee, new_knee)
    _carry(pose, f"{name}_ankle", foot, ankle, new_ankle)
    _carry(pose, f"{name}_foot", foot, ankle, new_ankle)
    pose.joints[:, joint_index(f"{name}_knee")] = new_knee
    pose.joints[:, joint_index(f"{name}_ankle")] = new_ankle
    reach = np.linalg.norm(to_toes, axis=1, keepdims=True)
    pose.joints[:, joint_index(f"{name}_foot")] = new_ankle + reach * _unit(forwards)
    # The hip joint lies on the typical thigh's line through the knee, at the typical height below the pelvis.
    direction = _unit(_bone(f"{name}_knee"))
    drop = (new_knee - pose.joints[:, 0] - torso[:, None] * _bone(f"{name}_hip"))[:, 1]
    pose.joints[:, joint_index(f"{name}_hip")] = new_knee - (drop / direction[1])[:, None] * direction


def _stance(hip: Array, knee: Array, spread: Array) -> Array:
    """Thighs (n, 3) of unchanged length that bring the knees to x = spread, nearly without a bend to front or back."""
    thigh = knee - hip
    x, z = spread - hip[:, 0], 0.3 * thigh[:, 2]
    y = -np.sqrt(np.maximum(np.sum(thigh**2, axis=1) - x**2 - z**2, 1e-6))
    return np.stack([x, y, z], axis=1)


def _angle_to_front(across: Array, axis: Array) -> Array:
    """(n,) the turn about `axis` that brings the knuckle line, little finger to index finger, to the front."""
    axis = _unit(axis)
    flat = _unit(across - (across @ axis)[:, None] * axis)
    front = _unit(np.array([0, 0, 1.0]) - axis[2] * axis)
    return np.arctan2(np.cross(flat, front) @ axis, flat @ front)


def _turned_onto(rotation: Array, bone: Array, direction: Array) -> Array:
    """`rotation` (n, 3, 3) followed by the smallest turn that brings `bone` (n, 3) onto `direction`."""
    return align_vectors(_apply(rotation, bone), np.broadcast_to(direction, bone.shape)) @ rotation


def _carry(pose: RestPose, joint: str, rotation: Array, source: Array, target: Array) -> None:
    index = JOINT_NAMES.index(joint)
    pose.rotations[:, index] = rotation
    pose.sources[:, index] = source
    pose.targets[:, index] = target


def _apply(rotation: Array, vectors: Array) -> Array:
    return (rotation @ vectors[..., None])[..., 0]


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
