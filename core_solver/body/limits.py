"""Soft limits of joint rotations, radians, for axis-angle theta in SMPL's rest axes (y up, z front, x left).

Ranges of motion of healthy adults, rounded outwards: they rule out backward knees and elbows, not dancers.
"""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import JOINT_NAMES, joint_index

# Lower and upper limits about x, y, z for the left side and the middle.
_SPINE = ((-0.4, -0.5, -0.4), (0.8, 0.5, 0.4))
_LIMITS: dict[str, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "left_hip": ((-2.4, -1.2, -0.8), (0.9, 1.2, 1.4)),
    "left_knee": ((-0.1, -0.4, -0.25), (2.7, 0.4, 0.25)),
    "left_ankle": ((-0.8, -0.6, -0.6), (1.0, 0.6, 0.6)),
    "left_foot": ((-0.6, -0.15, -0.15), (0.6, 0.15, 0.15)),
    "spine1": _SPINE,
    "spine2": _SPINE,
    "spine3": _SPINE,
    "neck": ((-0.7, -0.8, -0.6), (0.7, 0.8, 0.6)),
    "head": ((-0.7, -0.8, -0.6), (0.7, 0.8, 0.6)),
    "left_collar": ((-0.4, -0.6, -0.3), (0.4, 0.5, 0.7)),
    "left_shoulder": ((-1.8, -2.4, -2.2), (1.8, 1.4, 1.8)),
    # The forearm folds forwards: about -y on the left.
    "left_elbow": ((-1.6, -2.7, -0.4), (1.6, 0.1, 0.4)),
    "left_wrist": ((-0.4, -0.6, -1.4), (0.4, 0.6, 1.4)),
    "left_hand": ((-0.1, -0.1, -0.1), (0.1, 0.1, 0.1)),
}


def joint_limits() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lower and upper limits, (24, 3) each; the pelvis is free.

    The right side mirrors the left in the plane x = 0, under which rotations about y and z change sign.
    """
    lower, upper = np.full((24, 3), -np.inf), np.full((24, 3), np.inf)
    for name, (low, high) in _LIMITS.items():
        lower[joint_index(name)], upper[joint_index(name)] = low, high
        right = name.replace("left_", "right_")
        if right != name and right in JOINT_NAMES:
            j = joint_index(right)
            lower[j] = (low[0], -high[1], -high[2])
            upper[j] = (high[0], -low[1], -low[2])
    return lower, upper
