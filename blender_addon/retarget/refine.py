# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole scene once more after every character has its rig: what people touched they touch again.

Hands that met meet, hands that rested on somebody or on the scene rest there, feet stay where they stand, and bodies
do not run into each other more than the people did. Rigs of other proportions than the people's bend for it as little
as they can, a little before and after too; their places over the ground stay.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .collisions import Overlap, find_overlaps
from .full_body_ik import Body, Goal, bend, body_of, improve
from .ground import Ground
from .landmarks import Landmark, palms
from .roles import SIDES
from .segments import Segment, height, segments
from .skeleton import Motion
from .touches import Touch, find_touches

Array = NDArray[np.float64]

# Weights of goals, per square metre, against the costs of turns in `full_body_ik`.
_HAND, _FEET, _APART, _ABOVE = 2e4, 1e5, 2e3, 5e3
_GIVING = ("upper_arm", "forearm")  # parts that come to meet a hand
_MOST_APART = 0.06  # metres by which one overlap pushes a body at once
_ROUNDS, _STEPS = 8, 2
_SMOOTH = 0.07  # seconds, standard deviation: what a body does for its goals comes and goes no faster
_AROUND = 0.5  # seconds before and after a goal in which a body may move for it


@dataclass(frozen=True)
class _Scene:
    """All that stays the same while a scene is refined, in the frames that need it.

    Attributes:
        actors: with the people's motion.
        bodies: the rigs in the poses to be kept.
        palms: left and right of each rig.
        touches: to be kept.
        ground: below the rigs, in the people's own scale.
        scale: of the scene.
    """

    actors: tuple[Actor, ...]
    bodies: tuple[Body, ...]
    palms: tuple[tuple[Landmark, Landmark], ...]
    touches: tuple[Touch, ...]
    ground: Ground
    scale: float


def refine(
    actors: Sequence[Actor],
    motions: Sequence[Motion],
    ground: Ground,
    scale: float = 1.0,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Motion, ...]:
    """Go over a scene whose rigs already move.

    Args:
        actors: all characters of the scene; their motions share their times.
        motions: of the rigs, feet in place.
        ground: under the people, in their own scale.
        scale: the scene's: rigs stand at `scale` times the people's places.
        progress: is told the part done, 0..1; whatever it raises ends the work.

    Returns:
        The rigs' motions; frames in which nothing is to be done are as they were.
    """
    touches = find_touches(actors, ground)
    busy = np.flatnonzero(_busy(actors, motions, touches))
    if not len(busy):
        return tuple(motions)
    scene = _Scene(
        tuple(actor.at(busy) for actor in actors),
        tuple(body_of(a.target, a.target_map, m.at(busy)) for a, m in zip(actors, motions, strict=True)),
        tuple(palms(actor.target, actor.target_map) for actor in actors),
        tuple(_touch_at(touch, busy) for touch in touches),
        ground,
        scale,
    )
    changes = [np.zeros((len(busy), body.size)) for body in scene.bodies]
    priors = changes
    for turn in range(_ROUNDS):
        changes = _round(scene, changes, priors)
        priors = [_smooth(change, busy, motions[0].times) for change in changes]
        progress((turn + 1) / _ROUNDS)
    bent = [bend(body, change) for body, change in zip(scene.bodies, changes, strict=True)]
    return tuple(_with(motion, busy, part) for motion, part in zip(motions, bent, strict=True))


def _round(scene: _Scene, changes: list[Array], priors: list[Array]) -> list[Array]:
    """Look where everybody is, say where everybody should be, and take some steps there."""
    motions = [bend(body, change) for body, change in zip(scene.bodies, changes, strict=True)]
    goals = [_standing(actor, body) for actor, body in zip(scene.actors, scene.bodies, strict=True)]
    for touch in scene.touches:
        _add_touch(scene, touch, motions, goals)
    for overlap in find_overlaps(scene.actors, motions):
        _add_overlap(overlap, motions, goals)
    for who, motion in enumerate(motions):
        goals[who] += _above_ground(scene, who, motion)
    return [
        _improved(body, change, prior, wanted)
        for body, change, prior, wanted in zip(scene.bodies, changes, priors, goals, strict=True)
    ]


def _improved(body: Body, changes: Array, prior: Array, goals: list[Goal]) -> Array:
    """Some steps further, in the frames in which this body has anything to do besides standing as it stands."""
    own = (changes != 0).any(axis=1) | (prior != 0).any(axis=1)
    for goal in goals[len(SIDES) :]:
        own |= goal.weight > 0
    frames = np.flatnonzero(own)
    if not len(frames):
        return changes
    part, wanted = body.at(frames), [goal.at(frames) for goal in goals]
    better = changes.copy()
    for _ in range(_STEPS):
        better[frames] = improve(part, better[frames], prior[frames], wanted)
    return better


def _standing(actor: Actor, body: Body) -> list[Goal]:
    """Feet stay where they are: what a body does for its hands must not make them slide."""
    frames = len(body.style.times)
    feet = [actor.target.index(actor.target_map.needed(f"{side}_foot")) for side in SIDES]
    return [
        Goal((Landmark(foot, np.zeros(3)),), np.ones((1, frames)), body.style.heads[:, foot], np.full(frames, _FEET))
        for foot in feet
    ]


