# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's path without its slow error: who stands does not creep, sink or rise; steps stay as they are."""

import numpy as np
from numpy.typing import NDArray

from ..retarget.ground import Ground
from ..retarget.measures import CONTACT
from ..retarget.skeleton import Motion
from .feet import Leg, legs_of, shifted, slip, sole_points
from .foot_lock import carried, contact_spans
from .performance import Performance
from .signals import closed, known_low_pass, low_pass, spans

Array = NDArray[np.float64]

SLOW = 0.25
"""Hz: what changes faster is motion, not drift."""
_WALKING = 0.25  # metres per second: a body that goes faster is on its way, and its path is left alone
_BRIEF = 0.7  # seconds: who stands for less only passes
_FASTEST = 0.3  # metres per second: a foot that goes faster does not stand
_EDGE = 0.07  # seconds at both ends of a contact in which the foot still lands or already leaves


def remove_drift(performance: Performance, ground: Ground | None = None) -> Motion:
    """Take the slow creeping of standing people out of their paths.

    While somebody stands, the whole body is put where it stood on average; on the way between two such places the path
    goes over from the one correction to the next. So nothing adds up, and steps keep their lengths.

    Args:
        performance: with contacts.
        ground: of its scene, which standing feet shall be level with; without it heights are treated like places.

    Raises:
        UserError: the legs' bones are not known.
    """
    legs = legs_of(performance.skeleton, performance.bone_map)
    motion, rate = performance.motion, performance.rate
    creep, known = _mean_of_feet(
        [
            _creep(motion, leg, contacts, rate)
            for leg, contacts in zip(legs, performance.evidence.contacts.T, strict=True)
        ]
    )
    crept = np.cumsum(known_low_pass(creep, known > 0, rate, SLOW), axis=0) / rate
    way = np.zeros_like(crept)
    stays = _stays(performance, known)
    for start, end in stays:
        way[start:end] = crept[start:end].mean(axis=0) - crept[start:end]
    way, _ = carried(way, stays, 0.0)
    if ground is not None:
        way[:, 2] = _levelled(performance, legs, ground)
    return shifted(motion, way)


def _stays(performance: Performance, known: Array) -> list[tuple[int, int]]:
    """Spans of frames in which a person stands in one place."""
    rate = performance.rate
    hips = performance.motion.heads[:, performance.skeleton.index(performance.bone_map.bone("hips") or "")]
    slow = low_pass(hips, rate, SLOW)
    speed = np.linalg.norm(np.gradient(slow[:, :2], axis=0), axis=1) * rate if len(slow) > 1 else np.zeros(len(slow))
    standing = closed((known > 0) & (speed < _WALKING), _BRIEF * rate)
    return [(start, end) for start, end in spans(standing) if end - start >= _BRIEF * rate]


def _creep(motion: Motion, leg: Leg, contacts: Array, rate: float) -> tuple[Array, Array]:
    """(T, 3) metres per second with which one standing foot creeps, and (T,) 1 where that is known."""
    speed = slip(leg, motion) * rate
    creep, known = np.zeros_like(speed), np.zeros(len(speed))
    margin = int(np.ceil(_EDGE * rate))
    for start, end in contact_spans(contacts, rate):
        inside = slice(start + margin, end - margin)
        # The median forgives the frames of a long contact in which a foot was lifted after all.
        if end - start > 2 * margin and np.linalg.norm(median := np.median(speed[inside], axis=0)) < _FASTEST:
            creep[inside], known[inside] = median, 1.0
    return creep, known


def _mean_of_feet(feet: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Mean over those feet that know, and how many do."""
    known = sum((weights for _, weights in feet), np.zeros(len(feet[0][1])))
    total = sum((values * weights[:, None] for values, weights in feet), np.zeros_like(feet[0][0]))
    return total / np.maximum(known, 1.0)[:, None], known


def _levelled(performance: Performance, legs: tuple[Leg, Leg], ground: Ground) -> Array:
    """(T,) slow way upwards that brings standing feet to the ground."""
    feet = []
    for leg, contacts in zip(legs, performance.evidence.contacts.T, strict=True):
        points = sole_points(leg, performance.motion)
        above = (ground.height(points[..., :2], points[..., 2]) - points[..., 2]).max(axis=1)
        feet.append((above[:, None] * (contacts >= CONTACT)[:, None], (contacts >= CONTACT).astype(float)))
    lift, known = _mean_of_feet(feet)
    return known_low_pass(lift, known > 0, performance.rate, SLOW)[:, 0]
