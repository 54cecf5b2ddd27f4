"""One person on rigs of all builds, against the person's own joints."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from .skeletons import RIGS, Rig, gestures, make_person, make_rig, walk

LIMBS = [
    (f"{side}_{limb}", f"{side}_{following}")
    for side in ("left", "right")
    for limb, following in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
]


def actor_of(addon: Any, person: Rig, motion: Any, rig: Rig, contacts: Any = None) -> Any:
    if contacts is None:
        contacts = np.zeros((len(motion.times), 2))
    return addon("retarget.actor").Actor(
        "somebody", person.skeleton, person.bone_map, motion, contacts, rig.skeleton, rig.bone_map
    )


def options(addon: Any, **chosen: Any) -> Any:
    return addon("retarget.options").Options(**chosen)


def flat(addon: Any) -> Any:
    return addon("retarget.ground").Ground.flat()


def directions(rig: Rig, motion: Any) -> np.ndarray:
    """(T, 8, 3) unit vectors along upper arms, forearms, thighs and shins."""
    ends = [[motion.heads[:, rig.skeleton.index(role)] for role in pair] for pair in LIMBS]
    ways = np.stack([end - start for start, end in ends], axis=1)
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


def degrees_apart(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    return np.degrees(2 * np.arcsin(np.clip(np.linalg.norm(first - second, axis=-1) / 2, 0, 1)))


@settings(max_examples=3, deadline=None)
@given(seed=st.integers(0, 1000))
@pytest.mark.parametrize("kind", ["person", *RIGS])
def test_onto_itself_nothing_changes(addon: Any, kind: str, seed: int) -> None:
    """Any rig is its own best target: feet in place and all."""
    rig = make_person(addon) if kind == "person" else make_rig(addon, RIGS[kind])
    motion = gestures(addon, rig, seed=seed)
    contacts = np.random.default_rng(seed).uniform(size=(len(motion.times), 2))
    after = addon("retarget.transfer").transfer(
        actor_of(addon, rig, motion, rig, contacts), options(addon), flat(addon)
    )
    np.testing.assert_allclose(after.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(after.heads, motion.heads, atol=1e-6)


@pytest.mark.parametrize("kind", RIGS)
def test_limbs_point_where_the_persons_point(addon: Any, kind: str) -> None:
    person, rig = make_person(addon), make_rig(addon, RIGS[kind])
    motion = gestures(addon, person)
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig), options(addon, feet=False), flat(addon)
    )
    assert degrees_apart(directions(rig, after), directions(person, motion)).max() < 1e-4


@pytest.mark.parametrize("kind", RIGS)
def test_standing_feet_stand_still_in_the_persons_places(addon: Any, kind: str) -> None:
    """Rigs of other sizes keep a walker's footprints: within 5 mm, on the ground, without skating."""
    person, rig = make_person(addon), make_rig(addon, RIGS[kind])
    motion, contacts = walk(addon, person)
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig, contacts), options(addon), flat(addon)
    )
    for foot in (0, 1):
        stands = contacts[:, foot] > 0.5
        theirs, ours = sole_ends(addon, person, motion, foot), sole_ends(addon, rig, after, foot)
        middle = ours.mean(axis=0) - theirs.mean(axis=0)
        assert np.abs(middle[stands, :2]).max() < 0.005
        assert np.abs(ours[:, stands, 2]).max() < 0.005
        still = stands[1:] & stands[:-1]
        assert np.linalg.norm(np.diff(ours, axis=1), axis=-1)[:, still].max() < 0.003
        assert ours[..., 2].min() > -0.005


def sole_ends(addon: Any, rig: Rig, motion: Any, foot: int) -> np.ndarray:
    """(2, T, 3) heel and ball, from the rest pose's heights."""
    sole = addon("retarget.landmarks").soles(rig.skeleton, rig.bone_map)[foot]
    return np.stack([sole.heel.positions(motion), sole.ball.positions(motion)])


def test_two_people_keep_their_places_on_a_small_and_a_tall_rig(addon: Any) -> None:
    """Hip joints stay above where the people's are, whatever the rigs' sizes; heights go with the legs."""
    for kind, size in (("short", 0.7), ("tall", 1.4)):
        person, rig = make_person(addon), make_rig(addon, RIGS[kind])
        motion, contacts = walk(addon, person)
        after = addon("retarget.transfer").transfer(
            actor_of(addon, person, motion, rig, contacts), options(addon, feet=False), flat(addon)
        )
        theirs, ours = hips_of(person, motion), hips_of(rig, after)
        np.testing.assert_allclose(ours[:, :2], theirs[:, :2], atol=1e-9)
        np.testing.assert_allclose(ours[:, 2], size * theirs[:, 2], rtol=0.01)


