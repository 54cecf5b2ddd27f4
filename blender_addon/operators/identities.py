# SPDX-License-Identifier: GPL-3.0-or-later
"""Put right who is who: swap, merge and split the people of a take."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from typing import Any

import bpy

from core_solver.errors import UserError

from ..rig.identifying import merge, split_person, swap
from ..settings.clean import ResultInput

rpt_ = bpy.app.translations.pgettext_rpt


class _Identities(ResultInput):
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    frame: bpy.props.IntProperty(
        name="Frame", description="First frame that is changed; when not given the frame that is shown"
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            message = self.change(context)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, message)
        return {"FINISHED"}

    def cut(self, context: bpy.types.Context) -> int:
        """The frame that was given, else the one shown."""
        return self.frame if self.properties.is_property_set("frame") else context.scene.frame_current


class _TwoPeople(_Identities):
    first: bpy.props.StringProperty(name="Person", description="Name of an armature; when empty the active one")
    second: bpy.props.StringProperty(
        name="Other Person", description="Name of an armature; when empty the other one that is selected"
    )

    def pair(self, context: bpy.types.Context) -> tuple[Any, Any]:
        """The two armatures."""
        first = _named(context, self.first) if self.first else _active(context)
        if self.second:
            return first, _named(context, self.second)
        others = [obj for obj in context.view_layer.objects if obj.select_get() and obj.type == "ARMATURE"]
        others = [obj for obj in others if obj != first]
        if len(others) != 1:
            raise UserError("choose two people: select both armatures and nobody else")
        return first, others[0]


class SwapPeople(_TwoPeople, bpy.types.Operator):
    """Give two people each other's motion from this frame on: for people who were taken for each other when they met"""

    bl_idname = "scene_aware_mocap.swap_people"
    bl_label = "Swap From Here"

    def change(self, context: bpy.types.Context) -> str:
        first, second = self.pair(context)
        swap(context, first, second, self.cut(context), self.result)
        return rpt_("'{}' and '{}' are swapped from frame {} on").format(first.name, second.name, self.cut(context))


class MergePeople(_TwoPeople, bpy.types.Operator):
    bl_idname = "scene_aware_mocap.merge_people"
    bl_label = "Merge Into Active"
    bl_description = (
        "Make one person of two who are the same: the active one goes on with the other's motion, what nobody saw in "
        "between is filled, and the other one is hidden"
    )

    def change(self, context: bpy.types.Context) -> str:
        first, second = self.pair(context)
        cut = self.frame if self.properties.is_property_set("frame") else None
        merge(context, first, second, cut, self.result)
        return rpt_("'{}' is a part of '{}' now, and hidden").format(second.name, first.name)


class SplitPerson(_Identities, bpy.types.Operator):
    """Make two people of the active one: from this frame on it is somebody else, with another armature and body"""

    bl_idname = "scene_aware_mocap.split_person"
    bl_label = "Split Here"

    first: bpy.props.StringProperty(name="Person", description="Name of an armature; when empty the active one")

    def change(self, context: bpy.types.Context) -> str:
        person = _named(context, self.first) if self.first else _active(context)
        second = split_person(context, person, self.cut(context), self.result)
        return rpt_("'{}' begins in frame {}, where '{}' ends").format(second.name, self.cut(context), person.name)


def _named(context: bpy.types.Context, name: str) -> Any:
    obj = context.scene.objects.get(name)
    if obj is None or obj.type != "ARMATURE":
        raise UserError(f"there is no armature called '{name}' in this scene: check the name")
    return obj


def _active(context: bpy.types.Context) -> Any:
    active = context.view_layer.objects.active
    armature = active if active is None or active.type == "ARMATURE" else active.find_armature()
    if armature is None:
        raise UserError("no armature is active: click the person first")
    return armature
