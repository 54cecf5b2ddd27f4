# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet that stand where the person's stood, on rigs whose legs are longer or shorter.

Where a person's foot stands, the middle of the rig's sole comes to the middle of the person's, as high above the ground
as theirs. While a foot swings the rig's own pose counts, save that it does not sink into the ground further than the
person did. Hips that are too high for a leg to reach are lowered, smoothly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .ground import Ground
from .landmarks import Sole, soles
from .limb_ik import Chain, bent, chain_of, reach, soft_length
from .rest import BACK
from .roles import SIDES
from .skeleton import Motion
from .turning import turns_of

Array = NDArray[np.float64]

STANDS = 0.5
"""From this probability on a foot stands."""
_BLEND = 0.25  # seconds in which a foot comes from its own way to where it will stand, and leaves it again
_SETTLE = 0.2  # seconds before and after a need in which hips are lowered for it
_STEPS = 0.3  # seconds over which a body follows a floor that rises or falls by steps
# Hips are not lowered below this height over a standing ankle, in lengths of the leg.
_LOWEST = 0.3


@dataclass(frozen=True)
class Stage:
    """Where a scene's rigs stand.

    Attributes:
        ground: under the people, in their own scale.
        scale: rigs stand at `scale` times the people's places.
    """

    ground: Ground
    scale: float = 1.0

    def above(self, points: Array, floor: Array) -> Array:
        """(...) metres from the ground up to (..., 3) points of the rigs; of several grounds the one near `floor`."""
        ground = self.ground.height(points[..., :2] / self.scale, floor / self.scale)
        return points[..., 2] - self.scale * ground


@dataclass(frozen=True)
class _Foot:
    """One foot of the rig, and what the person's does.

    Attributes:
        chain: the rig's leg.
        sole: the rig's.
        knee: (T, 3) the direction its knee points to.
        stands: (T,) 1 while the foot stands, falling to 0 before and after.
        place: (T, 2) middle of the person's sole over the ground, in the rigs' scale, metres.
        height: (T,) of the person's sole above the ground at its lowest point, metres.
    """

    chain: Chain
    sole: Sole
    knee: Array
    stands: Array
    place: Array
    height: Array


def floor_under(actor: Actor, stage: Stage) -> Array:
    """(T,) about how high what a person stands on is, or last stood on and will stand on, in the rigs' scale, metres.

    Without any contact it is where the soles are lowest.
    """
    lowest = stage.scale * np.stack(
        [
            np.minimum(sole.heel.positions(actor.motion)[:, 2], sole.ball.positions(actor.motion)[:, 2])
            for sole in soles(actor.source, actor.source_map)
        ],
        axis=1,
    )
    stands = actor.contacts >= STANDS
    frames = np.flatnonzero(stands.any(axis=1))
    if not len(frames):
        return np.full(len(lowest), np.percentile(lowest.min(axis=1), 5))
    standing = np.where(stands, lowest, np.inf).min(axis=1)[frames]
    return np.interp(actor.motion.times, actor.motion.times[frames], standing)


def standing_soles(actor: Actor) -> Array:
    """(N, 3) where the person's soles are while they stand, all frames one after the other, world."""
    places = []
    for sole, contact in zip(soles(actor.source, actor.source_map), actor.contacts.T, strict=True):
        ends = _ends(sole, actor.motion)[:, contact >= STANDS]
        places.append(np.where(ends[:1, :, 2:] < ends[1:, :, 2:], ends[0], ends[1])[0])
    return np.concatenate(places)


def level_under(actor: Actor, stage: Stage) -> Array:
    """(T,) `floor_under` without its steps: what hips and root rise and fall with."""
    return smoothed(floor_under(actor, stage), actor.motion.times, _STEPS)


def planted(actor: Actor, motion: Motion, stage: Stage) -> Motion:
    """A rig's motion with its standing feet in place.

    Args:
        actor: the person and the rig.
        motion: of the rig, its hips over those of the person.
        stage: where it stands.
    """
    floor = floor_under(actor, stage)
    feet = _feet(actor, motion, stage, floor)
    lowering = np.max([_lowering(motion, foot, stage, floor) for foot in feet], axis=0)
    result = _lowered(actor, motion, widened(lowering, motion.times, _SETTLE))
    for foot in feet:
        limb = foot.chain.limb(result)
        result = bent(result, foot.chain, reach(limb, _ankle_goal(result, foot, stage, floor), foot.knee))
    return result


