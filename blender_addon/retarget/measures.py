# SPDX-License-Identifier: GPL-3.0-or-later
"""How well a scene on rigs is what the people did: a small table, before and after."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .bone_map import BoneMap
from .collisions import depth_between
from .ground import Ground
from .landmarks import Sole, palms, soles
from .roles import SIDES
from .skeleton import Motion, Skeleton
from .touches import find_touches

Array = NDArray[np.float64]

CONTACT = 0.5
"""From this probability on a foot stands."""
KEPT = 0.02
"""A standing foot is kept when its sole is not further than this from where the person's stands, metres."""


@dataclass(frozen=True)
class Measures:
    """One row of the table; nan where there was nothing to be measured.

    Attributes:
        skate_mm: mean way of the sole's resting point per frame while the person's foot stands, millimetres.
        penetration_mm: mean depth of the soles below the ground while they stand, millimetres.
        contact_recall: part of the frames of standing feet in which the middle of the sole is within 2 cm of the place
            where the person's stands, and the sole as high above the ground to within 2 cm.
        spacing_mm: largest error of the distance over the ground between two characters' hips.
        touch_mm: mean error of the way between two palms that touch.
        overlap_mm: largest depth of one body inside another.
    """

    skate_mm: float
    penetration_mm: float
    contact_recall: float
    spacing_mm: float
    touch_mm: float
    overlap_mm: float


def measure_people(actors: Sequence[Actor], ground: Ground) -> Measures:
    """The people themselves, before retargeting.

    Args:
        actors: all characters of a scene.
        ground: under them.
    """
    bodies = [(actor.source, actor.source_map, actor.motion) for actor in actors]
    overlap = depth_between(actors, [actor.motion for actor in actors], of_rigs=False)
    return _measures(actors, bodies, ground, 1.0, overlap)


def measure_rigs(actors: Sequence[Actor], motions: Sequence[Motion], ground: Ground, scale: float = 1.0) -> Measures:
    """The rigs, against what the people did.

    Args:
        actors: all characters of a scene.
        motions: of their rigs.
        ground: under the people, in their own scale.
        scale: of the rigs' scene.
    """
    bodies = [(actor.target, actor.target_map, motion) for actor, motion in zip(actors, motions, strict=True)]
    return _measures(actors, bodies, ground, scale, depth_between(actors, motions, of_rigs=True))


def _measures(
    actors: Sequence[Actor],
    bodies: Sequence[tuple[Skeleton, BoneMap, Motion]],
    ground: Ground,
    scale: float,
    overlap: Array,
) -> Measures:
    steps, depths, kept = zip(
        *(_feet(actor, *body, ground, scale) for actor, body in zip(actors, bodies, strict=True)), strict=True
    )
    return Measures(
        skate_mm=1000 * _mean(np.concatenate(steps)),
        penetration_mm=1000 * _mean(np.concatenate(depths)),
        contact_recall=_mean(np.concatenate(kept)),
        spacing_mm=1000 * _spacing_error(actors, bodies, scale),
        touch_mm=1000 * _touch_error(actors, bodies, ground),
        overlap_mm=1000 * float(overlap.max(initial=0.0)) if len(actors) > 1 else np.nan,
    )


def _feet(
    actor: Actor, skeleton: Skeleton, bone_map: BoneMap, motion: Motion, ground: Ground, scale: float
) -> tuple[Array, Array, Array]:
    """Of both feet while they stand: ways per frame, depths below the ground (metres), and whether they are kept."""
    steps, depths, kept = [], [], []
    pairs = zip(soles(actor.source, actor.source_map), soles(skeleton, bone_map), actor.contacts.T, strict=True)
    for person_sole, sole, contact in pairs:
        stands = contact >= CONTACT
        person, rig = scale * _ends(person_sole, actor.motion), _ends(sole, motion)
        wanted, above = (_lowest(points, ground, scale) for points in (person, rig))
        aside = np.linalg.norm((rig - person)[..., :2].mean(axis=0), axis=-1)
        still = stands[1:] & stands[:-1]
        # A foot that rolls rests on one of its ends at a time.
        moved = np.linalg.norm(np.diff(rig, axis=1), axis=-1).min(axis=0)
        steps.append(moved[still])
        depths.append(np.maximum(-above[stands], 0.0))
        kept.append((np.maximum(aside, np.abs(above - wanted)) <= KEPT)[stands])
    return np.concatenate(steps), np.concatenate(depths), np.concatenate(kept).astype(float)


def _ends(sole: Sole, motion: Motion) -> Array:
    """(2, T, 3) heel and ball."""
    return np.stack([sole.heel.positions(motion), sole.ball.positions(motion)])


def _lowest(ends: Array, ground: Ground, scale: float) -> Array:
    """(T,) height above the ground of the lower end of a sole."""
    return (ends[..., 2] - scale * ground.height(ends[..., :2] / scale, ends[..., 2] / scale)).min(axis=0)


def _spacing_error(actors: Sequence[Actor], bodies: Sequence[tuple[Skeleton, BoneMap, Motion]], scale: float) -> float:
    people = [_between_hips(actor.source, actor.source_map, actor.motion) for actor in actors]
    rigs = [_between_hips(*body) for body in bodies]
    errors = [
        np.abs(_apart(rigs[i], rigs[j]) - scale * _apart(people[i], people[j])).max()
        for i, j in combinations(range(len(actors)), 2)
    ]
    return float(max(errors, default=np.nan))


def _touch_error(actors: Sequence[Actor], bodies: Sequence[tuple[Skeleton, BoneMap, Motion]], ground: Ground) -> float:
    places = [[palm.positions(motion) for palm in palms(skeleton, bone_map)] for skeleton, bone_map, motion in bodies]
    errors = [
        np.linalg.norm(places[touch.actor][touch.side] - places[touch.other][touch.other_side] - touch.offset, axis=-1)[
            touch.strength == 1.0
        ]
        for touch in find_touches(actors, ground)
        if touch.other >= 0 and touch.other_side >= 0
    ]
    return _mean(np.concatenate(errors)) if errors else np.nan


def _between_hips(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Array:
    """(T, 2) the middle between the hip joints, over the ground: hips bones begin elsewhere in every rig."""
    joints = [skeleton.index(bone_map.needed(f"{side}_thigh")) for side in SIDES]
    return motion.heads[:, joints, :2].mean(axis=1)


def _apart(first: Array, second: Array) -> Array:
    return np.linalg.norm(first - second, axis=-1)


def _mean(values: Array) -> float:
    return float(values.mean()) if len(values) else np.nan
