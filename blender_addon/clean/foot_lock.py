# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet that stand are still: no slipping while a foot carries weight, though it may roll from heel to ball."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from ..retarget.measures import CONTACT
from ..retarget.skeleton import Motion
from .feet import Leg, Stance, legs_of, placed, slip
from .performance import Performance
from .signals import closed, ramp, spans

Array = NDArray[np.float64]

BLEND = 0.1
"""Seconds in which a foot goes over to where it will stand, and away from there."""
_GAP = 0.07  # seconds: a contact that is lost for less was never lost
# Of a leg's length: a foot that goes further while it is said to stand is on something that moves, or walks.
_FARTHEST = 0.7


@dataclass(frozen=True)
class Locked:
    """A motion with locked feet.

    Attributes:
        motion: of the whole body.
        left_alone: number of contacts in which the foot goes so far that it cannot stand: on a treadmill, or wrong.
    """

    motion: Motion
    left_alone: int


def lock_feet(performance: Performance, blend: float = BLEND) -> Locked:
    """Hold every standing foot where it stands on average.

    Args:
        performance: with contacts.
        blend: seconds.

    Raises:
        UserError: the legs' bones are not known.
    """
    legs = legs_of(performance.skeleton, performance.bone_map)
    stance, left_alone = standing(performance, performance.motion, legs, blend)
    return Locked(placed(performance.motion, legs, stance, performance.rate), left_alone)


def contact_spans(contacts: Array, rate: float) -> list[tuple[int, int]]:
    """When one foot stands: (first, one after last) frames.

    Args:
        contacts: (T,) probability.
        rate: frames per second.
    """
    return spans(closed(contacts >= CONTACT, _GAP * rate))


def standing(
    performance: Performance, motion: Motion, legs: tuple[Leg, Leg], blend: float = BLEND
) -> tuple[Stance, int]:
    """Where feet shall go to stand still.

    Args:
        performance: says when feet stand, and where.
        motion: of the same person, changed or not, whose feet shall stand still there.
        legs: left and right.
        blend: seconds.

    Returns:
        The ways, and the number of contacts that were left alone.
    """
    offsets, weights, left_alone = zip(
        *(
            _stance(performance, motion, leg, contacts, blend)
            for leg, contacts in zip(legs, performance.evidence.contacts.T, strict=True)
        ),
        strict=True,
    )
    return Stance(np.stack(offsets, axis=1), np.stack(weights, axis=1)), sum(left_alone)


def _stance(
    performance: Performance, motion: Motion, leg: Leg, contacts: Array, blend: float
) -> tuple[Array, Array, int]:
    """(T, 3) ways, (T,) weights, and the number of contacts left alone, of one foot."""
    slid = slip(leg, motion)
    way = leg.sole.heel.positions(performance.motion) - leg.sole.heel.positions(motion)
    held: list[tuple[int, int]] = []
    offsets = np.zeros((len(contacts), 3))
    all_spans = contact_spans(contacts, performance.rate)
    for start, end in all_spans:
        back = slid[start] - np.cumsum(slid[start:end], axis=0)
        if np.ptp(back, axis=0).max() > _FARTHEST * leg.length:
            continue
        held.append((start, end))
        offsets[start:end] = back + np.median(way[start:end] - back, axis=0)
    return (*carried(offsets, held, blend * performance.rate), len(all_spans) - len(held))


def carried(offsets: Array, held: list[tuple[int, int]], blend: float) -> tuple[Array, Array]:
    """Ways and weights for all frames from those of the spans in which a foot is held.

    Args:
        offsets: (T, 3) known inside the spans.
        held: spans of frames.
        blend: frames in which a weight rises before a span and falls after it.

    Returns:
        (T, 3) ways, smoothly going from one span's to the next one's, and (T,) weights, 1 inside spans.
    """
    offsets, count = offsets.copy(), len(offsets)
    if not held:
        return np.zeros_like(offsets), np.zeros(count)
    offsets[: held[0][0]] = offsets[held[0][0]]
    offsets[held[-1][1] :] = offsets[held[-1][1] - 1]
    for (_, end), (start, _) in pairwise(held):
        share = ramp(np.arange(1, start - end + 1) / (start - end + 1))[:, None]
        offsets[end:start] = offsets[end - 1] + share * (offsets[start] - offsets[end - 1])
    return offsets, _weights(held, count, blend)


def _weights(held: list[tuple[int, int]], count: int, blend: float) -> Array:
    free = np.ones(count)
    frames = np.arange(count)
    for start, end in held:
        outside = np.maximum(np.maximum(start - frames, frames - (end - 1)), 0)
        free *= 1.0 - ramp(1.0 - outside / (blend + 1.0))
    return 1.0 - free
