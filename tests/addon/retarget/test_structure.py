"""Bones found by a rig's shape alone: humanoids of many builds, and what is none."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.errors import UserError
from core_solver.geometry import Similarity, matrix_from_rotvec

from .skeletons import RIGS, Build, make_rig

Bones = dict[str, tuple[str | None, tuple[float, float, float]]]
SIDES = ((1, "left"), (-1, "right"))


def shuffled_names(skeleton: Any, seed: int = 0) -> tuple[Any, dict[str, str]]:
    """The rig under names that say nothing, and what each was called."""
    numbers = np.random.default_rng(seed).permutation(len(skeleton.names))
    names = tuple(f"bone_{number:03d}" for number in numbers)
    return replace(skeleton, names=names), dict(zip(names, skeleton.names, strict=True))


def found(addon: Any, skeleton: Any) -> dict[str, Any]:
    """Roles found by shape, in the rig's true names."""
    anonymous, true_names = shuffled_names(skeleton)
    bone_map = addon("retarget.structure").find_by_structure(anonymous)
    roles = {role: true_names[bone] for role, bone in bone_map.bones if role != "spine"}
    return roles | {"spine": tuple(true_names[bone] for bone in bone_map.spine)}


def truth(bone_map: Any) -> dict[str, Any]:
    return {role: bone for role, bone in bone_map.bones if role != "spine"} | {"spine": bone_map.spine}


@pytest.mark.parametrize("build", RIGS.values(), ids=RIGS)
def test_humanoids_of_all_builds(addon: Any, build: Build) -> None:
    rig = make_rig(addon, build)
    assert found(addon, rig.skeleton) == truth(rig.bone_map)


@settings(max_examples=40, deadline=None)
@given(
    size=st.floats(0.01, 100),
    arms_down=st.floats(-0.3, 1.4),
    elbows_bent=st.floats(0, 1.2),
    facing=st.floats(-3.2, 3.2),
    spine=st.integers(1, 6),
    without=st.sets(st.sampled_from(["toe", "clavicle", "neck"])),
    roots=st.booleans(),
    extras=st.booleans(),
)
def test_any_rest_pose_size_and_direction(
    addon: Any,
    size: float,
    arms_down: float,
    elbows_bent: float,
    facing: float,
    spine: int,
    without: set[str],
    *,
    roots: bool,
    extras: bool,
) -> None:
    build = Build(
        size=size,
        arms_down=arms_down,
        elbows_bent=elbows_bent,
        facing=facing,
        spine=spine,
        without=tuple(without),
        roots=("root", "ik_foot_root") if roots else (),
        extras=extras and "neck" not in without,
    )
    rig = make_rig(addon, build)
    assert found(addon, rig.skeleton) == truth(rig.bone_map)


@settings(max_examples=20, deadline=None)
@given(turn=st.tuples(*[st.floats(-3.1, 3.1)] * 3))
def test_rigs_that_lie_or_lean(addon: Any, turn: tuple[float, float, float]) -> None:
    rig = make_rig(addon, Build(arms_down=0.6, rolls=3))
    rotation = matrix_from_rotvec(turn)
    lying = replace(rig.skeleton, heads=rig.skeleton.heads @ rotation.T, axes=rotation @ rig.skeleton.axes)
    assert found(addon, lying) == truth(rig.bone_map)


def test_lengths_that_differ_a_little_are_still_a_pair(addon: Any) -> None:
    rig = make_rig(addon, Build(arms_down=0.7))
    noise = np.random.default_rng(5).normal(scale=0.004, size=rig.skeleton.heads.shape)
    assert found(addon, replace(rig.skeleton, heads=rig.skeleton.heads + noise)) == truth(rig.bone_map)


