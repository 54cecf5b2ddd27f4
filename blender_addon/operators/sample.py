# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples that come with the extension, to try everything at once."""

from pathlib import Path

import bpy

SAMPLES = Path(__file__).resolve().parent.parent / "samples"
TAKE = SAMPLES / "sample_take.npz"
RIG = SAMPLES / "sample_rig.glb"

rpt_ = bpy.app.translations.pgettext_rpt


class LoadSampleTake(bpy.types.Operator):
    """Bring in three made-up people, to try things out: two shake hands, a child climbs two steps"""

    bl_idname = "scene_aware_mocap.load_sample_take"
    bl_label = "Load Sample Take"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    def execute(self, _context: bpy.types.Context) -> set[str]:
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(TAKE))
        self.report({"INFO"}, rpt_("The sample take is in the scene: press Play"))
        return {"FINISHED"}


class LoadSampleRig(bpy.types.Operator):
    """Bring in a small figure with the bone names of Mixamo, to try retargeting on"""

    bl_idname = "scene_aware_mocap.load_sample_rig"
    bl_label = "Load Sample Rig"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    def execute(self, context: bpy.types.Context) -> set[str]:
        if "io_scene_gltf2" not in context.preferences.addons:
            self.report({"ERROR"}, rpt_("The rig is a glTF file: enable the add-on glTF 2.0 format in the preferences"))
            return {"CANCELLED"}
        # The file's bones point along their y axes, as Blender's do; balls in the place of bones are not wanted.
        bpy.ops.import_scene.gltf(filepath=str(RIG), bone_heuristic="BLENDER", disable_bone_shape=True)
        rig = next(obj for obj in context.selected_objects if obj.type == "ARMATURE")
        context.view_layer.objects.active = rig
        self.report({"INFO"}, rpt_("{} is in the scene, at its origin").format(rig.name))
        return {"FINISHED"}
