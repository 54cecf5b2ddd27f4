"""Depth pictures against closed forms, and bodies that cannot be drawn."""

import numpy as np
import pytest

from core_solver.camera import camera_from_fov
from core_solver.raster import Pinhole, depth_buffer

GRID = Pinhole(32, 24, 20.0, 30.0, 16.0, 12.0)
FACE = [[0, 1, 2]]


def on_pixels(corners: list[tuple[float, float]], depths: list[float]) -> np.ndarray:
    """Vertices that project at the given pixel coordinates, at the given depths."""
    u, v = np.array(corners, float).T
    z = np.array(depths, float)
    return np.stack([(u - GRID.cx) / GRID.fx * z, (v - GRID.cy) / GRID.fy * z, z], axis=-1)[None]


def test_a_slanted_triangle_has_the_depth_of_its_plane() -> None:
    # Anticlockwise for the camera, with y pointing down: down the left side first.
    vertices = on_pixels([(4, 3), (4, 21), (28, 3)], [2.0, 4.0, 8.0])
    depth, face = depth_buffer(vertices, FACE, GRID)
    a, b, c = vertices[0]
    normal = np.cross(b - a, c - a)
    u, v = np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5)
    rays = np.stack([(u - GRID.cx) / GRID.fx, (v - GRID.cy) / GRID.fy, np.ones_like(u)], axis=-1)
    plane = (a @ normal) / (rays @ normal)
    inside = (u > 4) & (v > 3) & ((u - 4) / 24 + (v - 3) / 18 < 1)
    assert np.array_equal(face[0] == 0, inside)
    np.testing.assert_allclose(depth[0][inside], plane[inside], rtol=2e-6)
    assert np.all(np.isinf(depth[0][~inside]))


def test_a_face_seen_from_behind_is_not_drawn() -> None:
    vertices = on_pixels([(4, 3), (4, 21), (28, 3)], [2.0, 2.0, 2.0])
    assert (depth_buffer(vertices, [[0, 2, 1]], GRID)[1] == -1).all()


def test_the_nearer_of_two_faces_is_seen_whatever_their_order() -> None:
    square = [(4, 3), (4, 21), (28, 3)]
    vertices = np.concatenate([on_pixels(square, [3.0] * 3), on_pixels(square, [2.0] * 3)], axis=1)
    for faces, nearest in (([[0, 1, 2], [3, 4, 5]], 1), ([[3, 4, 5], [0, 1, 2]], 0)):
        depth, face = depth_buffer(vertices, faces, GRID)
        assert set(np.unique(face)) == {-1, nearest}
        np.testing.assert_allclose(depth[np.isfinite(depth)], 2.0, rtol=1e-6)


def test_faces_with_a_common_edge_leave_no_pinhole() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        fan = [(rng.uniform(8, 24), rng.uniform(6, 18)), (2, 2), (2, 22), (30, 22), (30, 2)]
        vertices = on_pixels(fan, rng.uniform(1, 5, 5).tolist())
        _, face = depth_buffer(vertices, [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]], GRID)
        assert (face[0, 2:22, 2:30] >= 0).all()
        assert (face >= 0).sum() == 20 * 28


@pytest.mark.parametrize("depths", [[2.0, 2.0, -1.0], [2.0, 2.0, 0.0], [2.0, 2.0, 0.04], [2.0, np.nan, 2.0]])
def test_a_face_with_a_vertex_that_cannot_be_seen_is_not_drawn(depths: list[float]) -> None:
    vertices = on_pixels([(4, 3), (4, 21), (28, 3)], [2.0, 2.0, 2.0])
    vertices[0, :, 2] = depths
    depth, face = depth_buffer(vertices, FACE, GRID)
    assert (face == -1).all()
    assert np.isinf(depth).all()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e38, -1e38])
def test_any_number_in_a_vertex_is_survived(value: float) -> None:
    for axis in range(3):
        vertices = on_pixels([(4, 3), (4, 21), (28, 3)], [2.0, 2.0, 2.0])
        vertices[0, 1, axis] = value
        depth, face = depth_buffer(vertices, FACE, GRID)
        assert not np.isnan(depth).any()
        # A vertex far away in front of the camera is an ordinary one.
        assert (face == -1).all() or (axis == 2 and value == 1e38)


def test_a_face_larger_than_the_grid_is_cut() -> None:
    depth, _ = depth_buffer(on_pixels([(-900, -900), (-900, 2700), (2700, -900)], [2.0] * 3), FACE, GRID)
    np.testing.assert_allclose(depth, 2.0, rtol=1e-5)


def test_no_bodies_and_no_faces_are_empty_pictures() -> None:
    assert depth_buffer(np.zeros((0, 3, 3)), FACE, GRID)[0].shape == (0, 24, 32)
    assert np.isinf(depth_buffer(np.zeros((1, 3, 3)), np.zeros((0, 3)), GRID)[0]).all()


def test_a_grid_is_laid_over_the_whole_image() -> None:
    camera = camera_from_fov(640, 480, 60, "test")
    pinhole = Pinhole.on_grid(camera, 160, 60)
    u, v = camera.project([[0.3, 0.2, 2.0]])[0]
    assert pinhole.fx * 0.15 + pinhole.cx == pytest.approx(u / 4)
    assert pinhole.fy * 0.1 + pinhole.cy == pytest.approx(v / 8)
