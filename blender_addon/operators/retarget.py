# SPDX-License-Identifier: GPL-3.0-or-later
"""Retarget: people of a scene onto rigs, all together."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

import math
from collections.abc import Sequence
from typing import Any

import bpy

from core_solver.errors import UserError

from ..rig.casting import cast
from ..rig.retargeting import retarget
from ..settings.retarget import RetargetInputs, options_of, show_measures

rpt_ = bpy.app.translations.pgettext_rpt


class CastEntry(bpy.types.PropertyGroup):
    """Who plays whom, by the names of armature objects: `name`, which every entry has, is the person's."""

    rig: bpy.props.StringProperty(name="Rig", description="The person's own rig; the common one when empty")


class Retarget(RetargetInputs, bpy.types.Operator):
    bl_idname = "scene_aware_mocap.retarget"
    bl_label = "Retarget"
    bl_description = (
        "Give rigs the motion of the selected people, or of all people of the scene, all together: everybody keeps the "
        "place, the distances and the footprints. Each rig gets a new action, nothing else changes"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    rig: bpy.props.StringProperty(
        name="Rig", description="The rig for everybody who is not in the cast; the active armature when empty"
    )
    cast: bpy.props.CollectionProperty(
        name="Cast", description="Who plays whom; empty for all people on the one rig", type=CastEntry
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        windows = context.window_manager
        windows.progress_begin(0.0, 1.0)
        try:
            pairs = [(entry.name, entry.rig) for entry in self.cast]
            roles = cast(context, pairs, self.rig, copied=self.copied, drive=self.drive)
            done = retarget(roles, options_of(self), windows.progress_update)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            windows.progress_end()
        for note in done.notes:
            self.report({"WARNING"}, note)
        show_measures(context.scene.mocap_retarget, done.outcome.people, done.outcome.rigs)
        _select(context, done.rigs)
        self.report({"INFO"}, _summary(done))
        return {"FINISHED"}


def _select(context: bpy.types.Context, rigs: Sequence[bpy.types.Object]) -> None:
    """Let the rigs be the selection: what is usually done next, such as exporting, is done to them."""
    for obj in context.view_layer.objects:
        obj.select_set(obj in rigs)


def _summary(done: Any) -> str:
    rigs = done.outcome.rigs
    parts = (
        (rpt_("feet slide {:.1f} mm per frame"), rigs.skate_mm),
        (rpt_("stand where they stood in {:.0f} % of their frames"), 100 * rigs.contact_recall),
        (rpt_("distances are off by {:.0f} mm"), rigs.spacing_mm),
    )
    done_so = rpt_("Retargeted {} people").format(len(done.rigs))
    known = ", ".join(text.format(value) for text, value in parts if not math.isnan(value))
    return f"{done_so}: {known}" if known else done_so
