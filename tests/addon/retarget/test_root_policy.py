"""Who carries a character through the world, and that what is seen stays the same."""

from typing import Any

import numpy as np
import pytest

from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix

from .skeletons import MIXAMO, TALL, UNREAL, make_person, make_rig, walk
from .test_transfer import actor_of, flat, options

BODY = ("hips", "head", "left_hand", "right_hand", "left_foot", "right_foot")


def moved(addon: Any, build: Any, policy: str, height: float = 0.0) -> tuple[Any, Any, Any]:
    """The rig, its motion with everything on the hips, and with the policy."""
    person, rig = make_person(addon), make_rig(addon, build)
    motion, contacts = walk(addon, person)
    plain = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig, contacts), options(addon), flat(addon)
    )
    level = np.full(len(motion.times), height)
    with_policy = addon("retarget.root_policy").with_policy
    return rig, plain, with_policy(rig.skeleton, rig.bone_map, plain, policy, level)


@pytest.mark.parametrize("build", [TALL, UNREAL], ids=["tall", "unreal"])
def test_the_root_follows_on_the_ground_and_nothing_seen_changes(addon: Any, build: Any) -> None:
    rig, plain, after = moved(addon, build, "root_bone")
    body = [rig.skeleton.index(name) for name in BODY]
    np.testing.assert_array_equal(after.heads[:, body], plain.heads[:, body])
    np.testing.assert_array_equal(after.rotations[:, body], plain.rotations[:, body])
    root, hips = rig.skeleton.index("root"), rig.skeleton.index("hips")
    np.testing.assert_allclose(after.heads[:, root], plain.heads[:, hips] * [1, 1, 0], atol=1e-9)
    turn = after.rotations[:, root] @ rig.skeleton.axes[root].T
    np.testing.assert_allclose(turn[:, 2, 2], 1.0)
    # The walker's heading is 0.6 radians; the hips sway about it.
    assert np.abs(rotvec_from_matrix(turn)[:, 2] - 0.6).max() < 0.2


def test_the_keys_of_root_and_hips_add_up(addon: Any) -> None:
    """Played back from the channels alone, the character is where it was."""
    rig, plain, after = moved(addon, UNREAL, "root_bone")
    skeleton = addon("retarget.skeleton")
    channels = skeleton.channels_of(rig.skeleton, after)
    w, xyz = channels.quaternions[..., :1], channels.quaternions[..., 1:]
    angle = 2 * np.arctan2(np.linalg.norm(xyz, axis=-1, keepdims=True), w)
    length = np.maximum(np.linalg.norm(xyz, axis=-1, keepdims=True), 1e-12)
    played = skeleton.pose(rig.skeleton, plain.times, matrix_from_rotvec(angle * xyz / length), channels.locations)
    body = [rig.skeleton.index(name) for name in BODY]
    np.testing.assert_allclose(played.heads[:, body], plain.heads[:, body], atol=1e-9)


def test_other_roots_rest(addon: Any) -> None:
    rig, _, after = moved(addon, UNREAL, "root_bone")
    for name in ("ik_foot_root", "ik_hand_root"):
        bone = rig.skeleton.index(name)
        np.testing.assert_allclose(after.heads[:, bone], np.tile(rig.skeleton.heads[bone], (len(after.times), 1)))


def test_the_root_stands_on_the_floor_that_is_there(addon: Any) -> None:
    rig, _, after = moved(addon, TALL, "root_bone", height=1.2)
    np.testing.assert_allclose(after.heads[:, rig.skeleton.index("root"), 2], 1.2)


@pytest.mark.parametrize("policy", ["root_bone", "hips"])
def test_without_a_root_or_by_choice_the_hips_carry_all(addon: Any, policy: str) -> None:
    _, plain, after = moved(addon, MIXAMO if policy == "root_bone" else TALL, policy)
    np.testing.assert_array_equal(after.heads, plain.heads)
    np.testing.assert_array_equal(after.rotations, plain.rotations)


def test_in_place_only_the_way_over_the_ground_is_lost(addon: Any) -> None:
    rig, plain, after = moved(addon, TALL, "in_place")
    hips = rig.skeleton.index("hips")
    np.testing.assert_allclose(after.heads[:, hips, :2], np.tile(rig.skeleton.heads[hips, :2], (len(after.times), 1)))
    np.testing.assert_array_equal(after.heads[..., 2], plain.heads[..., 2])
    np.testing.assert_array_equal(after.rotations, plain.rotations)
    body = [rig.skeleton.index(name) for name in BODY]
    np.testing.assert_allclose(
        after.heads[:, body] - after.heads[:, [hips]], plain.heads[:, body] - plain.heads[:, [hips]], atol=1e-9
    )
