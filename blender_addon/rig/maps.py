# SPDX-License-Identifier: GPL-3.0-or-later
"""The bone map of an armature of the scene: chosen by the user, stored with the rig by its makers, or found."""

import re
from pathlib import Path
from typing import Any

import bpy

from core_solver.errors import UserError

from ..retarget.bone_map import TAKE_MAP, BoneMap
from ..retarget.finding import find_map
from ..retarget.options import Drive
from ..retarget.presets import Preset, built_in_presets, coverage, read_presets
from ..retarget.skeleton import Skeleton
from ..retarget.structure import NotHumanoidError
from ..retarget.validation import find_problems
from ..retarget.vrm import ROLE_OF_HUMAN_BONE, map_of_human_bones
from ..settings.bone_map import stored_map
from .reading import read_skeleton

_PACKAGE = str(__package__).rpartition(".")[0]
_OTHER_CONTROLS = {"fk": "Rigify, IK controls", "ik": "Rigify, FK controls"}


def map_of(context: bpy.types.Context, obj: bpy.types.Object, drive: Drive) -> BoneMap:
    """The roles of a rig's bones: those the user chose in this scene, else what is found.

    Args:
        context: of the scene.
        obj: an armature object.
        drive: which controls are meant on a rig that has both kinds.

    Raises:
        UserError: the rig is no humanoid, or cannot be read, or the user's map is not complete.
    """
    skeleton = read_skeleton(obj)
    chosen = stored_map(context.scene, obj)
    if chosen is None or chosen.source == _OTHER_CONTROLS[drive]:
        return found_map(obj, skeleton, drive)
    worst = next((problem for problem in find_problems(skeleton, chosen) if problem.blocks), None)
    if worst is not None:
        raise UserError(f"the bone map of '{obj.name}' needs mending: {worst.message}")
    return chosen


def found_map(obj: bpy.types.Object, skeleton: Skeleton, drive: Drive = "fk") -> BoneMap:
    """What a rig itself tells: its makers' own map, names of well-known rigs, or its shape.

    Args:
        obj: an armature object.
        skeleton: the same one, read by `read_skeleton`.
        drive: as in `map_of`.

    Raises:
        UserError: the rig is no humanoid.
    """
    presets = [preset for preset in all_presets() if preset.title != _OTHER_CONTROLS[drive]]
    try:
        return find_map(skeleton, presets, _own_map(obj))
    except NotHumanoidError as error:
        raise NotHumanoidError(f"'{obj.name}': {error}") from error


def all_presets() -> tuple[Preset, ...]:
    """The user's presets, then the extension's; one of the user's hides the extension's of the same title."""
    own, _ = read_presets(own_presets_folder())
    titles = {preset.title for preset in own}
    return own + tuple(preset for preset in built_in_presets() if preset.title not in titles)


def damaged_presets() -> tuple[str, ...]:
    """What is wrong with files among the user's presets that cannot be used."""
    return read_presets(own_presets_folder())[1]


def own_presets_folder() -> Path:
    """Where the user's presets are kept; it need not exist yet."""
    if _PACKAGE.startswith("bl_ext."):
        return Path(bpy.utils.extension_path_user(_PACKAGE, path="bone_maps"))
    # Run from its sources, as batches may be, the add-on has no folder of an extension's.
    return Path(bpy.utils.user_resource("DATAFILES", path="scene_aware_mocap")) / "bone_maps"


def _own_map(obj: Any) -> BoneMap | None:
    """The map that came with an armature: of a take's person, or of a character made as VRM."""
    if all(bone in obj.data.bones for _, bone in TAKE_MAP.bones):
        return TAKE_MAP
    bone_map = map_of_human_bones(_vrm_human_bones(obj.data))
    return bone_map if coverage(bone_map) == 1 else None


def _vrm_human_bones(armature: Any) -> dict[str, str]:
    """VRM's human bones as the VRM add-on keeps them on the armature; none when that add-on is not there."""
    data = getattr(armature, "vrm_addon_extension", None)
    if data is None:
        return {}
    if str(data.spec_version).startswith("0"):
        return {entry.bone: entry.node.bone_name for entry in data.vrm0.humanoid.human_bones}
    bones = data.vrm1.humanoid.human_bones
    return {human: getattr(bones, _in_snake_case(human)).node.bone_name for human in ROLE_OF_HUMAN_BONE}


def _in_snake_case(name: str) -> str:
    return re.sub(r"[A-Z]", lambda capital: f"_{capital[0].lower()}", name)
