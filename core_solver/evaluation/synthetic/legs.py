"""A leg of two bones that ends at a given ankle; the knee is a hinge about the body's left-right axis."""

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from core_solver.body.skeleton import joint_index
from core_solver.evaluation.synthetic.physique import SIDES, Physique

Array = NDArray[np.float64]

_STRAIGHTEST, _MOST_BENT = 0.06, 2.6  # radians of the knee


def longest_reach(person: Physique) -> Array:
    """(2,) metres from hip to ankle of the almost straight left and right leg."""
    straight = np.array([_STRAIGHTEST])
    return np.array([float(np.linalg.norm(_hip_to_ankle(person, side, straight))) for side in SIDES])


def highest_pelvis(place: Array, wanted: Array, ankle: Array, root: Array, person: Physique, rate: float) -> Array:
    """Smooth heights (T,) of the root joint, as wanted where both legs are long enough and lower elsewhere.

    Args:
        place: (T, 2) of the root joint over the ground.
        wanted: (T,) metres.
        ankle: (T, 2, 3) of both feet.
        root: (T, 3, 3) rotation of the pelvis.
        person: whose legs.
        rate: frames a second.
    """
    hips = np.stack([root @ person.bone(f"{side}_hip", "pelvis") for side in SIDES], axis=1)
    across = np.linalg.norm(place[:, None] + hips[..., :2] - ankle[..., :2], axis=2)
    reach = ankle[..., 2] - hips[..., 2] + np.sqrt(np.maximum(longest_reach(person) ** 2 - across**2, 0.01))
    # A minimum over a window, then a mean over the same window: smooth, and nowhere above the bound.
    radius = max(1, round(0.07 * rate))
    bound = minimum_filter1d(np.minimum(reach.min(axis=1), wanted), 2 * radius + 1, mode="nearest")
    return gaussian_filter1d(bound, radius / 2, mode="nearest", radius=radius)


def bend_legs(rotations: Array, pelvis: Array, ankle: Array, foot: Array, toe_bend: Array, person: Physique) -> None:
    """Set the rotations of hips, knees, ankles and toes so that the feet are where they should be.

    Args:
        rotations: (T, 24, 3, 3) relative to the parents, the root's to the world; changed in place.
        pelvis: (T, 3) of the root joint.
        ankle: (T, 2, 3) of the feet.
        foot: (T, 2, 3, 3) of the feet behind the ball, from the rest pose to the world.
        toe_bend: (T, 2) radians by which the toes are bent up.
        person: whose legs.
    """
    root = rotations[:, 0]
    for side, name in enumerate(SIDES):
        hip = pelvis + root @ person.bone(f"{name}_hip", "pelvis")
        thigh, knee = leg_rotations(person, name, ankle[:, side] - hip, root, foot[:, side])
        rotations[:, joint_index(f"{name}_hip")] = np.swapaxes(root, 1, 2) @ thigh
        rotations[:, joint_index(f"{name}_knee")] = knee
        rotations[:, joint_index(f"{name}_ankle")] = np.swapaxes(thigh @ knee, 1, 2) @ foot[:, side]
        rotations[:, joint_index(f"{name}_foot")] = _about_x(-toe_bend[:, side])


def leg_rotations(person: Physique, side: str, ankle: Array, root: Array, foot: Array) -> tuple[Array, Array]:
    """World rotation of the thigh and rotation of the knee relative to it.

    Args:
        person: whose leg.
        side: "left" or "right".
        ankle: (T, 3) from the hip joint, world axes; out of reach the leg only points there.
        root: (T, 3, 3) of the pelvis, from the rest pose.
        foot: (T, 3, 3) of the foot: knee and toes point the same way.

    Returns:
        (T, 3, 3) and (T, 3, 3).
    """
    bend = _knee_bend(person, side, np.linalg.norm(ankle, axis=1))
    knee = _about_x(bend)
    hinge = root[:, :, 0] + foot[:, :, 0]
    rest_hinge = np.broadcast_to([1.0, 0.0, 0.0], ankle.shape)
    thigh = _frame(ankle, hinge) @ np.swapaxes(_frame(_hip_to_ankle(person, side, bend), rest_hinge), 1, 2)
    return thigh, knee


def _knee_bend(person: Physique, side: str, distance: Array) -> Array:
    """Angle (T,) at which the ankle is as far from the hip as asked: |a + R b|^2 has the form p cos + q sin + r."""
    a, b = person.bone(f"{side}_knee", f"{side}_hip"), person.bone(f"{side}_ankle", f"{side}_knee")
    p = 2 * (a[1] * b[1] + a[2] * b[2])
    q = 2 * (a[2] * b[1] - a[1] * b[2])
    r = a @ a + b @ b + 2 * a[0] * b[0]
    cosine = np.clip((distance**2 - r) / np.hypot(p, q), -1, 1)
    return np.clip(np.arctan2(q, p) + np.arccos(cosine), _STRAIGHTEST, _MOST_BENT)


def _hip_to_ankle(person: Physique, side: str, bend: Array) -> Array:
    """(T, 3) in the thigh's rest axes."""
    thigh, shank = person.bone(f"{side}_knee", f"{side}_hip"), person.bone(f"{side}_ankle", f"{side}_knee")
    return thigh + _about_x(bend) @ shank


def _about_x(angle: Array) -> Array:
    cosine, sine, zero, one = np.cos(angle), np.sin(angle), np.zeros_like(angle), np.ones_like(angle)
    rows = [one, zero, zero, zero, cosine, -sine, zero, sine, cosine]
    return np.stack(rows, axis=-1).reshape(*angle.shape, 3, 3)


def _frame(direction: Array, hinge: Array) -> Array:
    """(T, 3, 3) right-handed axes: along `direction`, and as near to `hinge` as possible."""
    first = direction / np.linalg.norm(direction, axis=1, keepdims=True)
    second = hinge - np.sum(hinge * first, axis=1, keepdims=True) * first
    second /= np.linalg.norm(second, axis=1, keepdims=True)
    return np.stack([first, second, np.cross(first, second)], axis=2)
