"""Real rigs of many makers: their bones are found with no help, by name and by shape alone."""

import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .truths import METARIG, OF_FILES, RIGIFY_FK

NEEDED = (
    "hips", "head",
    *(f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "forearm", "thigh", "shin", "foot")),
)  # fmt: skip


def imported(bpy: Any, path: Path, folder: Path) -> Any:
    """The armature of a rig's file."""
    if path.suffix == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(path))
    else:
        # Blender imports VRM files once they are called GLB.
        copy = folder / f"{path.stem}.glb"
        shutil.copyfile(path, copy)
        bpy.ops.import_scene.gltf(filepath=str(copy), bone_heuristic="TEMPERANCE")
    return next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")


def roles_of(bone_map: Any) -> dict[str, Any]:
    return {role: bone for role, bone in bone_map.bones if role != "spine"} | {"spine": bone_map.spine}


def scrambled(skeleton: Any) -> Any:
    """The same rig with names that say nothing, in the same order."""
    return replace(skeleton, names=tuple(f"bone_{number:03d}" for number in range(len(skeleton.names))))


def in_old_names(skeleton: Any, bone_map: Any) -> Any:
    return replace(bone_map, bones=tuple((r, skeleton.names[int(b.removeprefix("bone_"))]) for r, b in bone_map.bones))


@pytest.mark.parametrize("file", OF_FILES)
def test_rigs_from_files(bpy: Any, addon: Any, shared_data: Path, tmp_path: Path, file: str) -> None:
    obj = imported(bpy, shared_data / "rigs" / file, tmp_path)
    found = addon("rig.maps").map_of(bpy.context, obj, "fk")
    assert roles_of(found) == OF_FILES[file]
    skeleton = addon("rig.reading").read_skeleton(obj)
    assert addon("retarget.validation").find_problems(skeleton, found) == ()
    by_shape = addon("retarget.finding").find_map(scrambled(skeleton), addon("retarget.presets").built_in_presets())
    assert by_shape.source == "structure"
    assert roles_of(in_old_names(skeleton, by_shape)) == OF_FILES[file]


@pytest.mark.parametrize("degrees", [90, 180, 237])
@pytest.mark.parametrize("file", ["mh_cmu_mb.glb", "mannequiny-0.3.0.glb", "RobotExpressive.glb", "mh_default.fbx"])
def test_rigs_that_face_any_way(
    bpy: Any, addon: Any, shared_data: Path, tmp_path: Path, file: str, degrees: int
) -> None:
    obj = imported(bpy, shared_data / "rigs" / file, tmp_path)
    turn = bpy.data.objects.new("Turn", None)
    bpy.context.scene.collection.objects.link(turn)
    turn.rotation_euler.z = np.radians(degrees)
    top = obj
    while top.parent:
        top = top.parent
    top.parent = turn
    skeleton = addon("rig.reading").read_skeleton(obj)
    by_shape = addon("retarget.structure").find_by_structure(scrambled(skeleton))
    assert roles_of(in_old_names(skeleton, by_shape)) == OF_FILES[file]


def test_the_human_metarig(bpy: Any, addon: Any, rigify_file: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    obj = bpy.data.objects["Metarig"]
    assert roles_of(addon("rig.maps").map_of(bpy.context, obj, "fk")) == METARIG
    skeleton = addon("rig.reading").read_skeleton(obj)
    by_shape = addon("retarget.structure").find_by_structure(scrambled(skeleton))
    assert roles_of(in_old_names(skeleton, by_shape)) == METARIG


def test_a_generated_rigify_rig(bpy: Any, addon: Any, rigify_file: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    obj = bpy.data.objects["Generated"]
    maps = addon("rig.maps")
    assert roles_of(maps.map_of(bpy.context, obj, "fk")) == RIGIFY_FK
    by_ik = roles_of(maps.map_of(bpy.context, obj, "ik"))
    assert by_ik["left_hand"] == "hand_ik.L"
    assert by_ik["right_foot"] == "foot_ik.R"
    assert by_ik["hips"] == "torso"


def test_the_shape_of_a_generated_rigify_rig(bpy: Any, addon: Any, rigify_file: Path) -> None:
    """Of its many bones in the same places any may be found, but each joint where it is."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    skeleton = addon("rig.reading").read_skeleton(bpy.data.objects["Generated"])
    by_shape = in_old_names(skeleton, addon("retarget.structure").find_by_structure(scrambled(skeleton)))
    for role in NEEDED[1:]:
        there, truth = (skeleton.heads[skeleton.index(b)] for b in (by_shape.bone(role), RIGIFY_FK[role]))
        np.testing.assert_allclose(there, truth, atol=0.005, err_msg=role)
    assert by_shape.bone("hips") == "torso"
