"""Detecting, loading, mending and saving bone maps by the operators, as a user or a script would."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from .rig.rigs import BoneSpec, make_rig

SIDES = (("Left", 1.0), ("Right", -1.0))


def mixamo_rig(bpy: Any, prefix: str = "mixamorig:", name: str = "Character") -> Any:
    """An adult of Mixamo's names who faces -y."""
    bones = [BoneSpec("Hips", None, (0, 0, 0.95), (0, 0, 1.05))]
    parent, height = "Hips", 1.05
    for bone in ("Spine", "Spine1", "Spine2", "Neck", "Head"):
        bones.append(BoneSpec(bone, parent, (0, 0, height), (0, 0, height + 0.12)))
        parent, height = bone, height + 0.12
    for side, x in SIDES:
        bones += [
            BoneSpec(f"{side}UpLeg", "Hips", (0.1 * x, 0, 0.92), (0.1 * x, -0.01, 0.5)),
            BoneSpec(f"{side}Leg", f"{side}UpLeg", (0.1 * x, -0.01, 0.5), (0.1 * x, 0, 0.08)),
            BoneSpec(f"{side}Foot", f"{side}Leg", (0.1 * x, 0, 0.08), (0.1 * x, -0.12, 0.02)),
            BoneSpec(f"{side}ToeBase", f"{side}Foot", (0.1 * x, -0.12, 0.02), (0.1 * x, -0.2, 0.02)),
            BoneSpec(f"{side}Shoulder", "Spine2", (0.04 * x, 0, 1.38), (0.17 * x, 0, 1.4)),
            BoneSpec(f"{side}Arm", f"{side}Shoulder", (0.17 * x, 0, 1.4), (0.45 * x, 0, 1.4)),
            BoneSpec(f"{side}ForeArm", f"{side}Arm", (0.45 * x, 0, 1.4), (0.7 * x, 0, 1.4)),
            BoneSpec(f"{side}Hand", f"{side}ForeArm", (0.7 * x, 0, 1.4), (0.8 * x, 0, 1.4)),
        ]
    named = [BoneSpec(prefix + b.name, b.parent and prefix + b.parent, b.head, b.tail) for b in bones]
    obj = make_rig(bpy, named, name)
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    return obj


def stored(bpy: Any, name: str = "Character") -> dict[str, str]:
    """Roles and bones as the sidebar shows them; the spine's last entry is an empty one."""
    return {entry.name: entry.bone for entry in bpy.context.scene.mocap_bone_map.rigs[name].roles}


def entry_of(bpy: Any, role: str) -> Any:
    return next(e for e in bpy.context.scene.mocap_bone_map.rigs["Character"].roles if e.name == role)


def test_detecting_fills_the_list_and_leaves_the_rig_alone(bpy: Any) -> None:
    obj = mixamo_rig(bpy)
    before = (list(obj.keys()), list(obj.data.keys()), [b.matrix_local.copy() for b in obj.data.bones])
    assert bpy.ops.scene_aware_mocap.detect_bones() == {"FINISHED"}
    rig_map = bpy.context.scene.mocap_bone_map.rigs["Character"]
    assert rig_map.source.startswith("Mixamo")
    assert rig_map.confidence == 1.0
    assert stored(bpy)["hips"] == "mixamorig:Hips"
    assert stored(bpy)["left_shin"] == "mixamorig:LeftLeg"
    assert [e.bone for e in rig_map.roles if e.name == "spine"] == [
        "mixamorig:Spine",
        "mixamorig:Spine1",
        "mixamorig:Spine2",
        "",
    ]
    assert len(rig_map.problems) == 0
    assert (list(obj.keys()), list(obj.data.keys()), [b.matrix_local.copy() for b in obj.data.bones]) == before