def test_tails_hair_skirt_and_fingers_are_no_limbs(addon: Any) -> None:
    rig = make_rig(addon, Build())
    bones: Bones = {}
    for sign, side in SIDES:
        for number in range(4):
            bones[f"{side}_braid{number}"] = (
                f"{side}_braid{number - 1}" if number else "head",
                (0.09 * sign, 0.08, 1.6 - 0.12 * number),
            )
            bones[f"{side}_skirt{number}"] = (
                f"{side}_skirt{number - 1}" if number else "hips",
                (0.18 * sign, 0.02, 0.9 - 0.12 * number),
            )
        for finger in range(4):
            for number in range(3):
                bones[f"{side}_finger{finger}_{number}"] = (
                    f"{side}_finger{finger}_{number - 1}" if number else f"{side}_hand",
                    (sign * (0.77 + 0.03 * number), 0.02 * finger - 0.03, 1.42),
                )
    for number in range(5):
        bones[f"tail{number}"] = (f"tail{number - 1}" if number else "hips", (0.0, 0.1 + 0.12 * number, 0.9))
    assert found(addon, with_bones(rig.skeleton, bones)) == truth(rig.bone_map)


BRANCHES: dict[str, tuple[str, tuple[float, float, float], tuple[float, float, float], int]] = {
    "pigtails": ("head", (0.09, 0.06, 1.6), (0.01, 0.01, -0.1), 9),
    "wings": ("spine3", (0.1, 0.12, 1.4), (0.3, 0.1, 0.1), 5),
    "cape": ("spine3", (0.12, 0.12, 1.4), (0.0, 0.02, -0.2), 6),
    "long skirt": ("hips", (0.15, 0.02, 0.95), (0.03, 0.0, -0.15), 6),
    "ears": ("head", (0.08, 0.0, 1.7), (0.05, 0.0, 0.1), 4),
    "tailcoat": ("spine1", (0.08, 0.1, 1.0), (0.0, 0.03, -0.15), 5),
}
"""Parent, first place on the left, step from bone to bone, and number of bones."""


@pytest.mark.parametrize("arms_down", [0.0, 0.7, 1.3])
@pytest.mark.parametrize("branch", BRANCHES)
def test_what_characters_wear_is_no_limb(addon: Any, branch: str, arms_down: float) -> None:
    rig = make_rig(addon, Build(arms_down=arms_down))
    above, first, step, count = BRANCHES[branch]
    bones: Bones = {}
    for sign, side in SIDES:
        for number in range(count):
            place = (np.array(first) + number * np.array(step)) * [sign, 1, 1]
            bones[f"{side}_{number}"] = (f"{side}_{number - 1}" if number else above, tuple(place))
    assert found(addon, with_bones(rig.skeleton, bones | fingers(rig.skeleton))) == truth(rig.bone_map)


def fingers(skeleton: Any) -> Bones:
    """Three on each hand, along the forearm."""
    bones: Bones = {}
    for _, side in SIDES:
        wrist, elbow = (skeleton.heads[skeleton.index(f"{side}_{limb}")] for limb in ("hand", "forearm"))
        along = (wrist - elbow) / np.linalg.norm(wrist - elbow)
        for finger in range(3):
            for number in range(3):
                above = f"{side}_finger{finger}_{number - 1}" if number else f"{side}_hand"
                place = wrist + (0.08 + 0.03 * number) * along + [0.0, 0.02 * finger - 0.02, 0.0]
                bones[f"{side}_finger{finger}_{number}"] = (above, tuple(place))
    return bones


def test_sides_are_told_by_knees_and_elbows_when_there_are_no_toes(addon: Any) -> None:
    rig = make_rig(addon, Build(without=("toe",), elbows_bent=0.3, facing=2.0))
    anonymous, _ = shuffled_names(rig.skeleton)
    with_toes, _ = shuffled_names(make_rig(addon, Build(elbows_bent=0.3, facing=2.0)).skeleton)
    find = addon("retarget.structure").find_by_structure
    assert found(addon, rig.skeleton)["left_thigh"] == "left_thigh"
    assert find(anonymous).confidence < find(with_toes).confidence


def test_a_rig_without_any_front_has_doubts_about_its_sides(addon: Any) -> None:
    rig = make_rig(addon, Build(without=("toe",)))
    flat = replace(rig.skeleton, heads=rig.skeleton.heads * [1, 0, 1])
    bone_map = addon("retarget.structure").find_by_structure(flat)
    assert bone_map.confidence <= 0.65
    assert min(bone_map.doubts.get(f"{side}_thigh", bone_map.confidence) for _, side in SIDES) <= 0.55