def hips_of(rig: Rig, motion: Any) -> np.ndarray:
    """(T, 3) between the hip joints."""
    return motion.heads[:, [rig.skeleton.index(f"{side}_thigh") for side in ("left", "right")]].mean(axis=1)


def test_one_scale_moves_everybody_apart_alike(addon: Any) -> None:
    person, rig = make_person(addon), make_rig(addon, RIGS["mixamo"])
    motion, contacts = walk(addon, person)
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig, contacts), options(addon, scale=1.3, feet=False), flat(addon)
    )
    np.testing.assert_allclose(hips_of(rig, after)[:, :2], 1.3 * hips_of(person, motion)[:, :2], atol=1e-9)
    assert hips_of(rig, after)[:, 2].max() < 1.0


@pytest.mark.parametrize("kind", RIGS)
def test_level_soles_and_upright_trunks_stay_so(addon: Any, kind: str) -> None:
    """A person who just stands there, turned about the vertical: nothing of the rig is tilted."""
    person, rig = make_person(addon), make_rig(addon, RIGS[kind])
    motion, _ = walk(addon, person, frames=2)
    skeleton = person.skeleton
    turn = motion.rotations[0, skeleton.index("hips")] @ skeleton.axes[skeleton.index("hips")].T
    still = addon("retarget.skeleton").Motion(
        motion.times, np.stack([turn @ skeleton.axes] * 2), np.stack([skeleton.heads @ turn.T] * 2)
    )
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, still, rig), options(addon, feet=False), flat(addon)
    )
    rest = rig.skeleton
    for bone in ("hips", rig.bone_map.spine[-1], "head", "left_foot", "right_foot"):
        index = rest.index(bone)
        change = after.rotations[0, index] @ rest.axes[index].T
        assert np.degrees(np.arccos(np.clip(change[2, 2], -1, 1))) < 1e-3
        # The person's front is the rig's front.
        front = change @ (rest_front(rig))
        np.testing.assert_allclose(front, turn @ [0.0, -1.0, 0.0], atol=1e-3 if "foot" not in bone else 0.1)


def rest_front(rig: Rig) -> np.ndarray:
    left, right = (rig.skeleton.heads[rig.skeleton.index(f"{side}_thigh")] for side in ("left", "right"))
    front = np.cross(left - right, [0.0, 0.0, 1.0])
    return front / np.linalg.norm(front)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_spine_of_other_length_bends_as_far(addon: Any, count: int) -> None:
    """Hips and chest turn exactly as the person's, bones between in order: no bend is lost or made."""
    build = RIGS["mixamo"]
    person, rig = make_person(addon), make_rig(addon, type(build)(spine=count))
    motion, _ = walk(addon, person)
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig), options(addon, feet=False), flat(addon)
    )
    for theirs, ours in (("hips", "hips"), ("spine3", rig.bone_map.spine[-1])):
        a = motion.rotations[:, person.skeleton.index(theirs)] @ person.skeleton.axes[person.skeleton.index(theirs)].T
        b = after.rotations[:, rig.skeleton.index(ours)] @ rig.skeleton.axes[rig.skeleton.index(ours)].T
        np.testing.assert_allclose(a, b, atol=1e-9)
    trunk = [rig.skeleton.index(name) for name in ("hips", *rig.bone_map.spine)]
    turns = after.rotations[:, trunk] @ np.swapaxes(rig.skeleton.axes[trunk], -1, -2)
    heading = np.unwrap(np.arctan2(turns[:, :, 1, 0], turns[:, :, 0, 0]))
    steps = np.diff(heading, axis=1) * np.sign(heading[:, -1:] - heading[:, :1])
    assert steps.min() > -1e-9


def test_bones_without_a_role_rest_on_their_parents(addon: Any) -> None:
    person, rig = make_person(addon), make_rig(addon, RIGS["unreal"])
    motion, contacts = walk(addon, person)
    after = addon("retarget.transfer").transfer(
        actor_of(addon, person, motion, rig, contacts), options(addon), flat(addon)
    )
    channels = addon("retarget.skeleton").channels_of(rig.skeleton, after)
    for bone in ("left_twist", "right_twist", "neck_02", "root", "ik_foot_root", "ik_hand_root"):
        index = rig.skeleton.index(bone)
        assert np.abs(np.abs(channels.quaternions[:, index, 0]) - 1).max() < 1e-9
        assert np.abs(channels.locations[:, index]).max() < 1e-9
    moved = np.abs(channels.locations).max(axis=(0, 2)) > 1e-6
    assert [rig.skeleton.names[bone] for bone in np.flatnonzero(moved)] == ["hips"]
