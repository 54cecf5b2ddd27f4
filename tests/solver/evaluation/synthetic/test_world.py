"""Heights, normals and depths of scenery against closed forms."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.camera import camera_from_fov
from core_solver.evaluation.synthetic.world import SKY_DEPTH, Block, SeenTerrain, Terrain, look

BOX = Block((1.0, 5.0), (2.0, 1.0), 0.0, 0.4)


@given(st.floats(-9, 9), st.floats(-9, 9), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_a_slope_is_a_plane_through_the_origin(x: float, y: float, a: float, b: float) -> None:
    terrain = Terrain((a, b))
    assert terrain.height([x, y]) == pytest.approx(a * x + b * y)
    normal = terrain.normal([x, y])
    along = np.array([1.0, 0.5, a + 0.5 * b])
    assert normal @ along == pytest.approx(0, abs=1e-12)
    assert normal @ normal == pytest.approx(1)


def test_a_box_raises_what_lies_over_its_footprint() -> None:
    terrain = Terrain(blocks=(BOX,))
    places = [(1.0, 5.0), (1.99, 5.49), (2.01, 5.0), (1.0, 5.51), (0.01, 4.51), (-0.01, 4.51)]
    np.testing.assert_allclose(terrain.height(places), [0.4, 0.4, 0, 0, 0.4, 0])


def test_a_turned_box_has_turned_edges() -> None:
    terrain = Terrain(blocks=(Block((0.0, 0.0), (2.0, 0.2), np.pi / 2, 1.0),))
    np.testing.assert_allclose(terrain.height([(0, 0.9), (0.9, 0), (0.05, -0.9)]), [1, 0, 1])


def test_steps_rise_one_after_the_other() -> None:
    steps = tuple(Block((0.3 * n + 0.15, 0.0), (0.3, 2.0), 0.0, 0.15 * (n + 1)) for n in range(4))
    x = np.array([-0.1, 0.1, 0.4, 0.7, 1.0])
    np.testing.assert_allclose(Terrain(blocks=steps).height(np.column_stack([x, 0 * x])), 0.15 * np.arange(5))


def test_depth_of_the_floor_is_that_of_the_plane() -> None:
    camera = camera_from_fov(640, 480, 60, "truth")
    view = look((0, 0, 1.7), (0.4, 6, 0.5), 0.05)
    rays = camera.grid_rays(24, 32)
    depth = SeenTerrain(Terrain(), view).depth(rays)
    # The point p = depth * ray on the plane satisfies up . p = - height of the camera.
    fall = -(rays @ view.up)
    expected = np.where(fall > 1.7 / SKY_DEPTH, 1.7 / np.maximum(fall, 1e-9), SKY_DEPTH)
    np.testing.assert_allclose(depth, expected, rtol=1e-9)
    assert (depth < SKY_DEPTH).mean() > 0.5


def test_rays_end_on_the_surface() -> None:
    camera = camera_from_fov(640, 480, 60, "truth")
    scenery = SeenTerrain(
        Terrain((0.05, -0.03), (BOX, Block((-1, 7), (1, 1), 0.4, 2.5))), look((0, 0, 2), (0, 6, 0.5), 0)
    )
    rays = camera.grid_rays(60, 80)
    depth = scenery.depth(rays)
    hit = depth < SKY_DEPTH
    points = scenery.view.to_world((rays * depth[..., None])[hit])
    # Before the surface a ray is outside of everything, and a hair farther inside, unless it grazes an edge.
    before = scenery.height_above((rays * (depth * 0.999)[..., None])[hit])
    behind = scenery.height_above((rays * (depth * 1.001)[..., None])[hit])
    assert before.min() > -1e-6
    assert (behind < 1e-6).mean() > 0.995
    top = np.isclose(points[:, 2], 0.4) & (BOX.distance(points[:, :2]) < 1e-9)
    assert top.any()


def test_camera_and_world_are_one_rigid_motion_apart() -> None:
    view = look((0.3, -1, 2), (1, 6, 0), 0.1)
    points = np.random.default_rng(0).normal(size=(20, 3))
    np.testing.assert_allclose(view.to_world(view.to_camera(points)), points, atol=1e-12)
    assert np.linalg.det(view.rotation) == pytest.approx(1)
    # The target lies on the viewing axis; up points against the image's downwards.
    np.testing.assert_allclose(view.to_camera([1, 6, 0])[:2], 0, atol=1e-12)
    assert view.up[1] < -0.5
