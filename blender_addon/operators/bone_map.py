# SPDX-License-Identifier: GPL-3.0-or-later
"""Find, load, mend and save the bone map of a rig."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from core_solver.errors import UserError

from ..retarget.bone_map import BoneMap
from ..retarget.finding import map_by_preset
from ..retarget.presets import save_preset
from ..retarget.roles import NEEDED
from ..retarget.validation import find_problems
from ..retarget.vrm import read_vrm_map
from ..rig.maps import all_presets, damaged_presets, found_map, own_presets_folder
from ..rig.reading import read_skeleton
from ..settings.bone_map import store_map, stored_map

rpt_ = bpy.app.translations.pgettext_rpt


class _OnRig:
    """What the operators share: they work on the named armature, or on the active object."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    rig: bpy.props.StringProperty(
        name="Rig", description="The character's armature; the active object when empty", options={"SKIP_SAVE"}
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            self.report({"INFO"}, self.run(context, _rig_of(context, self.rig)))
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for problem in damaged_presets():
            self.report({"WARNING"}, problem)
        return {"FINISHED"}

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        """Do the work and say what was done.

        Raises:
            UserError: it cannot be done; nothing has changed.
        """
        raise NotImplementedError


class DetectBones(_OnRig, bpy.types.Operator):
    bl_idname = "scene_aware_mocap.detect_bones"
    bl_label = "Detect Bones"
    bl_description = (
        "Find out which bones are hips, legs, arms and head: by the names of well-known rigs, else by the rig's shape. "
        "Replaces the rig's present bone map; the rig itself is not changed"
    )

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        return _stored(context, obj, found_map(obj, read_skeleton(obj)))


class LoadBoneMap(_OnRig, bpy.types.Operator):
    """Use the bone names of a well-known kind of rig. Replaces the rig's present bone map"""

    bl_idname = "scene_aware_mocap.load_bone_map"
    bl_label = "Load Bone Map"

    preset: bpy.props.StringProperty(name="Preset", description="The title of a preset, such as Mixamo")

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        preset = next((preset for preset in all_presets() if preset.title == self.preset), None)
        if preset is None:
            titles = ", ".join(f"'{preset.title}'" for preset in all_presets())
            raise UserError(f"there is no bone map '{self.preset}': choose one of {titles}")
        bone_map = map_by_preset(read_skeleton(obj), preset)
        if not bone_map.bones:
            raise UserError(f"'{obj.name}' has none of the bones of '{preset.title}': choose another preset")
        return _stored(context, obj, bone_map)


class LoadVrmMap(_OnRig, bpy.types.Operator, ImportHelper):
    bl_idname = "scene_aware_mocap.load_vrm_map"
    bl_label = "Load Bone Map of a VRM File"
    bl_description = (
        "Use the bone map in a character's own .vrm file, from which the rig was imported. "
        "Replaces the rig's present bone map"
    )

    filename_ext = ".vrm"
    filter_glob: bpy.props.StringProperty(default="*.vrm;*.glb", options={"HIDDEN"})

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        bone_map = read_vrm_map(Path(self.filepath))
        if not any(bone in obj.data.bones for _, bone in bone_map.bones):
            raise UserError(f"'{obj.name}' has none of the bones in that file: choose the file it was imported from")
        return _stored(context, obj, bone_map)


class MendBoneMap(_OnRig, bpy.types.Operator):
    """Do what is offered to mend the bone map"""

    bl_idname = "scene_aware_mocap.mend_bone_map"
    bl_label = "Mend Bone Map"

    mend: bpy.props.StringProperty(
        name="Mend", description="What to do, as the bone map's problems say it; all of it, one by one, when empty"
    )

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        skeleton, bone_map = read_skeleton(obj), _map_of(context, obj)
        mends = [problem.mend for problem in find_problems(skeleton, bone_map) if problem.mend]
        chosen = [mend for mend in mends if self.mend in ("", mend.label)]
        if not chosen:
            raise UserError("there is nothing to mend so: look at the bone map's problems again")
        for _ in range(len(mends) if not self.mend else 1):
            bone_map = BoneMap(chosen[0].bones, bone_map.source, bone_map.confidence, bone_map.doubts)
            chosen = [problem.mend for problem in find_problems(skeleton, bone_map) if problem.mend]
            if not chosen:
                break
        return _stored(context, obj, bone_map)


class SaveBoneMap(_OnRig, bpy.types.Operator):
    """Keep the rig's bone map as a preset of your own, for all rigs with these bone names"""

    bl_idname = "scene_aware_mocap.save_bone_map"
    bl_label = "Save Bone Map"

    title: bpy.props.StringProperty(name="Name", description="How the preset is called; one of this name is replaced")

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self)

    def run(self, context: bpy.types.Context, obj: bpy.types.Object) -> str:
        path = save_preset(own_presets_folder(), self.title, _map_of(context, obj))
        return rpt_("Saved the bone map '{}' as {}").format(self.title, path)


def _rig_of(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """The armature with a name, or the active object."""
    obj = context.scene.objects.get(name) if name else context.object
    if obj is None:
        raise UserError(
            f"there is no object '{name}' in the scene" if name else "choose the character's armature first"
        )
    if obj.type != "ARMATURE":
        raise UserError(f"'{obj.name}' is no armature: choose the armature that moves it")
    return obj


def _map_of(context: bpy.types.Context, obj: bpy.types.Object) -> BoneMap:
    bone_map = stored_map(context.scene, obj)
    if bone_map is None:
        raise UserError(f"'{obj.name}' has no bone map yet: detect its bones first")
    return bone_map


def _stored(context: bpy.types.Context, obj: bpy.types.Object, bone_map: BoneMap) -> str:
    """Keep a map and say what it knows."""
    rig_map = store_map(context.scene, obj, bone_map)
    known = sum(bone_map.bone(role) is not None for role in NEEDED)
    problems = len(rig_map.problems)
    message = rpt_("Bones of '{}' by {}: {} of {} needed, {:.0%} sure, {} to mend")
    return message.format(obj.name, bone_map.source, known, len(NEEDED), bone_map.confidence, problems)
