# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's section that writes characters to files for game engines."""

import bpy

from ..operators.export import Export
from ..settings.export import copy_inputs


class ExportPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_export"
    bl_label = "Export"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_order = 4
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.mocap_export
        for name in ("engine", "folder", "file_name"):
            layout.prop(settings, name)
        header, body = layout.panel("scene_aware_mocap_export_more", default_closed=True)
        header.label(text="More")
        if body is not None:
            for name in ("file_format", "files", "contents", "frame_rate", "camera"):
                body.prop(settings, name)
        button = layout.operator(Export.bl_idname, icon="EXPORT")
        copy_inputs(settings, button)
        button.directory, button.file_name = settings.folder, settings.file_name
        _draw_checks(layout, settings)


def _draw_checks(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
    if not settings.checks:
        return
    box = layout.box()
    box.label(text="Read Back")
    for row in settings.checks:
        line = box.column(align=True)
        icon = "CHECKMARK" if row.passed else "ERROR"
        line.label(text=f"{row.name}: {row.file}", icon=icon, translate=False)
        line.label(text=row.text, icon="BLANK1", translate=False)
