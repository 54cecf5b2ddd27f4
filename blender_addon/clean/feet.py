# SPDX-License-Identifier: GPL-3.0-or-later
"""Moving feet: legs bend so that soles come where they shall, and the whole body follows slowly."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..retarget.bone_map import BoneMap
from ..retarget.landmarks import Sole, soles
from ..retarget.limb_ik import Chain, bent, chain_of, reach, soft_length
from ..retarget.rest import BACK, body_frame
from ..retarget.roles import SIDES
from ..retarget.skeleton import Motion, Skeleton
from .signals import known_low_pass, raised

Array = NDArray[np.float64]

_LEG = ("thigh", "shin", "foot")
_FOLLOWING = 0.5  # Hz: so slowly the body goes along with its feet
_SAMPLES = 5  # places along a sole
_STOOPING = 0.15  # seconds in which the hips go down for a foot that is out of reach, and up again


@dataclass(frozen=True)
class Leg:
    """A leg and what it stands on.

    Attributes:
        chain: its bones.
        sole: of its foot.
        knee: (3,) direction to the front at rest, in the thigh's axes.
        length: from hip to ankle, metres.
    """

    chain: Chain
    sole: Sole
    knee: Array
    length: float


@dataclass(frozen=True)
class Stance:
    """Where feet shall go.

    Attributes:
        offsets: (T, 2, 3) from where the left and the right foot are, metres, world.
        weights: (T, 2) from 0, where a foot follows its body, to 1, where it goes exactly there.
    """

    offsets: Array
    weights: Array


def legs_of(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Leg, Leg]:
    """The left and the right leg.

    Raises:
        UserError: the map lacks a bone of a leg, the hips or the head.
    """
    chains = [chain_of(skeleton, bone_map, side, _LEG) for side in SIDES]
    if None in chains or not bone_map.bone("hips") or not bone_map.bone("head"):
        raise UserError("the armature's legs are not known: choose their bones under Bone Map, or another armature")
    front = -body_frame(skeleton, bone_map)[:, BACK]
    left, right = (
        Leg(chain, sole, skeleton.axes[chain.upper].T @ front, _length(skeleton, chain))
        for chain, sole in zip(chains, soles(skeleton, bone_map), strict=True)
        if chain is not None
    )
    return left, right


def _length(skeleton: Skeleton, chain: Chain) -> float:
    hip, knee, ankle = skeleton.heads[[chain.upper, chain.lower, chain.end]]
    return float(np.linalg.norm(knee - hip) + np.linalg.norm(ankle - knee))


def slip(leg: Leg, motion: Motion) -> Array:
    """(T, 3) how far a sole slid since the frame before, metres; zero in the first frame.

    A foot that comes down or leaves rolls over its heel or its ball, which is to stay: the lower one of the two.
    """
    heel, ball = (point.positions(motion) for point in (leg.sole.heel, leg.sole.ball))
    lower = (heel + np.roll(heel, 1, axis=0))[:, 2:] < (ball + np.roll(ball, 1, axis=0))[:, 2:]
    return np.where(lower, np.diff(heel, axis=0, prepend=heel[:1]), np.diff(ball, axis=0, prepend=ball[:1]))


def sole_points(leg: Leg, motion: Motion) -> Array:
    """(T, S, 3) places along a sole from heel to ball, world."""
    heel, ball = (point.positions(motion)[:, None] for point in (leg.sole.heel, leg.sole.ball))
    return heel + np.linspace(0.0, 1.0, _SAMPLES)[:, None] * (ball - heel)


def ankles(motion: Motion, legs: tuple[Leg, Leg]) -> Array:
    """(T, 2, 3) places of the ankles, world."""
    return np.stack([motion.heads[:, leg.chain.end] for leg in legs], axis=1)


def placed(motion: Motion, legs: tuple[Leg, Leg], stance: Stance, rate: float) -> Motion:
    """Bring feet to their places.

    The body takes over the slow part of the way, so that legs bend for the rest only; where a leg is too short the
    hips go down. A foot keeps its rotation in the world.

    Args:
        motion: of the whole body.
        legs: left and right.
        stance: where the feet shall go.
        rate: frames per second.
    """
    shift = _followed(stance, rate)
    along = shift[:, None] + stance.weights[..., None] * (stance.offsets - shift[:, None])
    goals = ankles(motion, legs) + along
    moved = shifted(motion, shift)
    return reached(shifted(moved, _stoop(moved, legs, goals, stance.weights, rate)), legs, goals)


def reached(motion: Motion, legs: tuple[Leg, Leg], goals: Array) -> Motion:
    """Bend the legs until the ankles are at (T, 2, 3) places, or as near as the legs reach."""
    for side, leg in enumerate(legs):
        hint = motion.rotations[:, leg.chain.upper] @ leg.knee
        motion = bent(motion, leg.chain, reach(leg.chain.limb(motion), goals[:, side], hint))
    return motion


def shifted(motion: Motion, way: Array) -> Motion:
    """A motion carried through the world by (T, 3) metres."""
    return Motion(motion.times, motion.rotations, motion.heads + way[:, None])


def _followed(stance: Stance, rate: float) -> Array:
    """(T, 3) the slow part of the feet's ways."""
    known = stance.weights.sum(axis=1)
    mean = np.einsum("tf,tfa->ta", stance.weights, stance.offsets) / np.maximum(known, 1e-9)[:, None]
    return known_low_pass(mean, known > 0, rate, _FOLLOWING)


def _stoop(motion: Motion, legs: tuple[Leg, Leg], goals: Array, weights: Array, rate: float) -> Array:
    """(T, 3) downwards, as far as the feet that shall be exactly somewhere need it."""
    needed = np.zeros(len(motion.times))
    for side, leg in enumerate(legs):
        limb = leg.chain.limb(motion)
        way = limb.start - goals[:, side]
        # Below the hip the goal may be as deep as the leg is long, less what it needs sideways.
        sideways = np.sum(way[:, :2] ** 2, axis=1)
        depth = np.sqrt(np.maximum(soft_length(limb)[:, 0] ** 2 - sideways, 0.0))
        needed = np.maximum(needed, np.where(weights[:, side] > 0, way[:, 2] - depth, 0.0))
    down = raised(needed, max(int(np.ceil(_STOOPING * rate)), 1))
    return -down[:, None] * np.array([0.0, 0.0, 1.0])