def _add_touch(scene: _Scene, touch: Touch, motions: list[Motion], goals: list[list[Goal]]) -> None:
    palm = scene.palms[touch.actor][touch.side]
    place = palm.positions(motions[touch.actor])
    if touch.other < 0:
        goals[touch.actor].append(_to(scene, touch, palm, touch.actor, scene.scale * touch.offset))
    elif touch.other_side >= 0:
        other = scene.palms[touch.other][touch.other_side]
        # Both go half of the way that is left, from where they are: who cannot reach further is met by the other.
        middle = (place + other.positions(motions[touch.other])) / 2
        goals[touch.actor].append(_to(scene, touch, palm, touch.actor, middle + touch.offset / 2))
        goals[touch.other].append(_to(scene, touch, other, touch.other, middle - touch.offset / 2))
    else:
        _add_touch_on_body(scene, touch, motions, goals)


def _add_touch_on_body(scene: _Scene, touch: Touch, motions: list[Motion], goals: list[list[Goal]]) -> None:
    """The palm goes to the touched part: as far from its line as before, and more where the rig is thicker."""
    palm = scene.palms[touch.actor][touch.side]
    actor, motion = scene.actors[touch.other], motions[touch.other]
    part = next(part for part in segments(actor.target, actor.target_map) if part.role == touch.role)
    girth = height(actor.target, actor.target_map) / height(actor.source, actor.source_map)
    points, shares = _on_line(part, touch.along)
    touched = _place(motion, points, shares)
    wanted = touched + girth * touch.offset
    if not touch.role.endswith(_GIVING):
        goals[touch.actor].append(_to(scene, touch, palm, touch.actor, wanted))
        return
    # Arms give way to each other: whoever only followed would run after an arm that follows back.
    half = (wanted - palm.positions(motions[touch.actor])) / 2
    goals[touch.actor].append(_to(scene, touch, palm, touch.actor, wanted - half))
    weight = _HAND * touch.strength
    goals[touch.other].append(Goal(points, shares, touched - half, weight))


def _to(scene: _Scene, touch: Touch, palm: Landmark, who: int, target: Array) -> Goal:
    """A goal that draws a palm from where the pose has it to the target, as strongly as they touch."""
    own = palm.positions(scene.bodies[who].style)
    strength = touch.strength[:, None]
    weight = np.where(touch.strength > 0, _HAND, 0.0)
    return Goal((palm,), np.ones((1, len(own))), own + strength * (target - own), weight)


def _add_overlap(overlap: Overlap, motions: list[Motion], goals: list[list[Goal]]) -> None:
    """Each of the two gives way by half."""
    way = np.minimum(overlap.excess, _MOST_APART)[:, None] * overlap.normal / 2
    for (who, part), along, step in (
        (overlap.first, overlap.along_first, way),
        (overlap.second, overlap.along_second, -way),
    ):
        points, shares = _on_line(part, along)
        place = _place(motions[who], points, shares)
        weight = np.where(overlap.excess > 0, _APART, 0.0)
        goals[who].append(Goal(points, shares, place + step, weight, overlap.normal))


def _on_line(part: Segment, along: Array) -> tuple[tuple[Landmark, ...], Array]:
    """A place on a capsule's line, by its two ends."""
    last = Landmark(part.start, part.tip) if part.start == part.end else Landmark(part.end, np.zeros(3))
    points = (Landmark(part.start, np.zeros(3)), last)
    return points, np.stack([1 - along, along])


def _place(motion: Motion, points: tuple[Landmark, ...], shares: Array) -> Array:
    return np.sum([s[:, None] * p.positions(motion) for p, s in zip(points, shares, strict=True)], axis=0)


def _above_ground(scene: _Scene, who: int, motion: Motion) -> list[Goal]:
    """Hands that would come below the ground stay on it."""
    goals = []
    for palm in scene.palms[who]:
        place = palm.positions(motion)
        under = scene.scale * scene.ground.height(place[:, :2] / scene.scale, place[:, 2] / scene.scale)
        weight = np.where(place[:, 2] < under, _ABOVE, 0.0)
        if weight.any():
            target = np.stack([place[:, 0], place[:, 1], under], axis=-1)
            up = np.broadcast_to([0.0, 0.0, 1.0], place.shape)
            goals.append(Goal((palm,), np.ones((1, len(place))), target, weight, up))
    return goals


def _busy(actors: Sequence[Actor], motions: Sequence[Motion], touches: Sequence[Touch]) -> NDArray[np.bool_]:
    """(T,) frames in which something is to be done, and those around."""
    wanted = np.zeros(len(motions[0].times), bool)
    for touch in touches:
        wanted |= touch.strength > 0
    for overlap in find_overlaps(actors, motions):
        wanted |= overlap.excess > 0
    reach = int(np.ceil(_AROUND / _step(motions[0].times)))
    return np.convolve(wanted, np.ones(2 * reach + 1))[reach : reach + len(wanted)] > 0.5


def _smooth(changes: Array, busy: NDArray[np.int64], times: Array) -> Array:
    """(F, N) the changes as they would come and go slowly; there are none in the frames left out."""
    everywhere = np.zeros((len(times), changes.shape[1]))
    everywhere[busy] = changes
    sigma = _SMOOTH / _step(times)
    reach = int(np.ceil(3 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-9)) ** 2)
    padded = np.pad(everywhere, ((reach, reach), (0, 0)), "edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1, axis=0)
    return (windows @ (kernel / kernel.sum()))[busy]


def _step(times: Array) -> float:
    return float(np.median(np.diff(times))) if len(times) > 1 else 1.0


def _touch_at(touch: Touch, frames: NDArray[np.int64]) -> Touch:
    return replace(touch, along=touch.along[frames], offset=touch.offset[frames], strength=touch.strength[frames])


def _with(motion: Motion, frames: NDArray[np.int64], part: Motion) -> Motion:
    """A motion with some of its frames replaced."""
    rotations, heads = motion.rotations.copy(), motion.heads.copy()
    rotations[frames], heads[frames] = part.rotations, part.heads
    return Motion(motion.times, rotations, heads)
