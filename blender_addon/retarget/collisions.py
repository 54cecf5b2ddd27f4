# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies that run into each other more than the people did."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .segments import Segment, box_gap, closest_between, ends, segments
from .skeleton import Motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Overlap:
    """Two parts of two bodies that overlap in some frames.

    Attributes:
        first, second: actor and part.
        along_first, along_second: (T,) where on their lines they are nearest.
        normal: (T, 3) unit vector from the second to the first.
        excess: (T,) metres by which they overlap more than they did in the source; 0 where they do not.
    """

    first: tuple[int, Segment]
    second: tuple[int, Segment]
    along_first: Array
    along_second: Array
    normal: Array
    excess: Array


def find_overlaps(actors: Sequence[Actor], motions: Sequence[Motion]) -> tuple[Overlap, ...]:
    """Parts of different rigs that overlap where those of the people did not, or more than they did.

    Args:
        actors: with the people's own motion.
        motions: of the rigs.
    """
    found = []
    for first, second in _near_pairs(actors, motions, of_rigs=True):
        for one, two in product(_parts(actors[first]), _parts(actors[second])):
            overlap = _overlap((first, *one), (second, *two), actors, motions)
            if overlap is not None:
                found.append(overlap)
    return tuple(found)


def depth_between(actors: Sequence[Actor], motions: Sequence[Motion], *, of_rigs: bool) -> Array:
    """(T,) the deepest overlap between any two bodies, metres; 0 where none touch.

    Args:
        actors: whose bodies.
        motions: of the rigs, or of the people themselves.
        of_rigs: whether the motions are the rigs'.
    """
    deepest = np.zeros(len(motions[0].times))
    for first, second in _near_pairs(actors, motions, of_rigs=of_rigs):
        bodies = [_body(actors[who], of_rigs=of_rigs) for who in (first, second)]
        both = actors[first].there & actors[second].there
        for one, two in product(*bodies):
            depth, *_ = _depth((motions[first], one), (motions[second], two))
            deepest = np.maximum(deepest, np.where(both, depth, 0.0))
    return deepest


def _near_pairs(actors: Sequence[Actor], motions: Sequence[Motion], *, of_rigs: bool) -> list[tuple[int, int]]:
    """Characters whose bodies are so near to each other in any frame that they may meet."""
    bodies = [_body(actor, of_rigs=of_rigs) for actor in actors]
    places = [
        np.stack([end for part in body for end in ends(motion, part)], axis=1)
        for body, motion in zip(bodies, motions, strict=True)
    ]
    thick = [max(part.radius for part in body) for body in bodies]
    pairs = combinations(range(len(actors)), 2)
    return [(a, b) for a, b in pairs if box_gap(places[a], places[b]).min() < thick[a] + thick[b]]


def _body(actor: Actor, *, of_rigs: bool) -> tuple[Segment, ...]:
    return segments(actor.target, actor.target_map) if of_rigs else segments(actor.source, actor.source_map)


def _parts(actor: Actor) -> list[tuple[Segment, Segment]]:
    """Parts of the person with the same parts of the rig."""
    return list(zip(_body(actor, of_rigs=False), _body(actor, of_rigs=True), strict=True))


def _overlap(
    first: tuple[int, Segment, Segment],
    second: tuple[int, Segment, Segment],
    actors: Sequence[Actor],
    motions: Sequence[Motion],
) -> Overlap | None:
    (who, part, rig_part), (other, other_part, other_rig_part) = first, second
    depth, s, t, normal = _depth((motions[who], rig_part), (motions[other], other_rig_part))
    if not (depth > 0).any():
        return None
    before, *_ = _depth((actors[who].motion, part), (actors[other].motion, other_part))
    both = actors[who].there & actors[other].there
    excess = np.where(both, np.maximum(depth - np.maximum(before, 0.0), 0.0), 0.0)
    if not (excess > 0).any():
        return None
    return Overlap((who, rig_part), (other, other_rig_part), s, t, normal, excess)


def _depth(first: tuple[Motion, Segment], second: tuple[Motion, Segment]) -> tuple[Array, Array, Array, Array]:
    """How deep two parts overlap (T,), where on each (T,), (T,), and the way apart (T, 3)."""
    a, b = ends(*first)
    c, d = ends(*second)
    s, t = closest_between(a, b, c, d)
    between = a + s[:, None] * (b - a) - c - t[:, None] * (d - c)
    distance = np.linalg.norm(between, axis=-1)
    normal = between / np.maximum(distance, 1e-9)[:, None]
    return first[1].radius + second[1].radius - distance, s, t, normal
