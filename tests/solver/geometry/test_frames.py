"""The gravity-aligned world: upright, right-handed, on the ground, for any tilt of camera and ground."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from core_solver.geometry import GroundFrame, matrix_from_rotvec, world_from_camera
from tests.solver.geometry.strategies import DIRECTIONS, VECTORS

LEVEL = GroundFrame(np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0]), 1.6)


@st.composite
def grounds(draw: st.DrawFn) -> GroundFrame:
    """Any gravity, a ground that slopes by up to 60 degrees, camera up to 50 m above it (or below)."""
    gravity, axis = draw(DIRECTIONS), draw(DIRECTIONS)
    normal = matrix_from_rotvec(axis * draw(st.floats(0, math.radians(60)))) @ -gravity
    return GroundFrame(gravity, normal, draw(st.floats(-50, 50)))


def test_a_level_camera() -> None:
    world = world_from_camera(LEVEL)
    # The camera stands 1.6 m up; ahead is +y; what is right in the picture is right in the world.
    np.testing.assert_allclose(world.apply([0.0, 0, 0]), [0, 0, 1.6], atol=1e-14)
    np.testing.assert_allclose(world.apply([0.0, 1.6, 5.0]), [0, 5, 0], atol=1e-14)
    np.testing.assert_allclose(world.apply([2.0, 0, 0]), [2, 0, 1.6], atol=1e-14)


@given(grounds())
def test_world_is_rigid_right_handed_and_upright(ground: GroundFrame) -> None:
    world = world_from_camera(ground)
    assert world.scale == 1.0
    np.testing.assert_allclose(world.rotation @ world.rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(world.rotation) == pytest.approx(1, abs=1e-12)
    np.testing.assert_allclose(world.rotation @ ground.gravity, [0, 0, -1], atol=1e-12)


@given(grounds())
def test_origin_is_on_the_ground_below_the_camera(ground: GroundFrame) -> None:
    world = world_from_camera(ground)
    origin = -world.rotation.T @ world.translation
    assert ground.height_above(origin) == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(world.translation[:2], 0, atol=1e-9)


@given(grounds(), VECTORS)
def test_height_over_level_ground_is_z(ground: GroundFrame, point: np.ndarray) -> None:
    level = GroundFrame(ground.gravity, -ground.gravity, ground.offset)
    assert world_from_camera(level).apply(point)[2] == pytest.approx(level.height_above(point), abs=1e-9)


@given(grounds())
def test_camera_looks_along_plus_y(ground: GroundFrame) -> None:
    assume(np.linalg.norm(ground.gravity[:2]) > 0.01)
    forward = world_from_camera(ground).rotation @ [0, 0, 1.0]
    assert forward[0] == pytest.approx(0, abs=1e-12)
    assert forward[1] > 0


def test_a_camera_that_looks_straight_down_has_the_top_of_the_picture_ahead() -> None:
    world = world_from_camera(GroundFrame(np.array([0.0, 0, 1.0]), np.array([0.0, 0, -1.0]), 3.0))
    np.testing.assert_allclose(world.apply([0.0, 0, 3.0]), [0, 0, 0], atol=1e-14)
    np.testing.assert_allclose(world.apply([0.0, -1.0, 3.0]), [0, 1, 0], atol=1e-14)
    np.testing.assert_allclose(world.apply([1.0, 0, 3.0]), [1, 0, 0], atol=1e-14)


def test_sloped_ground_keeps_gravity_vertical() -> None:
    slope = math.radians(20)
    # Ground that rises ahead: its normal leans back towards the camera.
    normal = np.array([0.0, -math.cos(slope), -math.sin(slope)])
    ground = GroundFrame(np.array([0.0, 1.0, 0.0]), normal, 2.0 * math.cos(slope))
    world = world_from_camera(ground)
    np.testing.assert_allclose(world.apply([0.0, 0, 0]), [0, 0, 2.0], atol=1e-12)
    ahead = np.array([0.0, 2.0 - 10 * math.tan(slope), 10.0])
    assert ground.height_above(ahead) == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(world.apply(ahead), [0, 10, 10 * math.tan(slope)], atol=1e-12)


def test_height_above_is_positive_above_and_takes_many_points() -> None:
    points = np.array([[[0.0, 0, 0], [0, 1.6, 9]], [[3, 2.6, 4], [1, -1.4, 2]]])
    np.testing.assert_allclose(LEVEL.height_above(points), [[1.6, 0], [-1, 3]], atol=1e-14)
