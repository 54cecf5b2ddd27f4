# SPDX-License-Identifier: GPL-3.0-or-later
"""A whole scene onto rigs: all characters together, and what became of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .actor import Actor
from .feet import Stage, level_under
from .ground import Ground
from .measures import Measures, measure_people, measure_rigs
from .options import Options
from .refine import refine
from .root_policy import with_policy
from .skeleton import Motion
from .transfer import transfer

_TRANSFERRING = 0.2
"""Part of the time that bringing people onto their rigs takes when the whole scene is refined afterwards."""


@dataclass(frozen=True)
class Outcome:
    """What rigs do now.

    Attributes:
        motions: one per actor, to be keyed.
        people: measures of the people themselves.
        rigs: of the rigs; of those in place, as they would move over the ground.
    """

    motions: tuple[Motion, ...]
    people: Measures
    rigs: Measures


def retarget_scene(
    actors: Sequence[Actor], options: Options, ground: Ground, progress: Callable[[float], None] = lambda _: None
) -> Outcome:
    """Bring all people of a scene onto their rigs.

    Args:
        actors: everybody, with maps that have all needed roles; their motions share their times.
        options: what the user chose.
        ground: under the people, in their own scale.
        progress: is told the part done, 0..1; whatever it raises ends the work.
    """
    share = _TRANSFERRING if options.refine else 1.0
    motions: tuple[Motion, ...] = ()
    for actor in actors:
        motions = (*motions, transfer(actor, options, ground))
        progress(share * len(motions) / len(actors))
    if options.refine:
        motions = refine(actors, motions, ground, options.scale, lambda part: progress(share + (1 - share) * part))
    stage = Stage(ground, options.scale)
    carried = tuple(
        with_policy(actor.target, actor.target_map, motion, options.root, level_under(actor, stage))
        for actor, motion in zip(actors, motions, strict=True)
    )
    outcome = Outcome(carried, measure_people(actors, ground), measure_rigs(actors, motions, ground, options.scale))
    progress(1.0)
    return outcome
