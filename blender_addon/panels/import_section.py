# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's section that brings takes in and tells about the person at hand."""

import bpy

from ..operators.import_take import ImportTake
from ..scene_import.armature import PRESENT_FROM, PRESENT_UNTIL


class ImportPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_import"
    bl_label = "Import"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_order = 1

    def draw(self, context: bpy.types.Context) -> None:
        self.layout.operator(ImportTake.bl_idname, text="Import Take", icon="IMPORT")
        person = context.object
        if person is None or "person_id" not in person:
            return
        box = self.layout.box()
        box.label(text=person.name, icon="ARMATURE_DATA")
        box.label(text=f"Height {person['height_m']:.2f} m")
        box.label(text=f"Body {person['body_model']}")
        box.label(text=f"There from {person[PRESENT_FROM]:.2f} s to {person[PRESENT_UNTIL]:.2f} s")