def smoothed(values: Array, times: Array, seconds: float) -> Array:
    """(T,) without lag: means over `seconds` before and after, with a Hann window."""
    around = _frames(times, seconds)
    window = np.hanning(2 * around + 3)[1:-1]
    padded = np.pad(values, around, mode="edge")
    return np.convolve(padded, window / window.sum(), mode="valid")


def widened(values: Array, times: Array, seconds: float) -> Array:
    """(T,) smooth, without lag, and nowhere less than `values`."""
    around = _frames(times, seconds)
    padded = np.pad(values, around, mode="edge")
    largest = np.lib.stride_tricks.sliding_window_view(padded, 2 * around + 1).max(axis=-1)
    return smoothed(largest, times, seconds)


def _feet(actor: Actor, motion: Motion, stage: Stage, floor: Array) -> list[_Foot]:
    turns = turns_of(actor.target, actor.target_map, motion)
    rig, person = soles(actor.target, actor.target_map), soles(actor.source, actor.source_map)
    feet = []
    for number, side in enumerate(SIDES):
        chain = chain_of(actor.target, actor.target_map, side, ("thigh", "shin", "foot"))
        if chain is None:
            raise ValueError(f"a humanoid needs all bones of the {side} leg")
        ends = stage.scale * _ends(person[number], actor.motion)
        feet.append(
            _Foot(
                chain=chain,
                sole=rig[number],
                knee=-turns[:, chain.upper, :, BACK],
                stands=_nearness(actor.contacts[:, number] >= STANDS, motion.times),
                place=ends[..., :2].mean(axis=0),
                height=stage.above(ends, floor).min(axis=0),
            )
        )
    return feet


def _nearness(stands: NDArray[np.bool_], times: Array) -> Array:
    """(T,) 1 while a foot stands, falling smoothly to 0 before and after."""
    if not stands.any():
        return np.zeros(len(times))
    standing = times[stands]
    after = np.searchsorted(standing, times)
    to_next = standing[np.minimum(after, len(standing) - 1)] - times
    since_last = times - standing[np.maximum(after - 1, 0)]
    away = np.minimum(np.abs(to_next), np.abs(since_last))
    left = np.clip(1 - away / _BLEND, 0.0, 1.0)
    return left * left * (3 - 2 * left)


def _ankle_goal(motion: Motion, foot: _Foot, stage: Stage, floor: Array) -> Array:
    """(T, 3) where the rig's ankle shall be."""
    ends = _ends(foot.sole, motion)
    step = np.zeros((len(floor), 3))
    step[:, :2] = foot.stands[:, None] * (foot.place - ends[..., :2].mean(axis=0))
    height = stage.above(ends + step, floor).min(axis=0)
    wanted = foot.stands * foot.height + (1 - foot.stands) * height
    step[:, 2] = np.maximum(wanted, np.minimum(foot.height, 0.0)) - height
    return motion.heads[:, foot.chain.end] + step


def _lowering(motion: Motion, foot: _Foot, stage: Stage, floor: Array) -> Array:
    """(T,) metres by which hips must sink for a leg to reach its goal."""
    limb = foot.chain.limb(motion)
    way = limb.start - _ankle_goal(motion, foot, stage, floor)
    longest = soft_length(limb)[:, 0]
    over_ground = np.sum(way[:, :2] ** 2, axis=1)
    highest = np.sqrt(np.maximum(longest**2 - over_ground, (_LOWEST * longest) ** 2))
    return np.maximum(way[:, 2] - highest, 0.0)


def _lowered(actor: Actor, motion: Motion, lowering: Array) -> Motion:
    hips = actor.target.index(actor.target_map.needed("hips"))
    heads = motion.heads.copy()
    heads[:, actor.target.below(hips), 2] -= lowering[:, None]
    return Motion(motion.times, motion.rotations, heads)


def _ends(sole: Sole, motion: Motion) -> Array:
    """(2, T, 3) heel and ball."""
    return np.stack([sole.heel.positions(motion), sole.ball.positions(motion)])


def _frames(times: Array, seconds: float) -> int:
    """How many frames last about so long."""
    if len(times) < 2:
        return 0
    return max(round(seconds / float(np.median(np.diff(times)))), 0)
