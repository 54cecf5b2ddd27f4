# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's section that brings takes in and tells about the person at hand."""

import bpy

from ..operators.import_take import ImportTake
from ..rig.evidence import never_there
from ..scene_import.armature import PRESENT_FROM, PRESENT_UNTIL

iface_ = bpy.app.translations.pgettext_iface


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
        box.label(text=person.name, icon="ARMATURE_DATA", translate=False)
        box.label(text=iface_("Height {:.2f} m").format(person["height_m"]), translate=False)
        box.label(text=iface_("Body {}").format(person["body_model"]), translate=False)
        if never_there(person):
            return
        there = iface_("There from {:.2f} s to {:.2f} s").format(person[PRESENT_FROM], person[PRESENT_UNTIL])
        box.label(text=there, translate=False)
