# SPDX-License-Identifier: GPL-3.0-or-later
"""Who touches whom, and where hands rest on the scene: what a whole scene's retargeting has to keep."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .ground import Ground
from .landmarks import palms
from .segments import Segment, box_gap, closest_on_line, ends, segments

Array = NDArray[np.float64]

# Palms touch from this distance on and let go beyond the second, metres: joints lie inside hands of 3 cm thickness,
# and what was solved from a video is good to a few centimetres.
_PALMS = (0.10, 0.15)
# A palm rests on somebody's skin, or on the scene, from this distance of the surface on; metres.
_SKIN = (0.04, 0.07)
_SCENE = (0.05, 0.08)
_THICK = 0.5  # metres from a body's bones to its skin, at most
_STILL = 0.15  # metres per second: a hand that leans on something
_RAMP = 0.3  # seconds in which a hand is drawn to what it will touch, and let go
_SHORTEST, _GAP = 0.05, 0.1  # seconds


@dataclass(frozen=True)
class Touch:
    """A palm that meets something.

    Attributes:
        actor, side: whose palm; 0 left, 1 right.
        other: the actor that is touched; -1 for the scene.
        other_side: the other's palm, 0 or 1; -1 when the touched is a part of the body or the scene.
        role: the part of the other's body; "" for palms and the scene.
        along: (T,) where on that part, 0 at its start to 1 at its end.
        offset: (T, 3) from the touched point to the palm; for the scene the palm's own place, metres, world.
        strength: (T,) 1 while they touch, rising from 0 before and falling after.
    """

    actor: int
    side: int
    other: int
    other_side: int
    role: str
    along: Array
    offset: Array
    strength: Array


def find_touches(actors: Sequence[Actor], ground: Ground) -> tuple[Touch, ...]:
    """All touches in the scene as it was solved."""
    places = [[palm.positions(actor.motion) for palm in palms(actor.source, actor.source_map)] for actor in actors]
    hands = [(who, side) for who in range(len(actors)) for side in (0, 1)]
    found = [_of_palms(actors, places, first, second) for first, second in combinations(hands, 2)]
    found += [_of_scene(actors, places, hand, ground) for hand in hands]
    for who, side in hands:
        for other in range(len(actors)):
            if other != who:
                found += _of_bodies(actors, places, (who, side), other)
    return tuple(touch for touch in found if touch is not None)


def strength_of(distance: Array, times: Array, near: float, far: float) -> Array | None:
    """(T,) how strongly something holds that begins when a distance falls below `near` and ends above `far`.

    Args:
        distance: (T,) metres.
        times: (T,) seconds.
        near: begins a touch.
        far: ends it; larger than `near`, so that noise does not.

    Returns:
        1 while it holds, smooth ramps before and after; None when it never holds.
    """
    held = _hysteresis(distance, near, far)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    held = _without_short(~_without_short(~held, _GAP / step), _SHORTEST / step)
    if not held.any():
        return None
    away = _frames_from(held) * step / _RAMP
    ramp = np.clip(1.0 - away, 0.0, 1.0)
    return ramp * ramp * (3.0 - 2.0 * ramp)


def _hysteresis(distance: Array, near: float, far: float) -> NDArray[np.bool_]:
    """Frames in runs below `far` that anywhere come below `near`."""
    held = distance < far
    labels = np.cumsum(np.diff(held.astype(int), prepend=0) == 1) * held
    touching = np.unique(labels[distance < near])
    return held & np.isin(labels, touching[touching > 0])


def _without_short(flags: NDArray[np.bool_], least: float) -> NDArray[np.bool_]:
    """Runs of true that are shorter than `least` frames become false; runs at the ends stay."""
    edges = np.diff(flags.astype(int), prepend=0, append=0)
    kept = flags.copy()
    for begin, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if end - begin < least and begin > 0 and end < len(flags):
            kept[begin:end] = False
    return kept


def _frames_from(held: NDArray[np.bool_]) -> Array:
    """(T,) number of frames to the nearest true one."""
    where = np.flatnonzero(held)
    frames = np.arange(len(held))
    after = np.clip(np.searchsorted(where, frames), 0, len(where) - 1)
    before = np.maximum(after - 1, 0)
    return np.minimum(np.abs(where[after] - frames), np.abs(where[before] - frames)).astype(float)


def _of_palms(
    actors: Sequence[Actor], places: list[list[Array]], first: tuple[int, int], second: tuple[int, int]
) -> Touch | None:
    offset = places[first[0]][first[1]] - places[second[0]][second[1]]
    both = actors[first[0]].there & actors[second[0]].there
    distance = np.where(both, np.linalg.norm(offset, axis=-1), np.inf)
    strength = strength_of(distance, actors[first[0]].motion.times, *_PALMS)
    if strength is None:
        return None
    return Touch(*first, *second, "", np.zeros(len(offset)), offset, strength)


def _of_scene(
    actors: Sequence[Actor], places: list[list[Array]], hand: tuple[int, int], ground: Ground
) -> Touch | None:
    place, times = places[hand[0]][hand[1]], actors[hand[0]].motion.times
    moving = np.linalg.norm(np.gradient(place, times, axis=0), axis=-1) if len(times) > 1 else np.zeros(len(place))
    gap = np.full(len(place), np.inf)
    still = (moving < _STILL) & actors[hand[0]].there
    gap[still] = ground.distance(place[still])
    strength = strength_of(gap, times, *_SCENE)
    if strength is None:
        return None
    return Touch(*hand, -1, -1, "", np.zeros(len(place)), place, strength)


def _of_bodies(
    actors: Sequence[Actor], places: list[list[Array]], hand: tuple[int, int], other: int
) -> list[Touch | None]:
    """The palm on another's body: on each part while it is the nearest one."""
    place, actor = places[hand[0]][hand[1]], actors[other]
    if box_gap(place[:, None], actor.motion.heads).min() > _THICK:
        return []
    parts = segments(actor.source, actor.source_map)
    measured = [_to_segment(place, actor, part) for part in parts]
    gaps = np.stack([gap for _, _, gap in measured])
    nearest = gaps.argmin(axis=0)
    # Where two hands meet, the hands say it better than the forearm behind one of them.
    gaps[:, _near_a_palm(places[other], place) | ~(actors[hand[0]].there & actor.there)] = np.inf
    found: list[Touch | None] = []
    for index, (part, (along, offset, _)) in enumerate(zip(parts, measured, strict=True)):
        strength = strength_of(np.where(nearest == index, gaps[index], np.inf), actor.motion.times, *_SKIN)
        if strength is not None:
            found.append(Touch(*hand, other, -1, part.role, along, offset, strength))
    return found


def _near_a_palm(palms_of_other: list[Array], place: Array) -> NDArray[np.bool_]:
    distances = [np.linalg.norm(place - palm, axis=-1) for palm in palms_of_other]
    return np.min(distances, axis=0) < _PALMS[1]


def _to_segment(place: Array, actor: Actor, part: Segment) -> tuple[Array, Array, Array]:
    start, end = ends(actor.motion, part)
    along = closest_on_line(start, end, place)
    offset = place - (start + along[:, None] * (end - start))
    return along, offset, np.linalg.norm(offset, axis=-1) - part.radius
