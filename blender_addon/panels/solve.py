# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's first section: from a video to a take."""

import textwrap
import time

import bpy

from ..operators.solve_video import CancelSolve, SolveVideo
from ..preferences import MocapPreferences, preferences_of
from ..settings.solve import copy_inputs
from ..solving import watch

iface_ = bpy.app.translations.pgettext_iface

_LINE = 42
"""Letters that fit the sidebar beside an icon."""


class SolvePanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_solve"
    bl_label = "Solve Video"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_order = 0
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        running = watch.current()
        if running is not None:
            _draw_progress(layout, running)
            return
        if not preferences_of(context).solver_python:
            layout.label(text="The solver runs in a Python of its own:", icon="INFO")
            button = layout.operator("preferences.addon_show", text="Choose It in the Preferences")
            button.module = MocapPreferences.bl_idname
            return
        settings = context.scene.mocap_solve
        for name in ("video", "output", "preset", "people"):
            layout.prop(settings, name)
        _draw_camera(layout, settings)
        _draw_more(layout, settings)
        layout.prop(settings, "import_result")
        button = layout.operator(SolveVideo.bl_idname, icon="PLAY")
        copy_inputs(settings, button)
        outcome = watch.last_outcome()
        if outcome is not None:
            _draw_outcome(layout, outcome)


def _draw_outcome(layout: bpy.types.UILayout, outcome: watch.Outcome) -> None:
    column = layout.column(align=True)
    icon = "CHECKMARK" if outcome.good else "ERROR"
    for line in textwrap.wrap(outcome.message, _LINE):
        column.label(text=line, icon=icon, translate=False)
        icon = "BLANK1"


def _draw_camera(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    column = layout.column(align=True)
    column.prop(settings, "camera")
    if settings.camera:
        column.prop(settings, "camera_name")
    else:
        column.prop(settings, "fov_degrees")


def _draw_more(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    header, body = layout.panel("scene_aware_mocap_solve_more", default_closed=True)
    header.label(text="More")
    if body is not None:
        for name in ("start_s", "end_s", "every", "rotate", "depth", "device", "resume"):
            body.prop(settings, name)


def _draw_progress(layout: bpy.types.UILayout, running: watch.Watch) -> None:
    stage = running.process.stage
    layout.label(text=running.process.request.video.name, icon="FILE_MOVIE", translate=False)
    layout.progress(factor=stage.fraction, text=f"{stage.name} {100 * stage.fraction:.0f} %", translate=False)
    left = stage.seconds_left(time.monotonic())
    if left is not None:
        layout.label(text=iface_("{:.0f} s left in this stage").format(left), translate=False)
    if running.process.cancelled:
        layout.label(text="Stopping")
    else:
        layout.operator(CancelSolve.bl_idname, icon="CANCEL", text="Cancel")
    layout.label(text=iface_("Its words are in the text {}").format(watch.LOG), translate=False)
