"""Rigs that do not hang together, against the same rig in one piece."""

from typing import Any

import numpy as np

from .skeletons import MIXAMO, UNREAL, Rig, make_person, make_rig, walk
from .test_transfer import actor_of, flat, options


def with_parents(rig: Rig, changed: dict[str, str]) -> Any:
    """The same bones in the same places, some of them hanging on others."""
    skeleton = rig.skeleton
    parents = list(skeleton.parents)
    for name, parent in changed.items():
        parents[skeleton.index(name)] = skeleton.index(parent) if parent else -1
    return type(skeleton)(
        skeleton.names, tuple(parents), skeleton.heads, skeleton.axes, skeleton.lengths, skeleton.to_world,
        skeleton.turns_with_parent,
    )  # fmt: skip


def test_feet_and_hands_that_hang_on_the_root_move_as_if_they_hung_on_their_limbs(addon: Any) -> None:
    person, rig = make_person(addon), make_rig(addon, UNREAL)
    loose = {"left_foot": "root", "right_foot": "root", "left_hand": "", "left_upper_arm": "spine5"}
    skeleton = with_parents(rig, loose)
    joining = addon("retarget.joining")
    whole, whole_map = joining.joined(skeleton, rig.bone_map)
    motion, contacts = walk(addon, person)
    transfer = addon("retarget.transfer").transfer
    expected = transfer(actor_of(addon, person, motion, rig, contacts), options(addon), flat(addon))
    after = transfer(actor_of(addon, person, motion, Rig(whole, whole_map), contacts), options(addon), flat(addon))
    again = joining.reordered(after, whole, skeleton)
    np.testing.assert_allclose(again.heads, expected.heads, atol=1e-9)
    np.testing.assert_allclose(again.rotations, expected.rotations, atol=1e-9)


def test_a_rig_of_one_piece_stays_as_it_is(addon: Any) -> None:
    rig = make_rig(addon, UNREAL)
    skeleton, bone_map = addon("retarget.joining").joined(rig.skeleton, rig.bone_map)
    assert skeleton is rig.skeleton
    assert bone_map is rig.bone_map


def test_what_carries_trunk_and_legs_is_the_hips(addon: Any) -> None:
    """Hips beside the legs, both on a bone without a role: that bone carries the body."""
    rig = make_rig(addon, UNREAL)
    skeleton = with_parents(rig, {"left_thigh": "root", "right_thigh": "root"})
    bones = tuple(pair for pair in rig.bone_map.bones if pair[0] != "root")
    _, bone_map = addon("retarget.joining").joined(skeleton, type(rig.bone_map)(bones))
    assert bone_map.bone("hips") == "root"
    assert bone_map.spine == ("hips", *rig.bone_map.spine)


def test_leaving_bones_out_keeps_the_rest_in_place(addon: Any) -> None:
    rig = make_rig(addon, MIXAMO)
    names = [name for name in rig.skeleton.names if name not in ("spine2", "left_forearm")]
    fewer = addon("retarget.joining").only(rig.skeleton, names)
    assert fewer.names == tuple(names)
    assert fewer.names[fewer.parents[fewer.index("spine3")]] == "spine1"
    assert fewer.names[fewer.parents[fewer.index("left_hand")]] == "left_upper_arm"
    kept = [rig.skeleton.index(name) for name in names]
    np.testing.assert_array_equal(fewer.heads, rig.skeleton.heads[kept])
