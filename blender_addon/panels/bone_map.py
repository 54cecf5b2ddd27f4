# SPDX-License-Identifier: GPL-3.0-or-later
"""Below the Retarget section: which bone of the rig plays which part."""

from collections.abc import Sequence
from typing import Any

import bpy

from ..operators.bone_map import DetectBones, LoadBoneMap, LoadVrmMap, MendBoneMap, SaveBoneMap
from ..retarget.bone_map import BoneMap
from ..retarget.roles import LIMBS, NEEDED, SIDES
from ..retarget.validation import in_words
from ..rig.maps import all_presets

# Roles that are less sure than this show how sure they are.
_DOUBTFUL = 0.7

iface_ = bpy.app.translations.pgettext_iface


class BoneMapPresetsMenu(bpy.types.Menu):
    bl_idname = "VIEW3D_MT_scene_aware_mocap_bone_maps"
    bl_label = "Load"

    def draw(self, context: bpy.types.Context) -> None:
        rig = _rig_of(context)
        name = rig.name if rig else ""
        for preset in all_presets():
            button = self.layout.operator(LoadBoneMap.bl_idname, text=preset.title, translate=False)
            button.rig, button.preset = name, preset.title
        self.layout.separator()
        self.layout.operator(LoadVrmMap.bl_idname, text="From a VRM File").rig = name


class BoneMapPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_bone_map"
    bl_parent_id = "VIEW3D_PT_scene_aware_mocap_retarget"
    bl_label = "Bone Map"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        rig = _rig_of(context)
        if rig is None:
            layout.label(text="Choose the character's armature", icon="INFO")
            return
        layout.label(text=rig.name, icon="ARMATURE_DATA", translate=False)
        rig_map = context.scene.mocap_bone_map.rigs.get(rig.name)
        _draw_buttons(layout, rig, rig_map)
        if rig_map is None:
            layout.label(text="Bones are detected when you retarget")
            return
        if rig_map.source != BoneMap(()).source:  # else the user chose
            layout.label(text=f"{iface_('Found by')} {rig_map.source}, {rig_map.confidence:.0%}", translate=False)
        _draw_problems(layout, rig, rig_map)
        _draw_roles(layout, rig, rig_map)


def _rig_of(context: bpy.types.Context) -> bpy.types.Object | None:
    """The rig of the Retarget section, else the active armature."""
    chosen = context.scene.mocap_retarget.rig or context.object
    return chosen if chosen is not None and chosen.type == "ARMATURE" else None


def _draw_buttons(layout: bpy.types.UILayout, rig: bpy.types.Object, rig_map: Any) -> None:
    row = layout.row(align=True)
    row.operator(DetectBones.bl_idname, text="Detect", icon="VIEWZOOM").rig = rig.name
    row.menu(BoneMapPresetsMenu.bl_idname)
    saving = row.row(align=True)
    saving.enabled = rig_map is not None
    saving.operator(SaveBoneMap.bl_idname, text="Save").rig = rig.name


def _draw_problems(layout: bpy.types.UILayout, rig: bpy.types.Object, rig_map: Any) -> None:
    for problem in rig_map.problems:
        box = layout.box()
        column = box.column(align=True)
        for number, line in enumerate(_lines(problem.message)):
            icon = ("ERROR" if problem.blocks else "INFO") if number == 0 else "BLANK1"
            column.label(text=line, icon=icon, translate=False)
        if problem.mend:
            button = column.operator(MendBoneMap.bl_idname, text=problem.mend, translate=False)
            button.rig, button.mend = rig.name, problem.mend


def _draw_roles(layout: bpy.types.UILayout, rig: bpy.types.Object, rig_map: Any) -> None:
    limbs = {f"{side}_{limb}" for side in SIDES for limb in LIMBS}
    entries = list(rig_map.roles)
    _draw_entries(layout, rig, [entry for entry in entries if entry.name not in limbs])
    for side in SIDES:
        _draw_entries(layout, rig, [entry for entry in entries if entry.name.startswith(f"{side}_")])


def _draw_entries(layout: bpy.types.UILayout, rig: bpy.types.Object, entries: Sequence[Any]) -> None:
    column = layout.column(align=True)
    for entry in entries:
        row = column.row(align=True)
        row.alert = entry.name in NEEDED and not entry.bone
        split = row.split(factor=0.46, align=True)
        split.label(text=in_words(entry.name).title())
        bone = split.row(align=True)
        bone.prop_search(entry, "bone", rig.data, "bones", text="")
        if entry.bone and entry.confidence < _DOUBTFUL:
            doubt = bone.row()
            doubt.ui_units_x = 1.8
            doubt.label(text=f"{entry.confidence:.0%}", translate=False)


def _lines(message: str, width: int = 30) -> list[str]:
    """A message in lines that fit the sidebar."""
    lines = [""]
    for word in message.split():
        if len(lines[-1]) + len(word) > width:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return lines
