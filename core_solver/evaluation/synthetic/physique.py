"""Bodies of people who differ from the average adult: betas for a wanted stature, and what motion needs of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import joint_index
from core_solver.optimise.posing import sole_rows

Array = NDArray[np.float64]

SIDES = ("left", "right")
_SHAPE_SPREAD = 0.6  # of betas about the neutral ones, in the standard deviations they are given in
_FARTHEST = 4.0  # standard deviations to which a stature may move the betas; the rest is done by scale


@dataclass(frozen=True)
class Physique:
    """One person's body, metres, scale included.

    Attributes:
        betas: (10,).
        scale: of the whole body.
        height: stature.
        joints: (24, 3) of the rest pose.
        keypoints: (25, 3) of the rest pose.
        ankle_height: (2,) of the left and right ankle above the lowest point of its sole, in the rest pose.
        heel: (2,) how far the sole reaches behind the ankle.
        toe: (2,) how far it reaches to the front.
    """

    betas: Array
    scale: float
    height: float
    joints: Array
    keypoints: Array
    ankle_height: Array
    heel: Array
    toe: Array

    def bone(self, name: str, parent: str) -> Array:
        """(3,) from a joint to another in the rest pose."""
        return self.joints[joint_index(name)] - self.joints[joint_index(parent)]

    @property
    def leg(self) -> float:
        """Length of a leg from hip to ankle."""
        return float(np.linalg.norm(self.bone("left_ankle", "left_hip")))


def draw_physique(rng: np.random.Generator, body: BodyModel, height: float) -> Physique:
    """Somebody of a given stature and otherwise random shape."""
    return physique(body, height, rng.normal(scale=_SHAPE_SPREAD, size=10))


def physique(body: BodyModel, height: float, shape: Array) -> Physique:
    """The body of a given stature.

    Args:
        body: body model.
        height: stature, metres.
        shape: (10,) deviation from the average adult; what of it would change the stature is replaced.
    """
    betas = _betas_of_height(body, height, body.neutral_betas + shape)
    scale = height / body.height(betas)
    soles = scale * body.rest_vertices(betas)[body.proxy][sole_rows(body)]
    joints = scale * body.rest_joints(betas)
    ankles = joints[[joint_index(f"{side}_ankle") for side in SIDES]]
    return Physique(
        betas=betas,
        scale=scale,
        height=height,
        joints=joints,
        keypoints=scale * body.rest_keypoints(betas),
        ankle_height=ankles[:, 1] - soles[..., 1].min(axis=1),
        heel=ankles[:, 2] - soles[..., 2].min(axis=1),
        toe=soles[..., 2].max(axis=1) - ankles[:, 2],
    )


def _betas_of_height(body: BodyModel, height: float, betas: Array) -> Array:
    """Go from `betas` along the direction that changes stature most until the stature is right.

    For a body over all ages this direction is growing up, so short people become children and not small adults.
    """
    growth = np.array([body.height(betas + step) - body.height(betas - step) for step in 0.5 * np.eye(10)])
    rate = float(growth @ growth)
    if rate < 1e-8:
        return betas
    for _ in range(6):  # stature is piecewise linear in betas: Newton's steps end in the right piece
        betas = betas + (height - body.height(betas)) * growth / rate
    excess = np.linalg.norm(betas - body.neutral_betas)
    if excess > _FARTHEST:
        betas = body.neutral_betas + (betas - body.neutral_betas) * _FARTHEST / excess
    return betas
