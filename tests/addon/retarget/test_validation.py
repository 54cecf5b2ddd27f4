"""Faulty bone maps: what is said about them, and that the mend mends."""

from dataclasses import replace
from typing import Any

import pytest

from .skeletons import RIGS, Build, make_rig
from .test_structure import shuffled_names


def problems(addon: Any, rig: Any, bones: dict[str, str | None], spine: tuple[str, ...] | None = None) -> Any:
    """What is wrong with a rig's true map after some changes, and the changed map."""
    true = {role: bone for role, bone in rig.bone_map.bones if role != "spine"}
    pairs = [(role, bone) for role, bone in {**true, **bones}.items() if bone]
    pairs += [("spine", bone) for bone in (spine or rig.bone_map.spine)]
    changed = addon("retarget.bone_map").BoneMap(tuple(pairs))
    return addon("retarget.validation").find_problems(rig.skeleton, changed), changed


def mended(addon: Any, rig: Any, found: Any, changed: Any) -> Any:
    """The map after the first mend that is offered."""
    mend = next(problem.mend for problem in found if problem.mend)
    after = replace(changed, bones=mend.bones)
    assert addon("retarget.validation").find_problems(rig.skeleton, after) == ()
    return after


def same(one: Any, other: Any) -> bool:
    return set(one.bones) == set(other.bones) and one.spine == other.spine


@pytest.mark.parametrize("build", RIGS.values(), ids=RIGS)
def test_nothing_is_wrong_with_true_maps(addon: Any, build: Build) -> None:
    rig = make_rig(addon, build)
    assert addon("retarget.validation").find_problems(rig.skeleton, rig.bone_map) == ()


@pytest.mark.parametrize("role", ["left_shin", "right_forearm", "left_foot", "hips", "head", "right_thigh"])
def test_a_missing_bone_is_named_and_found(addon: Any, role: str) -> None:
    rig = make_rig(addon, Build(arms_down=0.4))
    found, changed = problems(addon, rig, {role: None})
    assert len(found) == 1
    assert found[0].blocks
    assert found[0].message.startswith(f"No bone for the {role.replace('_', ' ')}: choose ")
    assert f"'{role}' looks right" in found[0].message
    assert same(mended(addon, rig, found, changed), rig.bone_map)


def test_where_to_look_is_said(addon: Any) -> None:
    rig = make_rig(addon, Build())
    assert "the bone between left thigh and left foot" in problems(addon, rig, {"left_shin": None})[0][0].message
    no_foot, _ = problems(addon, rig, {"left_foot": None, "left_toe": None})
    assert "a bone below the left shin" in no_foot[0].message


def test_missing_bones_are_found_between_others_when_the_shape_says_nothing(addon: Any) -> None:
    rig = make_rig(addon, Build())
    # Without its right arm the rig is no humanoid by its shape.
    arm = {"right_upper_arm", "right_forearm", "right_hand"}
    kept = [n for n, name in enumerate(rig.skeleton.names) if name not in arm]
    skeleton = replace(
        rig.skeleton,
        names=tuple(rig.skeleton.names[n] for n in kept),
        parents=tuple(kept.index(p) if (p := rig.skeleton.parents[n]) >= 0 else -1 for n in kept),
        heads=rig.skeleton.heads[kept], axes=rig.skeleton.axes[kept], lengths=rig.skeleton.lengths[kept],
        turns_with_parent=rig.skeleton.turns_with_parent[kept],
    )  # fmt: skip
    pairs = [(role, bone) for role, bone in rig.bone_map.bones if bone in skeleton.names and role != "left_shin"]
    bone_map = addon("retarget.bone_map").BoneMap(tuple(pairs))
    messages = [p.message for p in addon("retarget.validation").find_problems(skeleton, bone_map)]
    assert any("left shin" in m and "'left_shin' looks right" in m for m in messages)
    assert any("right upper arm" in m and "looks right" not in m for m in messages)


def test_one_bone_for_two_roles(addon: Any) -> None:
    rig = make_rig(addon, Build())
    found, changed = problems(addon, rig, {"left_toe": "left_foot"})
    assert "'left_foot' is chosen for the left foot and the left toe: a bone can be only one" in [
        p.message for p in found
    ]
    after = mended(addon, rig, found, changed)
    assert after.bone("left_foot") == "left_foot"
    assert after.bone("left_toe") is None


def test_a_limb_upside_down(addon: Any) -> None:
    rig = make_rig(addon, Build())
    found, changed = problems(addon, rig, {"left_hand": "left_forearm", "left_forearm": "left_hand"})
    assert any("'left_forearm' is chosen for the left hand" in problem.message for problem in found)
    assert same(mended(addon, rig, found, changed), rig.bone_map)


def test_a_spine_out_of_order(addon: Any) -> None:
    rig = make_rig(addon, Build(spine=3))
    found, changed = problems(addon, rig, {}, ("spine2", "spine1", "spine3"))
    assert "not in order" in found[0].message
    assert mended(addon, rig, found, changed).spine == ("spine1", "spine2", "spine3")


def test_left_and_right_exchanged(addon: Any) -> None:
    rig = make_rig(addon, Build(arms_down=0.5))
    swapped = {role: bone.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right")
               for role, bone in rig.bone_map.bones if "_" in role}  # fmt: skip
    found, changed = problems(addon, rig, swapped)
    assert len(found) == 1
    assert "Left and right seem exchanged" in found[0].message
    assert same(mended(addon, rig, found, changed), rig.bone_map)


def test_a_single_bone_of_the_other_side(addon: Any) -> None:
    rig = make_rig(addon, Build())
    found, _ = problems(addon, rig, {"left_forearm": "right_forearm", "right_forearm": "left_forearm"})
    assert any("On the other side of the body" in p.message and "left forearm" in p.message for p in found)


def test_an_unknown_bone(addon: Any) -> None:
    rig = make_rig(addon, Build())
    found, changed = problems(addon, rig, {"left_toe": "gone"})
    assert found[0].message.startswith("This rig has no bone 'gone' (for the left toe)")
    assert mended(addon, rig, found, changed).bone("left_toe") is None


def test_hips_that_do_not_carry_the_legs(addon: Any) -> None:
    rig = make_rig(addon, Build(roots=("root",)))
    found, changed = problems(addon, rig, {"hips": "spine1", "root": None}, ("spine2", "spine3"))
    assert "do not carry the left thigh" in found[0].message
    assert mended(addon, rig, found, changed).bone("hips") == "hips"


def test_every_message_is_one_plain_line(addon: Any) -> None:
    rig = make_rig(addon, Build())
    found, _ = problems(addon, rig, {"hips": None, "left_toe": "gone", "left_hand": "left_forearm", "head": "neck"})
    for problem in found:
        assert "\n" not in problem.message
        assert "_" not in problem.message.replace("left_forearm", "")
    assert [p.blocks for p in found] == sorted((p.blocks for p in found), reverse=True)


def test_maps_found_by_shape_are_sound(addon: Any) -> None:
    for build in RIGS.values():
        anonymous, _ = shuffled_names(make_rig(addon, build).skeleton)
        found = addon("retarget.structure").find_by_structure(anonymous)
        assert addon("retarget.validation").find_problems(anonymous, found) == ()
