from dataclasses import replace

import numpy as np
import pytest

from core_solver.body import JOINT_NAMES
from core_solver.evaluation.take_people import POINT_NAMES, people_of
from tests.solver.evaluation.real_takes import CAMERA, joints_of, standing_take


def test_joints_are_where_independent_kinematics_puts_them():
    take = standing_take(size=1.1)
    people = people_of(take)
    np.testing.assert_allclose(people.points[:, :, :24], joints_of(take), atol=1e-5)
    hips = joints_of(take)[:, :, [JOINT_NAMES.index("left_hip"), JOINT_NAMES.index("right_hip")]]
    np.testing.assert_allclose(people.roots, hips.mean(axis=2), atol=1e-5)


def test_the_top_of_the_head_follows_the_head_at_its_distance():
    take = standing_take()
    people = people_of(take)
    to_top = people.points[:, :, POINT_NAMES.index("head_top")] - people.points[:, :, POINT_NAMES.index("head")]
    # The box person's head joint is at 1.50 m, 0.01 m in front; the box's upper corners at 1.70 m, 0.08 m to a side.
    assert np.linalg.norm(to_top, axis=-1) == pytest.approx(
        np.full(to_top.shape[:2], np.hypot(np.hypot(0.20, 0.08), 0.10)), abs=2e-3
    )


def test_a_take_without_a_surface_has_no_top_of_the_head():
    take = standing_take(1)
    bare = replace(
        take.people[0],
        rest_vertices=np.zeros((0, 3), np.float32),
        weight_joints=np.zeros((0, 4), np.uint8),
        weights=np.zeros((0, 4), np.float32),
        faces=np.zeros((0, 3), np.int32),
    )
    points = people_of(replace(take, people=(bare,))).points
    assert np.isnan(points[:, :, 24]).all()
    assert np.isfinite(points[:, :, :24]).all()


def test_pixels_are_those_of_the_takes_camera():
    take = standing_take(1)
    people = people_of(take)
    x, y, z = people.points[0, 0, 4]
    assert people.pixels[0, 0, 4] == pytest.approx((900 * x / z + CAMERA.cx, 900 * y / z + CAMERA.cy))


def test_frames_count_in_the_video():
    people = people_of(standing_take(1, 4, first_frame=10, step=3, rate=30))
    np.testing.assert_array_equal(people.frames, [10, 13, 16, 19])
    assert people.frame_rate == 10


def test_gaps_are_shown_and_what_lies_outside_is_not():
    take = standing_take(2, 6)
    valid = np.array([False, True, False, True, False, False])
    people = (replace(take.people[0], valid=valid), replace(take.people[1], valid=np.zeros(6, bool)))
    found = people_of(replace(take, people=people)).found
    np.testing.assert_array_equal(found[0], [False, True, True, True, False, False])
    assert not found[1].any()


def test_a_take_of_nobody_has_no_points():
    people = people_of(standing_take(0))
    assert people.points.shape == (0, 24, 25, 3)
    assert people.found.shape == people.scores.shape == (0, 24)
