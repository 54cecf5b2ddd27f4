# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's section that brings people onto rigs."""

import bpy

from ..operators.retarget import Retarget
from ..settings.retarget import copy_inputs

iface_ = bpy.app.translations.pgettext_iface


class RetargetPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_retarget"
    bl_label = "Retarget"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_order = 3
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.mocap_retarget
        for name in ("rig", "copied", "root", "feet", "refine"):
            layout.prop(settings, name)
        header, body = layout.panel("scene_aware_mocap_retarget_more", default_closed=True)
        header.label(text="More")
        if body is not None:
            for name in ("scale", "drive"):
                body.prop(settings, name)
        button = layout.operator(Retarget.bl_idname, icon="ARMATURE_DATA")
        copy_inputs(settings, button)
        button.rig = settings.rig.name if settings.rig else ""
        _draw_table(layout, settings)


def _draw_table(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    if not settings.table:
        return
    table = layout.box().column(align=True)
    _draw_line(table, "", iface_("People"), iface_("Rigs"))
    for row in settings.table:
        _draw_line(table, iface_(row.label), row.people, row.rigs)


def _draw_line(table: bpy.types.UILayout, title: str, people: str, rigs: str) -> None:
    line = table.split(factor=0.52)
    line.label(text=title, translate=False)
    figures = line.row()
    for figure in (people, rigs):
        figures.label(text=figure, translate=False)
