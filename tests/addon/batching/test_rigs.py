"""Characters from files of all kinds, ready to be moved."""

from pathlib import Path
from typing import Any

import pytest

from core_solver.errors import UserError


@pytest.fixture
def sample_rig(repo_root: Path) -> Path:
    return repo_root / "blender_addon" / "samples" / "sample_rig.glb"


def converted(bpy: Any, rig: Path, ending: str, folder: Path) -> Path:
    """The sample rig in another format, with a motion of its own."""
    bpy.ops.import_scene.gltf(filepath=str(rig), bone_heuristic="TEMPERANCE")
    armature = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    bone = armature.pose.bones[0]
    for frame, angle in ((1, 0.2), (9, 0.9)):
        bone.rotation_mode = "XYZ"
        bone.rotation_euler.x = angle
        bone.keyframe_insert("rotation_euler", frame=frame)
    path = folder / f"персонаж 1{ending}"
    if ending == ".fbx":
        bpy.ops.export_scene.fbx(filepath=str(path), add_leaf_bones=False)
    elif ending == ".blend":
        bpy.ops.wm.save_as_mainfile(filepath=str(path), copy=True)
    elif ending == ".gltf":
        bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLTF_SEPARATE")
    else:
        bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB")
    bpy.ops.wm.read_homefile(use_empty=True)
    return path


@pytest.mark.parametrize("ending", [".glb", ".gltf", ".fbx", ".blend"])
def test_a_character_comes_in_still_with_its_bones_known(
    ending: str, sample_rig: Path, bpy: Any, addon: Any, tmp_path: Path
) -> None:
    path = converted(bpy, sample_rig, ending, tmp_path)
    character = addon("batching.rigs").load_character(bpy.context, path, "auto")
    assert character.armature.name in bpy.context.scene.objects
    animation = character.armature.animation_data
    assert animation is None or (animation.action is None and not animation.nla_tracks)
    assert all(abs(bone.matrix_basis.to_euler().x) < 1e-6 for bone in character.armature.pose.bones)
    needed = addon("retarget.roles").NEEDED
    assert all(character.bone_map.bone(role) in character.armature.data.bones for role in needed)
    assert [obj for obj in bpy.context.scene.objects if obj.type == "MESH"]


def test_a_vrm_file_brings_its_own_map(shared_data: Path, bpy: Any, addon: Any) -> None:
    character = addon("batching.rigs").load_character(bpy.context, shared_data / "rigs" / "mh_vrm1.vrm", "auto")
    assert "own map" in character.bone_map.source or "VRM" in character.bone_map.source
    assert character.bone_map.bone("hips") in character.armature.data.bones


def test_a_preset_can_be_named(sample_rig: Path, bpy: Any, addon: Any) -> None:
    presets = addon("retarget.presets").built_in_presets()
    character = addon("batching.rigs").load_character(bpy.context, sample_rig, presets[0].title)
    assert character.bone_map.source == presets[0].title


@pytest.mark.parametrize("kind", ["no armature", "text"])
def test_files_without_a_character_are_refused(kind: str, bpy: Any, addon: Any, tmp_path: Path) -> None:
    path = tmp_path / "thing.glb"
    if kind == "text":
        path.write_text("text")
    else:
        bpy.ops.mesh.primitive_cube_add()
        bpy.ops.export_scene.gltf(filepath=str(path), export_format="GLB")
        bpy.ops.wm.read_homefile(use_empty=True)
    with pytest.raises(UserError, match=r"thing\.glb"):
        addon("batching.rigs").load_character(bpy.context, path, "auto")
