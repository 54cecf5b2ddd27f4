# SPDX-License-Identifier: GPL-3.0-or-later
"""Cleaning people of a Blender scene: read everybody, reckon, write last. An error or a stop changes nothing."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..clean.drift import remove_drift
from ..clean.feet import legs_of, sole_points
from ..clean.foot_lock import lock_feet
from ..clean.gaps import Filling, fill, hidden_spans
from ..clean.key_reduction import Bound, FewKeys, reduce_keys
from ..clean.performance import Performance
from ..clean.smoothing import smooth
from ..clean.snapping import snap_to_ground
from ..retarget.ground import Ground
from ..retarget.measures import CONTACT
from ..retarget.skeleton import Motion
from .evidence import evidence_curves
from .few_keys import rotation_modes, write_few_keys
from .ground import cloud_points, clouds_of
from .layers import Result, bring_up, check_layerable, put_away, read_performance, with_contacts, write_performance
from .retargeting import frames_of

Array = NDArray[np.float64]
Surface = Literal["AUTO", "CLOUD", "FLOOR"]
Contacts = Literal["NEEDED", "USEFUL", "UNUSED"]


@dataclass(frozen=True)
class Cleaned:
    """What has been done.

    Attributes:
        notes: sentences for the user.
        count: of people whose motion is a new one.
    """

    notes: list[str]
    count: int


Work = Generator[float, None, Cleaned]
"""Yields the part done, 0..1; nothing has changed until it returns."""


_URGENCY: tuple[Contacts, ...] = ("NEEDED", "USEFUL", "UNUSED")


@dataclass(frozen=True)
class Step:
    """One thing to be done to a person's motion.

    Attributes:
        label: for the new action's name.
        change: the motion instead, None where it stays, and a sentence for the user or "".
        contacts: whether it must know when feet stand; "USEFUL" where it does with what is known.
        surface: which ground it needs; None for none.
    """

    label: str
    change: Callable[[Performance, Ground], tuple[Motion | None, str]]
    contacts: Contacts = "NEEDED"
    surface: Surface | None = None


@dataclass(frozen=True)
class _Person:
    object: bpy.types.Object
    frames: Array
    performance: Performance


def smoothing(cutoff: float, *, keep_contacts: bool = True) -> Step:
    """Take out what is faster than `cutoff` Hz."""
    contacts: Contacts = "USEFUL" if keep_contacts else "UNUSED"
    return Step("smooth", lambda p, _: (smooth(p, cutoff, keep_contacts=keep_contacts), ""), contacts)


def foot_lock(blend: float) -> Step:
    """Hold standing feet still, drawn there in `blend` seconds."""

    def change(performance: Performance, _: Ground) -> tuple[Motion, str]:
        locked = lock_feet(performance, blend)
        note = f"{locked.left_alone} contacts of '{performance.name}' were left alone: the foot walks in them"
        return locked.motion, note if locked.left_alone else ""

    return Step("foot lock", change)


def ground_snap(surface: Surface, blend: float) -> Step:
    """Put standing feet on the surface, drawn there in `blend` seconds."""
    return Step("ground", lambda p, ground: (snap_to_ground(p, ground, blend), ""), surface=surface)


def drift_removal(surface: Surface | None) -> Step:
    """Take out slow creeping; with a surface standing feet become level with it."""
    return Step("no drift", lambda p, ground: (remove_drift(p, ground if surface else None), ""), surface=surface)


def gap_filling(filling: Filling, confidence: float) -> Step:
    """Replace the motion where nobody saw the person, or with less confidence."""

    def change(performance: Performance, _: Ground) -> tuple[Motion | None, str]:
        gaps = hidden_spans(performance.evidence, confidence)
        if not gaps:
            return None, f"'{performance.name}' is never hidden"
        return fill(performance, gaps, filling), ""

    return Step("filled", change, contacts="UNUSED")


def baking() -> Step:
    """All layers and constraints as keys."""
    return Step("baked", lambda performance, _: (performance.motion, ""), contacts="UNUSED")


def clean(
    context: bpy.types.Context, people: Sequence[bpy.types.Object], steps: Sequence[Step], result: Result
) -> Work:
    """Do some steps one after the other; each person whom they change gets one new action or layer.

    Args:
        context: of the scene.
        people: armatures.
        steps: in their order.
        result: what becomes of them.

    Raises:
        UserError: it cannot be done for any of them, or an armature may not be changed.
    """
    notes: list[str] = []
    contacts = _URGENCY[min(_URGENCY.index(step.contacts) for step in steps)]
    found = yield from _read(context, people, contacts, notes)
    changed: set[int] = set()
    for number, step in enumerate(steps):
        grounds = _grounds(found, step.surface)
        for place, (person, ground) in enumerate(zip(found, grounds, strict=True)):
            yield 0.5 + 0.5 * (number + place / len(found)) / len(steps)
            motion, note = step.change(person.performance, ground)
            if motion is not None:
                found[place] = replace(person, performance=replace(person.performance, motion=motion))
                changed.add(place)
            notes += [note] if note else []
    label = ", ".join(step.label for step in steps)
    for place in sorted(changed):
        write_performance(found[place].object, found[place].performance, label, found[place].frames, result)
    return Cleaned(notes, len(changed))


def reduce(context: bpy.types.Context, people: Sequence[bpy.types.Object], bound: Bound, result: Result) -> Work:
    """Give people actions with as few keys as a bound allows.

    Args:
        context: of the scene.
        people: armatures.
        bound: how far the motion may be off.
        result: what becomes of them.

    Raises:
        UserError: an armature may not be changed.
    """
    found = yield from _read(context, people, "UNUSED", [])
    few: list[FewKeys] = []
    for number, person in enumerate(found):
        yield 0.5 + 0.5 * number / len(found)
        skeleton = person.performance.skeleton
        few.append(reduce_keys(skeleton, person.performance.motion, rotation_modes(person.object, skeleton), bound))
    notes = []
    for person, keys in zip(found, few, strict=True):
        put_away(person.object, result)
        others = evidence_curves(person.object, person.performance.evidence)
        name = f"{person.object.name} few keys"
        write_few_keys(person.object, person.performance.skeleton, keys, name, person.frames, others)
        bring_up(person.object, result)
        left = 100 * float(keys.keyed.mean())
        notes.append(
            f"'{person.object.name}' keeps {left:.0f} % of its keys, within {1000 * bound.distance:g} mm and "
            f"{np.degrees(bound.angle):g} degrees"
        )
    return Cleaned(notes, len(found))


def finish(work: Work, progress: Callable[[float], None] = lambda _: None) -> Cleaned:
    """Do work to its end without a stop.

    Args:
        work: from `clean` or `reduce`.
        progress: told the part done, 0..1.
    """
    while True:
        try:
            progress(next(work))
        except StopIteration as end:
            return end.value


def _read(
    context: bpy.types.Context, people: Sequence[bpy.types.Object], contacts: Contacts, notes: list[str]
) -> Generator[float, None, list[_Person]]:
    """Everybody as they move now; who lacks what is needed is left out with a note, if there are others."""
    for obj in people:
        check_layerable(obj)
    found: list[_Person] = []
    refusals: list[UserError] = []
    for number, obj in enumerate(people):
        yield 0.5 * number / len(people)
        frames = frames_of([obj])
        performance = read_performance(context, obj, frames)
        try:
            found.append(_Person(obj, frames, performance if contacts == "UNUSED" else with_contacts(obj, performance)))
        except UserError as error:
            if contacts == "USEFUL":
                found.append(_Person(obj, frames, performance))
            else:
                refusals.append(error)
    if not found:
        raise refusals[0]
    notes += [str(error) for error in refusals]
    return found


def _grounds(people: Sequence[_Person], surface: Surface | None) -> list[Ground]:
    """The ground under each person; people who share their clouds share it."""
    if surface is None or surface == "FLOOR":
        return [Ground.flat()] * len(people)
    made: dict[tuple[str, ...], Ground] = {}
    clouds = [tuple(cloud.name for cloud in clouds_of(person.object)) for person in people]
    for person, names in zip(people, clouds, strict=True):
        if names not in made:
            if not names and surface == "CLOUD":
                raise UserError("there are no scene points here: import them with the take, or choose the floor")
            together = [other for other, own in zip(people, clouds, strict=True) if own == names]
            points = cloud_points(person.object)
            made[names] = Ground.from_points(points) if surface == "CLOUD" else Ground.under(points, _soles(together))
    return [made[names] for names in clouds]


def _soles(people: Sequence[_Person]) -> Array:
    """(N, 3) places of all standing soles."""
    places = [np.zeros((0, 3))]
    for person in people:
        performance = person.performance
        legs = legs_of(performance.skeleton, performance.bone_map)
        for leg, contacts in zip(legs, performance.evidence.contacts.T, strict=True):
            places.append(sole_points(leg, performance.motion)[contacts >= CONTACT].reshape(-1, 3))
    return np.concatenate(places)
