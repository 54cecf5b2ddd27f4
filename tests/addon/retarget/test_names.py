"""Names of bones in the spellings of many programs."""

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

SAME = [
    ["LeftUpLeg", "left_up_leg", "UpLeg.L", "upleg_l", "L UpLeg", "mixamorig:LeftUpLeg", "Group|rig:Left-Up-Leg"],
    ["upper_arm.R", "UpperArm_R", "rUpperArm", "R_upper_arm", "RightUpperArm", "rightupperarm"],
    ["spine_01", "Spine1", "spine.001", "spine 1"],
    ["LHipJoint", "l_hip_joint", "HipJoint.L"],
]


@pytest.mark.parametrize("spellings", SAME, ids=lambda names: names[0])
def test_spellings_of_one_name(addon: Any, spellings: list[str]) -> None:
    assert len({addon("retarget.names").canonical(name) for name in spellings}) == 1


def test_different_bones_stay_different(addon: Any) -> None:
    names = [
        "LeftArm",
        "RightArm",
        "LeftForeArm",
        "DEF-arm.L",
        "DEF-arm.L.001",
        "spine",
        "spine_02",
        "spine_20",
        "腕.L",
    ]
    assert len({addon("retarget.names").canonical(name) for name in names}) == len(names)


@given(st.lists(st.text(max_size=20), max_size=10))
def test_any_text_is_a_name(addon: Any, names: list[str]) -> None:
    for reading in addon("retarget.names").readings(names):
        assert set(reading.values()) <= set(names)


@pytest.mark.parametrize(
    "spelling",
    ["{}", "mixamorig:{}", "mixamorig1:{}", "mixamorig_{}", "mixamorig{}", "Armature|mixamorig:{}", "Hero_Rig_{}"],
)
def test_prefixes_say_nothing(addon: Any, spelling: str) -> None:
    bones = ["Hips", "Spine", "Neck", "Head", "LeftArm", "RightArm", "LeftUpLeg"]
    readings = addon("retarget.names").readings([spelling.format(bone) for bone in bones])
    canonical = addon("retarget.names").canonical
    assert any(all(canonical(bone) in reading for bone in bones) for reading in readings)


def test_running_numbers_say_nothing(addon: Any) -> None:
    bones = ["Hips", "Spine", "Spine1", "LeftArm", "RightArm"]
    numbered = [f"mixamorig:{bone}_{number:02d}" for number, bone in enumerate(bones, start=7)]
    canonical = addon("retarget.names").canonical
    reading = next(r for r in addon("retarget.names").readings(numbered) if canonical("Hips") in r)
    assert {reading[canonical(bone)] for bone in bones} == set(numbered)
