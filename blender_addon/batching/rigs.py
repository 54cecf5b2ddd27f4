# SPDX-License-Identifier: GPL-3.0-or-later
"""A character from its file into the scene, and which of its bones is which."""

import shutil
import tempfile
from dataclasses import dataclass
from pathlib import Path

import bpy

from core_solver.errors import UserError

from ..retarget.bone_map import BoneMap
from ..retarget.finding import find_map, map_by_preset
from ..retarget.presets import built_in_presets
from ..retarget.vrm import read_vrm_map
from ..rig.reading import read_skeleton
from .request import AUTO


@dataclass(frozen=True)
class Character:
    """A rig in the scene.

    Attributes:
        armature: its object.
        bone_map: which bone is which.
    """

    armature: bpy.types.Object
    bone_map: BoneMap


def load_character(context: bpy.types.Context, path: Path, bone_map: str) -> Character:
    """Bring a character's file into the scene; the armature with the most bones is the character's.

    Args:
        context: Blender's.
        path: .glb, .gltf, .vrm, .fbx or .blend.
        bone_map: `AUTO`, or the title of a preset.

    Raises:
        UserError: it cannot be read, has no armature, or no humanoid one.
    """
    before = set(context.scene.objects)
    try:
        _load(context, path)
    except (OSError, RuntimeError) as error:
        raise UserError(f"cannot read the rig {path.name}: {str(error).strip().splitlines()[-1]}") from error
    armatures = [obj for obj in context.scene.objects if obj.type == "ARMATURE" and obj not in before]
    if not armatures:
        raise UserError(f"there is no armature in {path.name}: choose a file with a rigged character")
    armature = max(armatures, key=lambda obj: len(obj.data.bones))
    _still(armature)
    return Character(armature, _map_of(armature, path, bone_map))


def _load(context: bpy.types.Context, path: Path) -> None:
    ending = path.suffix.lower()
    if ending == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(path))
    elif ending == ".blend":
        _append(context, path)
    elif ending == ".vrm":
        # A VRM is a GLB with more in it; Blender's importer goes by the name.
        with tempfile.TemporaryDirectory() as folder:
            copy = shutil.copy(path, Path(folder) / f"{path.stem}.glb")
            _import_gltf(Path(copy))
    else:
        _import_gltf(path)


def _import_gltf(path: Path) -> None:
    # Other ways of guessing bones bring a stray sphere along.
    bpy.ops.import_scene.gltf(filepath=str(path), bone_heuristic="TEMPERANCE")


def _append(context: bpy.types.Context, path: Path) -> None:
    with bpy.data.libraries.load(str(path)) as (there, wanted):
        wanted.objects = there.objects
    for obj in wanted.objects:
        if obj is not None:
            context.scene.collection.objects.link(obj)


def _still(armature: bpy.types.Object) -> None:
    """Take away the motion that came with the file; drivers stay, they belong to the rig."""
    animation = armature.animation_data
    if animation is None:
        return
    animation.action = None
    for track in list(animation.nla_tracks):
        animation.nla_tracks.remove(track)
    for bone in armature.pose.bones:
        bone.matrix_basis.identity()


def _map_of(armature: bpy.types.Object, path: Path, title: str) -> BoneMap:
    skeleton = read_skeleton(armature)
    presets = built_in_presets()
    if title != AUTO:
        return map_by_preset(skeleton, next(preset for preset in presets if preset.title == title))
    own = None
    if path.suffix.lower() == ".vrm":
        own = read_vrm_map(path)
    return find_map(skeleton, presets, own)
