from dataclasses import replace

import numpy as np
import pytest

from core_solver.scene.normals import depth_normals, grid_points
from tests.solver.scene.rooms import BARE, BOX, STAIRS


def seen(room):
    points = grid_points(room.depth(), room.camera)
    return points, depth_normals(points), (points @ room.rotation) + (0, 0, room.camera_height)


@pytest.mark.parametrize("slope", [0.0, 0.2, -0.1])
def test_a_floor_has_its_planes_normal_everywhere(slope):
    room = replace(BARE, slope=slope)
    _, normals, _ = seen(room)
    known = np.isfinite(normals).all(axis=-1)
    assert known.mean() > 0.5
    np.testing.assert_allclose(normals[known] @ room.ground.normal, 1, atol=2e-4)


def test_each_face_of_a_box_has_its_own_normal_up_to_its_edges():
    _, normals, world = seen(BOX)
    top = np.abs(world[..., 2] - 0.45) < 1e-4
    front = (np.abs(world[..., 1] - 3) < 1e-4) & (world[..., 2] < 0.44)
    for face, direction in ((top, (0, 0, 1)), (front, (0, -1, 0))):
        assert face.sum() > 500
        cosine = normals[face] @ BOX.rotation @ direction
        assert np.nanmean(cosine > 0.99) > 0.95  # but where two faces meet within a pixel


def test_normals_look_at_the_camera_and_have_length_one():
    points, normals, _ = seen(STAIRS)
    known = np.isfinite(normals).all(axis=-1)
    assert (np.einsum("hwc,hwc->hw", normals, points)[known] <= 0).all()
    np.testing.assert_allclose(np.linalg.norm(normals[known], axis=-1), 1, atol=1e-6)


def test_holes_have_no_normal_and_their_neighbours_keep_theirs():
    depth = BARE.depth()
    depth[150:160, 200:220] = np.nan
    depth[200, 100] = np.nan
    normals = depth_normals(grid_points(depth, BARE.camera))
    known = np.isfinite(normals).all(axis=-1)
    np.testing.assert_array_equal(known, np.isfinite(depth))
    np.testing.assert_allclose(normals[known] @ BARE.up, 1, atol=2e-4)


def test_a_lone_pixel_has_no_normal():
    depth = np.full((20, 30), np.nan, np.float32)
    depth[5, 6] = 3
    assert np.isnan(depth_normals(grid_points(depth, BARE.camera))).all()