# --- no humanoids ---------------------------------------------------------------------------------------------------


def skeleton_of(addon: Any, bones: Bones) -> Any:
    """Bones by name, each with its parent's name and its head; parents first."""
    names = list(bones)
    return addon("retarget.skeleton").Skeleton(
        names=tuple(names),
        parents=tuple(names.index(above) if above else -1 for above, _ in bones.values()),
        heads=np.array([place for _, place in bones.values()], float),
        axes=np.tile(np.eye(3), (len(names), 1, 1)),
        lengths=np.full(len(names), 0.05),
        to_world=Similarity(np.eye(3), np.zeros(3)),
        turns_with_parent=np.ones(len(names), bool),
    )


def with_bones(skeleton: Any, bones: Bones) -> Any:
    """A rig with more bones."""
    names = [*skeleton.names, *bones]
    more = len(bones)
    return replace(
        skeleton,
        names=tuple(names),
        parents=(*skeleton.parents, *(names.index(above or "") for above, _ in bones.values())),
        heads=np.concatenate([skeleton.heads, [place for _, place in bones.values()]]),
        axes=np.concatenate([skeleton.axes, np.tile(np.eye(3), (more, 1, 1))]),
        lengths=np.concatenate([skeleton.lengths, np.full(more, 0.05)]),
        turns_with_parent=np.ones(len(names), bool),
    )


def dog() -> Bones:
    bones: Bones = {
        "pelvis": (None, (0, 0.4, 0.6)), "spine": ("pelvis", (0, 0.1, 0.62)), "chest": ("spine", (0, -0.2, 0.6)),
        "neck": ("chest", (0, -0.4, 0.7)), "head": ("neck", (0, -0.5, 0.85)), "nose": ("head", (0, -0.65, 0.8)),
        "tail": ("pelvis", (0, 0.55, 0.6)), "tail_end": ("tail", (0, 0.8, 0.6)),
    }  # fmt: skip
    for x, side in SIDES:
        for above, name, y in (("pelvis", "hind", 0.4), ("chest", "fore", -0.25)):
            for number, z in enumerate((0.55, 0.35, 0.12, 0.02)):
                bones[f"{side}_{name}{number}"] = (
                    f"{side}_{name}{number - 1}" if number else above,
                    (0.1 * x, y - 0.03 * number, z),
                )
    return bones


def headless() -> Bones:
    bones: Bones = {"hips": (None, (0, 0, 1)), "chest": ("hips", (0, 0, 1.4))}
    for x, side in SIDES:
        for number, z in enumerate((0.9, 0.5, 0.1)):
            bones[f"{side}_leg{number}"] = (f"{side}_leg{number - 1}" if number else "hips", (0.1 * x, 0, z))
            above = f"{side}_arm{number - 1}" if number else "chest"
            bones[f"{side}_arm{number}"] = (above, (x * (0.2 + 0.27 * number), 0, 1.4))
    return bones


def chair() -> Bones:
    corners = {f"leg{x}{y}": ("seat", (float(x), float(y), 0.4)) for x in (-1, 1) for y in (-1, 1)}
    return {"seat": (None, (0, 0, 0.5)), "back": ("seat", (0, 0.4, 0.5)), **corners}


def rope() -> Bones:
    return {f"b{n}": (f"b{n - 1}" if n else None, (0.0, 0.0, 0.1 * n)) for n in range(20)}


@pytest.mark.parametrize(
    ("bones", "message"),
    [
        (dog(), "more than two legs"),
        (chair(), "no two chains of bones that could be legs"),
        (rope(), "no two chains of bones that could be legs"),
        (headless(), "no two legs below and two arms and a head"),
        ({"only": (None, (0, 0, 0))}, "no two chains of bones"),
    ],
    ids=["dog", "chair", "rope", "headless", "single bone"],
)
def test_others_are_refused_in_plain_words(addon: Any, bones: Bones, message: str) -> None:
    with pytest.raises(UserError, match=message) as caught:
        addon("retarget.structure").find_by_structure(skeleton_of(addon, bones))
    assert "\n" not in str(caught.value)
