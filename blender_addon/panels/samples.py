# SPDX-License-Identifier: GPL-3.0-or-later
"""Something to try the extension on, below the Import section."""

import bpy

from ..operators.sample import LoadSampleRig, LoadSampleTake


class SamplesPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_samples"
    bl_parent_id = "VIEW3D_PT_scene_aware_mocap_import"
    bl_label = "Samples"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, _context: bpy.types.Context) -> None:
        column = self.layout.column(align=True)
        column.operator(LoadSampleTake.bl_idname, icon="OUTLINER_OB_ARMATURE")
        column.operator(LoadSampleRig.bl_idname, icon="ARMATURE_DATA")
