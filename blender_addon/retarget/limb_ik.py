# SPDX-License-Identifier: GPL-3.0-or-later
"""Arms and legs that reach a goal: two bones, solved in closed form for all frames at once."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import align_vectors

from .bone_map import BoneMap
from .skeleton import Motion, Skeleton

Array = NDArray[np.float64]

# Above this part of its full length a limb stretches ever less towards a goal further away: at the very end the knee
# would snap straight within a frame.
_SOFT = 0.98
_STRETCHED = 0.9995
# A limb that is straighter than this (knee's distance from the line of the limb, in lengths of the limb) bends to where
# the hint points: its own knee says nothing about the direction. It need not bend where the goal is as near as this.
_STRAIGHT = 0.003


@dataclass(frozen=True)
class Limb:
    """Joints of one arm or leg, world, metres.

    Attributes:
        start: (T, 3) hip or shoulder.
        middle: (T, 3) knee or elbow.
        end: (T, 3) ankle or wrist.
    """

    start: Array
    middle: Array
    end: Array


@dataclass(frozen=True)
class Reach:
    """How a limb's bones turn to bring its end to a goal.

    Attributes:
        upper: (T, 3, 3) rotation in the world of the upper bone about its start.
        lower: (T, 3, 3) rotation in the world of the lower bone about its own, moved start.
        middle: (T, 3) where the knee or elbow comes to be.
        end: (T, 3) where the end comes to be: the goal, or short of it where the limb is too short.
    """

    upper: Array
    lower: Array
    middle: Array
    end: Array


@dataclass(frozen=True)
class Chain:
    """The bones of one arm or leg, and all that hang on them.

    Attributes:
        upper: index of the upper arm or thigh.
        lower: of the forearm or shin.
        end: of the hand or foot.
        with_upper: (B,) whether a bone moves with the upper one and not with the lower.
        with_lower: (B,) whether it moves with the lower one and not with the end.
        with_end: (B,) whether it moves with the end.
    """

    upper: int
    lower: int
    end: int
    with_upper: NDArray[np.bool_]
    with_lower: NDArray[np.bool_]
    with_end: NDArray[np.bool_]

    def limb(self, motion: Motion) -> Limb:
        """Where the joints are in a motion."""
        return Limb(motion.heads[:, self.upper], motion.heads[:, self.lower], motion.heads[:, self.end])


def chain_of(skeleton: Skeleton, bone_map: BoneMap, side: str, roles: tuple[str, str, str]) -> Chain | None:
    """An arm or a leg of a skeleton; None where a bone is missing.

    Args:
        skeleton: its bones.
        bone_map: their roles.
        side: "left" or "right".
        roles: such as ("thigh", "shin", "foot").
    """
    names = [bone_map.bone(f"{side}_{role}") for role in roles]
    if None in names:
        return None
    upper, lower, end = (skeleton.names.index(name) for name in names if name)
    whole, below, last = (skeleton.below(bone) for bone in (upper, lower, end))
    return Chain(upper, lower, end, whole & ~below, below & ~last, last)


def bent(motion: Motion, chain: Chain, turn: Reach) -> Motion:
    """A motion with one limb bent; its end keeps its rotation in the world and goes where the limb takes it."""
    limb = chain.limb(motion)
    rotations, heads = motion.rotations.copy(), motion.heads.copy()
    for bones, rotation, pivot, place in (
        (chain.with_upper, turn.upper, limb.start, limb.start),
        (chain.with_lower, turn.lower, limb.middle, turn.middle),
    ):
        rotations[:, bones] = rotation[:, None] @ motion.rotations[:, bones]
        carried = np.einsum("tij,tbj->tbi", rotation, motion.heads[:, bones] - pivot[:, None])
        heads[:, bones] = place[:, None] + carried
    heads[:, chain.with_end] += (turn.end - limb.end)[:, None]
    return Motion(motion.times, rotations, heads)


def reach(limb: Limb, goal: Array, hint: Array) -> Reach:
    """Bend limbs so that their ends come to a goal, in the plane they are bent in.

    A goal where the end already is turns nothing. Both bones turn about no more than needed, so that skin does not
    twist along them.

    Args:
        limb: as it is.
        goal: (T, 3) where its end shall be.
        hint: (T, 3) the direction knee or elbow point to, used where the limb is too straight to tell.
    """
    first, second = limb.middle - limb.start, limb.end - limb.middle
    a, b = _length(first), _length(second)
    distance = np.clip(reachable(limb, _length(goal - limb.start)), np.abs(a - b) + 1e-9, a + b)
    line = _unit(goal - limb.start, limb.end - limb.start)
    # Where the knee points to, carried along as the whole limb swings from its end to the goal.
    swing = align_vectors(_unit(limb.end - limb.start, first), line)
    pole = _across(_turned(swing, _pole(limb, hint, _length(goal - limb.end))), line)
    along = (a * a - b * b + distance * distance) / (2 * distance)
    aside = np.sqrt(np.maximum(a * a - along * along, 0.0))
    middle = limb.start + along * line + aside * pole
    end = limb.start + distance * line
    return Reach(align_vectors(first, middle - limb.start), align_vectors(second, end - middle), middle, end)


def reachable(limb: Limb, distance: Array) -> Array:
    """How far limbs go for goals at (T, 1) distances from their start: all the way, but softly near full stretch.

    Softness begins only beyond where a limb already is, so that a goal where the end is stays reached.
    """
    full = _length(limb.middle - limb.start) + _length(limb.end - limb.middle)
    soft = soft_length(limb)
    rest = np.maximum(full * _STRETCHED - soft, 1e-9)
    return np.where(distance > soft, soft + rest * -np.expm1(-(np.maximum(distance - soft, 0.0)) / rest), distance)


def pole_directions(limb: Limb, hint: Array) -> Array:
    """(T, 3) unit vectors across limbs to where knee or elbow point; the (T, 3) hint for those too straight to tell."""
    return _pole(limb, hint, np.full((len(limb.start), 1), np.inf))


def soft_length(limb: Limb) -> Array:
    """(T, 1) metres: goals up to here are reached exactly."""
    full = _length(limb.middle - limb.start) + _length(limb.end - limb.middle)
    return np.maximum(_length(limb.end - limb.start), _SOFT * full)


def _pole(limb: Limb, hint: Array, way: Array) -> Array:
    """(T, 3) unit vectors across the limb to its knee or elbow; for a straight limb more and more the hint.

    Args:
        limb: as it is.
        hint: (T, 3).
        way: (T, 1) metres from the limb's end to the goal.
    """
    line = _unit(limb.end - limb.start, limb.middle - limb.start)
    knee = limb.middle - limb.start
    aside = knee - np.sum(knee * line, axis=-1, keepdims=True) * line
    full = _length(knee) + _length(limb.end - limb.middle)
    straight = _STRAIGHT * full
    unsure = np.exp(-((_length(aside) / straight) ** 2)) * np.minimum(way / straight, 1.0)
    return _across(aside + unsure * straight * _across(hint, line), line)


def _across(vectors: Array, line: Array) -> Array:
    """(T, 3) unit vectors: the part of `vectors` at right angles to `line`; any such where nothing is left."""
    rest = vectors - np.sum(vectors * line, axis=-1, keepdims=True) * line
    other = np.cross(line, np.eye(3)[np.argmin(np.abs(line), axis=-1)])
    return _unit(rest, other)


def _unit(vectors: Array, otherwise: Array) -> Array:
    """(T, 3) directions; those of `otherwise` where a vector has no length."""
    chosen = np.where(_length(vectors) > 1e-9, vectors, otherwise)
    return chosen / np.maximum(_length(chosen), 1e-12)


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.einsum("tab,tb->ta", rotations, vectors)


def _length(vectors: Array) -> Array:
    return np.linalg.norm(vectors, axis=-1, keepdims=True)