def test_the_map_is_saved_with_the_file(bpy: Any, tmp_path: Path) -> None:
    mixamo_rig(bpy)
    bpy.ops.scene_aware_mocap.detect_bones(rig="Character")
    path = str(tmp_path / "scene.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert stored(bpy)["right_hand"] == "mixamorig:RightHand"


def test_an_edit_is_checked_at_once_and_its_mend_offered(bpy: Any) -> None:
    mixamo_rig(bpy)
    bpy.ops.scene_aware_mocap.detect_bones()
    entry_of(bpy, "left_shin").bone = ""
    rig_map = bpy.context.scene.mocap_bone_map.rigs["Character"]
    assert rig_map.source == "edited"
    [problem] = rig_map.problems
    assert problem.blocks
    assert "No bone for the left shin" in problem.message
    assert "between left thigh and left foot" in problem.message
    assert bpy.ops.scene_aware_mocap.mend_bone_map(mend=problem.mend) == {"FINISHED"}
    assert stored(bpy)["left_shin"] == "mixamorig:LeftLeg"
    assert len(rig_map.problems) == 0


def test_all_is_mended_when_nothing_is_said(bpy: Any) -> None:
    mixamo_rig(bpy)
    bpy.ops.scene_aware_mocap.detect_bones()
    whole = stored(bpy)
    entry_of(bpy, "left_shin").bone = ""
    entry_of(bpy, "right_forearm").bone = ""
    assert bpy.ops.scene_aware_mocap.mend_bone_map() == {"FINISHED"}
    assert stored(bpy) == whole
    with pytest.raises(RuntimeError, match="nothing to mend"):
        bpy.ops.scene_aware_mocap.mend_bone_map()


def test_a_saved_map_is_found_for_the_next_rig_with_such_names(bpy: Any, addon: Any) -> None:
    mixamo_rig(bpy)
    bpy.ops.scene_aware_mocap.detect_bones()
    entry_of(bpy, "head").bone = "mixamorig:Neck"
    entry_of(bpy, "neck").bone = ""
    assert bpy.ops.scene_aware_mocap.save_bone_map(title="Häßliche Köpfe") == {"FINISHED"}
    mixamo_rig(bpy, name="Next")
    assert bpy.ops.scene_aware_mocap.detect_bones(rig="Next") == {"FINISHED"}
    assert stored(bpy, "Next")["head"] == "mixamorig:Neck"
    assert bpy.context.scene.mocap_bone_map.rigs["Next"].source == "Häßliche Köpfe"
    [file] = list(addon("rig.maps").own_presets_folder().iterdir())
    file.unlink()


def test_a_preset_is_loaded_by_its_title(bpy: Any) -> None:
    mixamo_rig(bpy)
    assert bpy.ops.scene_aware_mocap.load_bone_map(preset="CMU (BVH, MakeHuman CMU)") == {"FINISHED"}
    assert stored(bpy)["hips"] == "mixamorig:Hips"
    assert bpy.context.scene.mocap_bone_map.rigs["Character"].source.startswith("CMU")


def test_the_map_of_a_vrm_file_is_loaded(bpy: Any, shared_data: Path) -> None:
    mixamo_rig(bpy)
    path = str(shared_data / "rigs" / "mh_vrm1.vrm")
    assert bpy.ops.scene_aware_mocap.load_vrm_map(filepath=path) == {"FINISHED"}
    assert stored(bpy)["left_thigh"] == "mixamorig:LeftUpLeg"
    assert bpy.context.scene.mocap_bone_map.rigs["Character"].source == "the file's own map"


@pytest.mark.parametrize(
    ("operator", "settings", "match"),
    [
        ("detect_bones", {"rig": "Nobody"}, "no object 'Nobody'"),
        ("load_bone_map", {"preset": "Klingon"}, "no bone map 'Klingon'.*'Mixamo"),
        ("load_bone_map", {"preset": "Rigify, deforming bones"}, "none of the bones"),
        ("load_vrm_map", {"filepath": "/nowhere/x.vrm"}, "cannot read"),
        ("mend_bone_map", {}, "no bone map yet: detect"),
        ("save_bone_map", {"title": "Mine"}, "no bone map yet: detect"),
    ],
)
def test_what_cannot_be_done_is_said(bpy: Any, operator: str, settings: dict[str, str], match: str) -> None:
    mixamo_rig(bpy)
    with pytest.raises(RuntimeError, match=match):
        getattr(bpy.ops.scene_aware_mocap, operator)(**settings)
    assert len(bpy.context.scene.mocap_bone_map.rigs) == 0


def test_a_rig_that_is_no_humanoid_is_refused(bpy: Any) -> None:
    chair = [BoneSpec("seat", None, (0, 0, 0.5), (0, 0, 0.6)), BoneSpec("back", "seat", (0, 0.3, 0.5), (0, 0.3, 1))]
    chair += [BoneSpec(f"leg{n}", "seat", (x, y, 0.5), (x, y, 0)) for n, (x, y) in enumerate(np.ndindex(2, 2))]
    obj = make_rig(bpy, chair)
    bpy.context.view_layer.objects.active = obj
    with pytest.raises(RuntimeError, match="no two chains of bones that could be legs"):
        bpy.ops.scene_aware_mocap.detect_bones()
    assert len(bpy.context.scene.mocap_bone_map.rigs) == 0


def test_without_an_armature_one_is_asked_for(bpy: Any) -> None:
    with pytest.raises(RuntimeError, match="choose the character's armature"):
        bpy.ops.scene_aware_mocap.detect_bones()


def test_retargeting_uses_the_users_map_and_refuses_a_broken_one(bpy: Any, addon: Any) -> None:
    from core_solver.errors import UserError

    obj = mixamo_rig(bpy)
    map_of = addon("rig.maps").map_of
    assert map_of(bpy.context, obj, "fk").source.startswith("Mixamo")
    bpy.ops.scene_aware_mocap.detect_bones()
    entry_of(bpy, "left_toe").bone = ""
    assert map_of(bpy.context, obj, "fk").source == "edited"
    assert map_of(bpy.context, obj, "fk").bone("left_toe") is None
    entry_of(bpy, "left_foot").bone = ""
    with pytest.raises(UserError, match="'Character' needs mending: No bone for the left foot"):
        map_of(bpy.context, obj, "fk")


def test_copies_of_a_rig_share_its_map(bpy: Any, addon: Any) -> None:
    obj = mixamo_rig(bpy)
    bpy.ops.scene_aware_mocap.detect_bones()
    entry_of(bpy, "left_toe").bone = ""
    copy = obj.copy()
    bpy.context.scene.collection.objects.link(copy)
    other = mixamo_rig(bpy, name="Other")
    map_of = addon("rig.maps").map_of
    assert map_of(bpy.context, copy, "fk").bone("left_toe") is None
    assert map_of(bpy.context, other, "fk").bone("left_toe") == "mixamorig:LeftToeBase"


def test_a_damaged_preset_of_the_user_is_told_and_passed_over(
    bpy: Any, addon: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    mixamo_rig(bpy)
    folder = addon("rig.maps").own_presets_folder()
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "mine.json").write_text("{")
    try:
        assert bpy.ops.scene_aware_mocap.detect_bones() == {"FINISHED"}
    finally:
        (folder / "mine.json").unlink()
    assert "Warning: mine.json is no bone map: it is not valid JSON" in capfd.readouterr().out
    assert bpy.context.scene.mocap_bone_map.rigs["Character"].confidence == 1.0


@pytest.mark.parametrize("version", ["0.0", "1.0"])
def test_the_map_kept_by_the_vrm_add_on_comes_first(bpy: Any, addon: Any, version: str) -> None:
    obj = mixamo_rig(bpy)
    humans = {human: f"mixamorig:{bone}" for human, bone in VRM_OF_MIXAMO.items()}
    humans["head"] = "mixamorig:Neck"
    keep_as_vrm(bpy, obj, version, humans)
    try:
        found = addon("rig.maps").map_of(bpy.context, obj, "fk")
    finally:
        del bpy.types.Armature.vrm_addon_extension
    assert found.source == "the file's own map"
    assert found.bone("head") == "mixamorig:Neck"
    assert found.spine == ("mixamorig:Spine", "mixamorig:Spine1")


VRM_OF_MIXAMO = {
    "hips": "Hips", "spine": "Spine", "chest": "Spine1",
    **{f"{side.lower()}{human}": f"{side}{bone}" for side, _ in SIDES for human, bone in (
        ("UpperArm", "Arm"), ("LowerArm", "ForeArm"), ("Hand", "Hand"),
        ("UpperLeg", "UpLeg"), ("LowerLeg", "Leg"), ("Foot", "Foot"),
    )},
}  # fmt: skip


def keep_as_vrm(bpy: Any, obj: Any, version: str, humans: dict[str, str]) -> None:
    """Lay the humanoid map where the VRM add-on lays it: the layout of its property groups, version 0.x and 1.0."""
    import re

    all_humans = {
        **dict.fromkeys(("upperChest", "neck", "leftShoulder", "rightShoulder", "leftToes", "rightToes"), ""),
        **humans,
    }
    snake = {human: re.sub("([A-Z])", r"_\1", human).lower() for human in all_humans}
    pointer, text, props = bpy.props.PointerProperty, bpy.props.StringProperty, bpy.types.PropertyGroup

    def group(name: str, **members: Any) -> type:
        cls = type(name, (props,), {"__annotations__": members})
        bpy.utils.register_class(cls)
        return cls

    node = group("TestVrmNode", bone_name=text())
    entry0 = group("TestVrm0Bone", bone=text(), node=pointer(type=node))
    humanoid0 = group("TestVrm0Humanoid", human_bones=bpy.props.CollectionProperty(type=entry0))
    entry1 = group("TestVrm1Bone", node=pointer(type=node))
    bones1 = group("TestVrm1Bones", **{name: pointer(type=entry1) for name in snake.values()})
    humanoid1 = group("TestVrm1Humanoid", human_bones=pointer(type=bones1))
    extension = group(
        "TestVrmExtension",
        spec_version=text(),
        vrm0=pointer(type=group("TestVrm0", humanoid=pointer(type=humanoid0))),
        vrm1=pointer(type=group("TestVrm1", humanoid=pointer(type=humanoid1))),
    )
    bpy.types.Armature.vrm_addon_extension = pointer(type=extension)
    data = obj.data.vrm_addon_extension
    data.spec_version = version
    for human, bone in humans.items():
        if version == "0.0":
            entry = data.vrm0.humanoid.human_bones.add()
            entry.bone, entry.node.bone_name = human, bone
        else:
            getattr(data.vrm1.humanoid.human_bones, snake[human]).node.bone_name = bone
