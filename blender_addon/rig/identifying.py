# SPDX-License-Identifier: GPL-3.0-or-later
"""People of a Blender scene who are one, two, or each other: new actions, and a new armature where one is two."""

from dataclasses import replace
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..clean.identities import merged, split, swapped
from ..clean.performance import Evidence, Performance
from ..scene_import.armature import PRESENT_FROM, PRESENT_UNTIL
from .copying import copy_rig
from .layers import Result, check_layerable, read_performance, write_performance
from .retargeting import frames_of

Array = NDArray[np.float64]

_PERSON = "person_id"


def swap(
    context: bpy.types.Context, first: bpy.types.Object, second: bpy.types.Object, cut: int, result: Result
) -> None:
    """Give two people each other's motion from scene frame `cut` on.

    Raises:
        UserError: they cannot be swapped. Nothing has changed then.
    """
    frames, (one, other) = _read(context, [first, second])
    for obj, performance in zip((first, second), swapped(one, other, _index(frames, cut)), strict=True):
        _write(context, obj, performance, "swapped", frames, result)


def merge(
    context: bpy.types.Context, earlier: bpy.types.Object, later: bpy.types.Object, cut: int | None, result: Result
) -> None:
    """Let one armature show what two people did who are one; the other one is hidden by a motion of its own.

    Args:
        context: of the scene.
        earlier: who is there first, and stays.
        later: who the same person is afterwards.
        cut: first scene frame of the second; None to find it.
        result: what becomes of the motions.

    Raises:
        UserError: they cannot be merged. Nothing has changed then.
    """
    frames, (one, other) = _read(context, [earlier, later])
    whole = merged(one, other, None if cut is None else _index(frames, cut))
    nobody = np.zeros(len(frames), bool)
    gone = Evidence(np.zeros((len(frames), 2)), nobody, nobody, np.zeros(len(frames)))
    _write(context, earlier, whole, f"and {later.name}", frames, result)
    _write(context, later, replace(other, evidence=gone), f"is {earlier.name}", frames, result)


def split_person(context: bpy.types.Context, person: bpy.types.Object, cut: int, result: Result) -> bpy.types.Object:
    """Make a second armature that is there from scene frame `cut` on; the first one is gone from then on.

    Returns:
        The second one.

    Raises:
        UserError: nothing lies before or after the frame. Nothing has changed then.
    """
    frames, (whole,) = _read(context, [person])
    before, after = split(whole, _index(frames, cut))
    second = _copied(context, person)
    _write(context, person, before, "first part", frames, result)
    _write(context, second, after, "second part", frames, result)
    return second


def _read(context: bpy.types.Context, people: list[bpy.types.Object]) -> tuple[Array, list[Performance]]:
    if len(set(people)) < len(people):
        raise UserError(f"'{people[0].name}' is both people: choose two different ones")
    for person in people:
        check_layerable(person)
        if _PERSON not in person:
            raise UserError(f"'{person.name}' is nobody of a take: choose people that a take brought in")
    frames = frames_of(people)
    return frames, [read_performance(context, person, frames) for person in people]


def _index(frames: Array, cut: int) -> int:
    """Place of a scene frame; the functions that cut refuse places at either end."""
    return int(np.searchsorted(frames, cut))


def _write(
    context: bpy.types.Context, obj: Any, performance: Performance, label: str, frames: Array, result: Result
) -> None:
    write_performance(obj, performance, label, frames, result)
    if PRESENT_FROM not in obj:
        return
    there = np.flatnonzero(performance.evidence.present)
    rate = context.scene.render.fps / context.scene.render.fps_base
    # No time is both after 0 s and before -1 s: who reads these never shows the person.
    times = frames[there[[0, -1]]] / rate if len(there) else (0.0, -1.0)
    obj[PRESENT_FROM], obj[PRESENT_UNTIL] = (float(time) for time in times)


def _copied(context: bpy.types.Context, person: Any) -> bpy.types.Object:
    second = copy_rig(person, f"{person.name} second")
    # Which bones are shown hangs on the armature's data, and follows one person only.
    second.data = person.data.copy()
    animation = second.data.animation_data
    for driver in animation.drivers if animation else ():
        for target in (target for variable in driver.driver.variables for target in variable.targets):
            if target.id == person:
                target.id = second
    second[_PERSON] = max(obj[_PERSON] for obj in context.scene.objects if _PERSON in obj) + 1
    return second
