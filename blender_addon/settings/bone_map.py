# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone maps that belong to rigs of a scene. They are kept on the scene: rigs are not changed."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from typing import Any

import bpy

from core_solver.errors import UserError

from ..retarget.bone_map import BoneMap
from ..retarget.roles import ROLES, SPINE
from ..retarget.validation import find_problems
from ..rig.reading import read_skeleton


def _on_edit(entry: Any, context: bpy.types.Context) -> None:
    """A user chose another bone: it is no doubt any more, and the map is checked anew."""
    rig_map = next(m for m in context.scene.mocap_bone_map.rigs if any(e == entry for e in m.roles))
    if not rig_map.is_filling:
        rig_map.source = BoneMap(()).source
        entry.confidence = 1.0
        check_map(rig_map, context.scene.objects.get(rig_map.name))


class RoleEntry(bpy.types.PropertyGroup):
    """Which bone plays a role: `name`, which every entry has, is the role's."""

    bone: bpy.props.StringProperty(
        name="Bone",
        description="The bone that takes this part of the body's motion; empty if there is none",
        update=_on_edit,
    )
    confidence: bpy.props.FloatProperty(name="Confidence", subtype="FACTOR", min=0.0, max=1.0, default=1.0)


class ProblemEntry(bpy.types.PropertyGroup):
    """Something wrong with a map, and the label of its mend if there is one."""

    message: bpy.props.StringProperty()
    mend: bpy.props.StringProperty()
    blocks: bpy.props.BoolProperty()


class RigMap(bpy.types.PropertyGroup):
    """The map of one rig: `name`, which every entry has, is that of the armature object."""

    source: bpy.props.StringProperty(name="Found By", description="What told which bone is which")
    confidence: bpy.props.FloatProperty(name="Confidence", subtype="FACTOR", min=0.0, max=1.0)
    roles: bpy.props.CollectionProperty(type=RoleEntry)
    problems: bpy.props.CollectionProperty(type=ProblemEntry)
    is_filling: bpy.props.BoolProperty(description="Set while bones are written that nobody chose by hand")


class BoneMapSettings(bpy.types.PropertyGroup):
    """The maps of a scene's rigs."""

    rigs: bpy.props.CollectionProperty(type=RigMap)


def stored_map(scene: bpy.types.Scene, obj: bpy.types.Object) -> BoneMap | None:
    """The map that was detected, loaded or edited for an armature object or for one it copies; None if none was."""
    rigs = scene.mocap_bone_map.rigs
    of_copies = (entry for entry in rigs if (other := scene.objects.get(entry.name)) and other.data == obj.data)
    rig_map = rigs.get(obj.name) or next(of_copies, None)
    return None if rig_map is None else map_from(rig_map)


def map_from(rig_map: RigMap) -> BoneMap:
    """The settings' entries as a map."""
    filled = [entry for entry in rig_map.roles if entry.bone]
    doubts = {entry.name: entry.confidence for entry in filled if entry.confidence < rig_map.confidence}
    bones = tuple((entry.name, entry.bone) for entry in filled)
    return BoneMap(bones, rig_map.source, rig_map.confidence, doubts)


def store_map(scene: bpy.types.Scene, obj: bpy.types.Object, bone_map: BoneMap) -> RigMap:
    """Keep a map for an armature object, over any it had, with an entry for each role and one more for the spine."""
    rigs = scene.mocap_bone_map.rigs
    rig_map = rigs.get(obj.name) or rigs.add()
    rig_map.name, rig_map.source, rig_map.confidence = obj.name, bone_map.source, bone_map.confidence
    rig_map.is_filling = True
    rig_map.roles.clear()
    for role in ROLES:
        bones = [bone for key, bone in bone_map.bones if key == role]
        for bone in [*bones, ""] if role == SPINE else bones or [""]:
            entry = rig_map.roles.add()
            entry.name, entry.bone = role, bone
            entry.confidence = bone_map.doubts.get(role, bone_map.confidence)
    rig_map.is_filling = False
    check_map(rig_map, obj)
    return rig_map


def check_map(rig_map: RigMap, obj: bpy.types.Object | None) -> None:
    """Note what is wrong with a map now."""
    rig_map.problems.clear()
    try:
        problems = find_problems(read_skeleton(obj), map_from(rig_map)) if obj else ()
    except UserError as error:
        entry = rig_map.problems.add()
        entry.message, entry.blocks = str(error), True
        return
    for problem in problems:
        entry = rig_map.problems.add()
        entry.message, entry.blocks = problem.message, problem.blocks
        entry.mend = problem.mend.label if problem.mend else ""
