# SPDX-License-Identifier: GPL-3.0-or-later
"""Who plays whom: from what is named or selected to people, rigs and their bone maps."""

from collections.abc import Sequence
from typing import Any

import bpy

from core_solver.errors import UserError

from ..retarget.options import Drive
from .evidence import never_there
from .maps import map_of
from .retargeting import PLAYS, Role

PERSON = "person_id"
"""Custom property of the armatures that takes bring in."""


def cast(
    context: bpy.types.Context, pairs: Sequence[tuple[str, str]], rig: str, *, copied: bool, drive: Drive
) -> list[Role]:
    """The roles of a scene.

    Args:
        context: its scene and selection are asked for what is not named.
        pairs: names of people's armatures and of their own rigs, "" for the common rig; empty for all people that are
            selected, or else for all of the scene.
        rig: name of the common rig; "" for the active or the only other selected armature.
        copied: everybody without an own rig gets a copy of the common one.
        drive: which controls of a control rig are meant.

    Raises:
        UserError: somebody is not there, is no armature, or has no bone map.
    """
    named = [(_armature(context, person), _armature(context, own) if own else None) for person, own in pairs]
    common = None
    if not named or not all(own for _, own in named):
        common = _armature(context, rig) if rig else _likely_rig(context)
    if not named:
        named = [(person, None) for person in _likely_people(context, common)]
    everybody = {obj for pair in named for obj in pair} | {common}
    maps = {obj: map_of(context, obj, drive) for obj in everybody if obj is not None}
    return [
        Role(person, maps[person], own or common, maps[own or common], copied=copied and own is None)
        for person, own in named
    ]


def _armature(context: bpy.types.Context, name: str) -> Any:
    obj = context.scene.objects.get(name)
    if obj is None:
        raise UserError(f"there is no object '{name}' in this scene: check the name")
    if obj.type != "ARMATURE":
        raise UserError(f"'{name}' is no armature: choose the armature that moves it")
    return obj


def _likely_rig(context: bpy.types.Context) -> Any:
    active = context.view_layer.objects.active
    if active is not None and active.type == "ARMATURE" and PERSON not in active:
        return active
    others = [obj for obj in _selected(context) if PERSON not in obj]
    if len(others) != 1:
        raise UserError("choose the rig: no armature named, and not just one selected that is no person")
    return others[0]


def _likely_people(context: bpy.types.Context, rig: Any) -> list[Any]:
    """Selected people of takes, or other selected armatures that move, or all people of the scene, who are there."""
    selected = [obj for obj in _selected(context) if obj != rig and not _is_character(obj) and not never_there(obj)]
    people = [obj for obj in selected if PERSON in obj] or [obj for obj in selected if obj.animation_data is not None]
    if not people:
        armatures = [obj for obj in context.scene.objects if obj.type == "ARMATURE" and PERSON in obj]
        people = [obj for obj in armatures if obj != rig and not _is_character(obj) and not never_there(obj)]
    if not people:
        raise UserError("nobody to retarget: import a take, or select an armature that moves beside the rig")
    return sorted(people, key=lambda obj: obj.name)


def _is_character(obj: Any) -> bool:
    """Whether an armature plays a person by an earlier retargeting: it is no person itself."""
    action = obj.animation_data.action if obj.animation_data else None
    return PLAYS in obj or (action is not None and PLAYS in action)


def _selected(context: bpy.types.Context) -> list[Any]:
    return [obj for obj in context.view_layer.objects if obj.type == "ARMATURE" and obj.select_get()]
