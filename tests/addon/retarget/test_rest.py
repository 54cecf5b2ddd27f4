"""Rest poses of all kinds brought to the one that all bodies share."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.geometry import Similarity, matrix_from_rotvec

from .skeletons import A_POSE, RIGS, UNREAL, Build, make_person, make_rig


def frame(addon: Any, rig: Any, bone: str) -> np.ndarray:
    frames = addon("retarget.rest").rest_frames(rig.skeleton, rig.bone_map)
    return frames[rig.skeleton.index(bone)]


@pytest.mark.parametrize("kind", RIGS)
def test_the_body_frame_follows_the_facing_alone(addon: Any, kind: str) -> None:
    """Left, back and up are those of the build, whatever its rolls, arms and size."""
    rig = make_rig(addon, RIGS[kind])
    expected = matrix_from_rotvec([0.0, 0.0, RIGS[kind].facing])
    np.testing.assert_allclose(addon("retarget.rest").body_frame(rig.skeleton, rig.bone_map), expected, atol=1e-9)


def test_a_t_pose_is_the_shared_pose(addon: Any) -> None:
    """Arms exactly to the sides, as in the default build, have the body's frame; so have trunk and hands."""
    rig = make_person(addon)
    for bone in ("hips", "spine2", "head", "left_clavicle", "left_upper_arm", "right_forearm", "left_hand"):
        np.testing.assert_allclose(frame(addon, rig, bone), np.eye(3), atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(down=st.floats(0.0, 1.5), bent=st.floats(0.0, 1.0))
def test_arms_are_lowered_and_bent_without_twist(addon: Any, down: float, bent: float) -> None:
    """An arm that hangs was turned about the front, a bent elbow about the axis across both: the least that brings
    the shared pose there, so that palms look where they look on everybody."""
    rig = make_rig(addon, Build(arms_down=down, elbows_bent=bent))
    lowered = matrix_from_rotvec([0.0, down, 0.0])
    np.testing.assert_allclose(frame(addon, rig, "left_upper_arm"), lowered, atol=1e-9)
    along = lowered @ matrix_from_rotvec([0.0, 0.0, -bent])[:, 0]
    forearm = frame(addon, rig, "left_forearm")
    np.testing.assert_allclose(forearm[:, 0], along, atol=1e-9)
    shortest = np.arccos(np.clip(along[0], -1, 1))
    np.testing.assert_allclose(np.arccos(np.clip((np.trace(forearm) - 1) / 2, -1, 1)), shortest, atol=1e-6)
    np.testing.assert_allclose(frame(addon, rig, "left_hand"), forearm, atol=1e-12)


@pytest.mark.parametrize("build", [A_POSE, UNREAL], ids=["a pose", "unreal"])
def test_left_and_right_are_mirror_images(addon: Any, build: Build) -> None:
    rig = make_rig(addon, build)
    body = addon("retarget.rest").body_frame(rig.skeleton, rig.bone_map)
    mirror = np.diag([-1.0, 1.0, 1.0])
    for limb in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot", "toe"):
        left, right = (body.T @ frame(addon, rig, f"{side}_{limb}") for side in ("left", "right"))
        np.testing.assert_allclose(mirror @ left @ mirror, right, atol=1e-9)


def test_feet_lie_flat_and_point_where_they_point(addon: Any) -> None:
    rig = make_rig(addon, A_POSE)
    foot = frame(addon, rig, "left_foot")
    np.testing.assert_allclose(foot[:, 2], [0.0, 0.0, 1.0], atol=1e-9)
    way = rig.skeleton.heads[rig.skeleton.index("left_toe")] - rig.skeleton.heads[rig.skeleton.index("left_foot")]
    along = way * [1, 1, 0] / np.linalg.norm(way[:2])
    np.testing.assert_allclose(-foot[:, 1], along, atol=1e-9)


def test_a_rig_that_rests_leaning_is_taken_upright(addon: Any) -> None:
    """Everything turns with a rig that was modelled lying on its back: frames, and the floor it would stand on."""
    rig = make_person(addon)
    lean = matrix_from_rotvec([0.9, 0.2, 0.0])
    skeleton = type(rig.skeleton)(
        rig.skeleton.names,
        rig.skeleton.parents,
        rig.skeleton.heads @ lean.T,
        lean @ rig.skeleton.axes,
        rig.skeleton.lengths,
        Similarity(np.eye(3), np.zeros(3)),
        rig.skeleton.turns_with_parent,
    )
    upright = addon("retarget.rest").rest_frames(rig.skeleton, rig.bone_map)
    leaning = addon("retarget.rest").rest_frames(skeleton, rig.bone_map)
    # Hips and head of a body are not exactly above each other: by as much the two may differ.
    np.testing.assert_allclose(leaning, lean @ upright, atol=0.02)
    soles = addon("retarget.landmarks").soles(skeleton, rig.bone_map)
    for sole, before in zip(soles, addon("retarget.landmarks").soles(rig.skeleton, rig.bone_map), strict=True):
        np.testing.assert_allclose(sole.heel.offset, before.heel.offset, atol=0.02)
        np.testing.assert_allclose(sole.ball.offset, before.ball.offset, atol=0.02)


def test_a_map_without_the_needed_bones_is_refused(addon: Any) -> None:
    rig = make_person(addon)
    bones = tuple(pair for pair in rig.bone_map.bones if pair[0] != "left_thigh")
    with pytest.raises(ValueError, match="left_thigh"):
        addon("retarget.rest").rest_frames(rig.skeleton, type(rig.bone_map)(bones))
