"""Presets: those that come with the extension, files of users, and what becomes of them on a rig."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.geometry import Similarity

from .skeletons import Build, make_rig

LIMBS = ("clavicle", "upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe")

# Bones of known skeletons, as their makers call them: hips, spine, neck, head, then the left limbs.
KNOWN = {
    "Unreal Engine 5": (
        "pelvis", [f"spine_0{n}" for n in range(1, 6)], "neck_01", "head",
        ["clavicle_l", "upperarm_l", "lowerarm_l", "hand_l", "thigh_l", "calf_l", "foot_l", "ball_l"], ("_l", "_r"),
    ),
    "Unreal Engine 4, MakeHuman game engine": (
        "pelvis", [f"spine_0{n}" for n in range(1, 4)], "neck_01", "head",
        ["clavicle_l", "upperarm_l", "lowerarm_l", "hand_l", "thigh_l", "calf_l", "foot_l", "ball_l"], ("_l", "_r"),
    ),
    "Mixamo, Ready Player Me": (
        "Hips", ["Spine", "Spine1", "Spine2"], "Neck", "Head",
        ["LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"],
        ("Left", "Right"),
    ),
    "Unity Humanoid": (
        "Hips", ["Spine", "Chest", "UpperChest"], "Neck", "Head",
        ["LeftShoulder", "LeftUpperArm", "LeftLowerArm", "LeftHand", "LeftUpperLeg", "LeftLowerLeg", "LeftFoot",
         "LeftToes"], ("Left", "Right"),
    ),
    "VRM (VRoid names)": (
        "J_Bip_C_Hips", ["J_Bip_C_Spine", "J_Bip_C_Chest", "J_Bip_C_UpperChest"], "J_Bip_C_Neck", "J_Bip_C_Head",
        [f"J_Bip_L_{bone}" for bone in (
            "Shoulder", "UpperArm", "LowerArm", "Hand", "UpperLeg", "LowerLeg", "Foot", "ToeBase")],
        ("_L_", "_R_"),
    ),
    "CMU (ASF/AMC)": (
        "root", ["lowerback", "upperback", "thorax"], "lowerneck", "head",
        ["lclavicle", "lhumerus", "lradius", "lwrist", "lfemur", "ltibia", "lfoot", "ltoes"], None,
    ),
    "BVH (joint names)": (
        "Hips", ["Chest", "Chest2"], "Neck", "Head",
        [f"Left{joint}" for joint in ("Collar", "Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle", "Toe")],
        ("Left", "Right"),
    ),
    "Character Creator, iClone": (
        "CC_Base_Hip", ["CC_Base_Waist", "CC_Base_Spine01", "CC_Base_Spine02"], "CC_Base_NeckTwist01", "CC_Base_Head",
        [f"CC_Base_L_{n}" for n in ("Clavicle", "Upperarm", "Forearm", "Hand", "Thigh", "Calf", "Foot", "ToeBase")],
        ("_L_", "_R_"),
    ),
    "3ds Max Biped": (
        "Bip01 Pelvis", ["Bip01 Spine", "Bip01 Spine1"], "Bip01 Neck", "Bip01 Head",
        [f"Bip01 L {n}" for n in ("Clavicle", "UpperArm", "Forearm", "Hand", "Thigh", "Calf", "Foot", "Toe0")],
        (" L ", " R "),
    ),
    "SMPL": (
        "pelvis", ["spine1", "spine2", "spine3"], "neck", "head",
        [f"left_{joint}" for joint in ("collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot")],
        ("left", "right"),
    ),
}  # fmt: skip


def truth_of(title: str) -> dict[str, Any]:
    hips, spine, neck, head, left, swap = KNOWN[title]
    roles = {"hips": hips, "spine": tuple(spine), "neck": neck, "head": head}
    for limb, bone in zip(LIMBS, left, strict=True):
        roles[f"left_{limb}"] = bone
        roles[f"right_{limb}"] = bone.replace(*swap) if swap else "r" + bone[1:]
    return roles


def renamed_rig(addon: Any, roles: dict[str, Any]) -> Any:
    """The synthetic adult under other names."""
    rig = make_rig(addon, Build(spine=len(roles["spine"]), arms_down=0.5))
    names = {bone: roles[role] for role, bone in rig.bone_map.bones if role != "spine"}
    names |= dict(zip(rig.bone_map.spine, roles["spine"], strict=True))
    return replace_names(rig.skeleton, tuple(names[name] for name in rig.skeleton.names))


def replace_names(skeleton: Any, names: tuple[str, ...]) -> Any:
    from dataclasses import replace

    return replace(skeleton, names=names)


def nameless(addon: Any, names: tuple[str, ...]) -> Any:
    """Bones of which only the names matter."""
    return addon("retarget.skeleton").Skeleton(
        names, (-1,) * len(names), np.zeros((len(names), 3)), np.tile(np.eye(3), (len(names), 1, 1)),
        np.ones(len(names)), Similarity(np.eye(3), np.zeros(3)), np.ones(len(names), bool),
    )  # fmt: skip


def preset(addon: Any, title: str) -> Any:
    return next(p for p in addon("retarget.presets").built_in_presets() if p.title == title)


@pytest.mark.parametrize("title", KNOWN)
def test_known_skeletons_are_found_by_their_own_preset(addon: Any, title: str) -> None:
    truth = truth_of(title)
    found = addon("retarget.finding").find_map(renamed_rig(addon, truth), addon("retarget.presets").built_in_presets())
    assert found.source == title
    assert found.confidence == 1.0
    assert {r: b for r, b in found.bones if r != "spine"} | {"spine": found.spine} == truth


def test_all_presets_that_come_along_are_whole(addon: Any) -> None:
    module = addon("retarget.presets")
    presets, problems = module.read_presets(module.BUILT_IN)
    assert problems == ()
    assert len(presets) >= 15
    assert len({p.title for p in presets}) == len(presets)
    needed = set(addon("retarget.roles").NEEDED)
    assert all(needed <= set(p.roles) for p in presets)


def test_the_takes_own_names_give_the_takes_own_map(addon: Any) -> None:
    from core_solver.take import JOINT_NAMES

    take_map = addon("retarget.bone_map").TAKE_MAP
    found = addon("retarget.presets").matched(preset(addon, "SMPL"), nameless(addon, JOINT_NAMES))
    assert set(found.bones) == set(take_map.bones)
    assert found.spine == take_map.spine


def test_three_roots_twists_and_helpers_do_not_confuse_names(addon: Any) -> None:
    truth = truth_of("Unreal Engine 5")
    names = ("root", "ik_foot_root", "ik_foot_l", "ik_hand_root", "ik_hand_gun", "neck_02", "upperarm_twist_01_l")
    names += tuple(b for bones in truth.values() for b in (bones if isinstance(bones, tuple) else (bones,)))
    found = addon("retarget.presets").matched(preset(addon, "Unreal Engine 5"), nameless(addon, names))
    assert {r: b for r, b in found.bones if r != "spine"} | {"spine": found.spine} == truth | {"root": "root"}


def test_a_saved_map_is_read_back_as_it_was(addon: Any, tmp_path: Path) -> None:
    module = addon("retarget.presets")
    rig = make_rig(addon, Build(rolls=1))
    path = module.save_preset(tmp_path / "maps", "Größe {s} 7/8", rig.bone_map)
    assert path.parent == tmp_path / "maps"
    found = module.matched(module.read_preset(path), rig.skeleton)
    assert set(found.bones) == set(rig.bone_map.bones)
    assert found.spine == rig.bone_map.spine
    assert found.source == "Größe {s} 7/8"
    assert [file.name for file in path.parent.iterdir()] == [path.name]


def test_a_user_s_file_with_exact_names_beats_the_spelling(addon: Any) -> None:
    module = addon("retarget.presets")
    odd = module.Preset("Odd", {"hips": ("hips",), "head": ("HIPS",)})
    found = module.matched(odd, nameless(addon, ("HIPS", "hips")))
    assert dict(found.bones) == {"hips": "hips", "head": "HIPS"}


def test_no_bone_plays_two_roles(addon: Any) -> None:
    module = addon("retarget.presets")
    greedy = module.Preset("Greedy", {"hips": ("a",), "head": ("a", "b")})
    assert dict(module.matched(greedy, nameless(addon, ("a", "b"))).bones) == {"hips": "a", "head": "b"}


@pytest.mark.parametrize(
    ("content", "match"),
    [
        ("{", "not valid JSON"),
        (b"\xff\xfe", "not valid JSON"),
        ("[]", "no title"),
        ('{"title": 3, "roles": {}}', "no title"),
        ('{"title": "x", "roles": {}}', "no roles"),
        ('{"title": "x", "roles": {"tail": ["a"]}}', "no role 'tail'"),
        ('{"title": "x", "roles": {"hips": "a"}}', "names of 'hips'"),
        ('{"title": "x", "priority": "high", "roles": {"hips": ["a"]}}', "priority"),
    ],
)
def test_files_that_are_no_presets_are_refused_and_passed_over(
    addon: Any, tmp_path: Path, content: str | bytes, match: str
) -> None:
    module = addon("retarget.presets")
    path = tmp_path / "mine.json"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(UserError, match=f"^mine.json is no bone map: .*{match}"):
        module.read_preset(path)
    (tmp_path / "good.json").write_text(json.dumps({"title": "Good", "roles": {"hips": ["a"]}}))
    presets, problems = module.read_presets(tmp_path)
    assert [p.title for p in presets] == ["Good"]
    assert len(problems) == 1


def test_a_folder_that_cannot_be_written_is_told(addon: Any, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(UserError, match="cannot write the bone map"):
        addon("retarget.presets").save_preset(tmp_path / "file", "x", make_rig(addon, Build()).bone_map)
    with pytest.raises(UserError, match="needs a name"):
        addon("retarget.presets").save_preset(tmp_path, " /", make_rig(addon, Build()).bone_map)
