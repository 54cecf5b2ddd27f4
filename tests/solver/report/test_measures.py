"""Measures against motion that is known by construction: stiff people who glide over a level floor."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.geometry import matrix_from_rotvec
from core_solver.report.measures import ground_frame, measure_person, resting_steps
from core_solver.take import JOINT_NAMES, PARENTS
from tests.solver.preview.takes import CAMERA_HEIGHT, RATE, make_take

FRAMES = 8


def measured(take, index=0):
    return measure_person(take.people[index], take.meta.joint_names, ground_frame(take))


def with_person(take, **changes):
    return replace(take, people=(replace(take.people[0], **changes),))


def turned_by(quaternion, vector):
    """The textbook product q v q*, written out."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    return vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)


def test_the_pelvis_is_where_it_was_put():
    take = make_take(frames=FRAMES)
    person, result = take.people[0], measured(make_take(frames=FRAMES))
    soles = person.rest_joints[0, 1] - person.rest_vertices[:, 1].min()
    seconds = np.arange(FRAMES) / RATE
    # Camera: x right, z away. World: x right, y away, z up from the floor.
    expected = np.stack([-0.6 + 0.5 * seconds, np.full(FRAMES, 4.0), np.full(FRAMES, soles)], axis=-1)
    np.testing.assert_allclose(result.joints[:, 0], expected, atol=1e-5)


def test_a_standing_body_reaches_from_the_floor_to_its_height():
    take = make_take(frames=FRAMES)
    result = measured(take)
    np.testing.assert_allclose(result.lowest, 0, atol=1e-5)
    np.testing.assert_allclose(result.top, take.people[0].height_m, atol=1e-5)


def test_turns_carry_the_bones():
    take, rng = make_take(frames=FRAMES), np.random.default_rng(1)
    theta = rng.normal(0, 0.6, (FRAMES, 24, 3)).astype(np.float32)
    person = replace(take.people[0], theta=theta, scale=1.3)
    result = measure_person(person, take.meta.joint_names, ground_frame(take))
    for child, parent in enumerate(PARENTS):
        if parent >= 0:
            bone = 1.3 * (person.rest_joints[child] - person.rest_joints[parent]).astype(float)
            posed = turned_by(result.turns[:, parent], np.broadcast_to(bone, (FRAMES, 3)))
            np.testing.assert_allclose(result.joints[:, child] - result.joints[:, parent], posed, atol=1e-5)


def test_gliding_feet_skate_by_their_speed():
    take = with_person(make_take(frames=FRAMES), contacts=np.ones((FRAMES, 2), np.float32))
    result = measured(take)
    assert np.isnan(result.skate[0]).all()
    np.testing.assert_allclose(result.skate[1:], 1000 * 0.5 / RATE, rtol=1e-3)


def test_a_foot_that_rises_does_not_skate():
    take = make_take(frames=FRAMES)
    gamma = np.tile(take.people[0].gamma[:1], (FRAMES, 1))
    gamma[:, 1] -= 0.1 * np.arange(FRAMES, dtype=np.float32)
    result = measured(with_person(take, gamma=gamma, contacts=np.ones((FRAMES, 2), np.float32)))
    np.testing.assert_allclose(result.skate[1:], 0, atol=1e-3)
    np.testing.assert_allclose(result.lowest, 0.1 * np.arange(FRAMES), atol=1e-5)


def test_only_the_foot_that_turns_skates():
    take = make_take(frames=FRAMES)
    theta = np.zeros((FRAMES, 24, 3), np.float32)
    theta[:, 0, 0] = np.pi
    theta[:, JOINT_NAMES.index("left_ankle"), 1] = np.linspace(0, 0.7, FRAMES)  # about the vertical, as on a ball
    still = np.tile(take.people[0].gamma[:1], (FRAMES, 1))
    result = measured(with_person(take, theta=theta, gamma=still, contacts=np.ones((FRAMES, 2), np.float32)))
    assert (result.skate[1:, 0] > 2).all()
    np.testing.assert_allclose(result.skate[1:, 1], 0, atol=1e-3)


def test_a_foot_rests_when_it_did_so_before_too():
    contacts = np.array([[0.9, 0.1], [0.9, 0.9], [0.4, 0.9], [0.9, 0.9]], np.float32)
    np.testing.assert_array_equal(resting_steps(contacts), [[0, 0], [1, 0], [0, 1], [0, 1]])


def test_a_tilted_camera_changes_nothing_in_the_world():
    take = make_take(frames=FRAMES)
    level = measured(take)
    tilt = matrix_from_rotvec([0.4, 0.0, 0.0])  # of everything the camera sees
    person = take.people[0]
    turned = np.array([take.people[0].theta[f] for f in range(FRAMES)], float)
    from core_solver.geometry import rotvec_from_matrix

    turned[:, 0] = rotvec_from_matrix(tilt @ matrix_from_rotvec(turned[:, 0]))
    root = person.rest_joints[0].astype(float)
    gamma = (person.gamma + root) @ tilt.T - root
    meta = replace(
        take.meta,
        gravity=tuple(float(x) for x in tilt @ [0, 1, 0]),
        ground=replace(take.meta.ground, normal=tuple(float(x) for x in tilt @ [0, -1, 0])),
    )
    tilted = replace(
        take,
        meta=meta,
        people=(replace(person, theta=turned.astype(np.float32), gamma=gamma.astype(np.float32)),),
    )
    result = measured(tilted)
    assert take.meta.ground.offset == CAMERA_HEIGHT
    np.testing.assert_allclose(result.joints, level.joints, atol=1e-4)
    np.testing.assert_allclose(result.top, level.top, atol=1e-4)


def test_confidence_is_the_mean_over_joints():
    take = make_take(frames=FRAMES)
    confidence = np.zeros((FRAMES, 24), np.float32)
    confidence[2, :6] = 1
    assert measured(with_person(take, confidence=confidence)).confidence[2] == pytest.approx(0.25)
