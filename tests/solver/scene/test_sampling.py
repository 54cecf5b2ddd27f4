from dataclasses import replace

import numpy as np
import pytest

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import matrix_from_rotvec
from core_solver.scene import sampling
from core_solver.scene.sampling import sample_bodies, sample_floor, sample_frames, sample_grid
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, Modalities, Track
from tests.solver.body.synthetic import make_stick_body
from tests.solver.scenes import Walker, make_clip

CAMERA = Camera(400, 200, 300.0, 300.0, 200.0, 100.0)
BODY = make_stick_body()


def test_a_grid_is_laid_over_the_whole_image():
    grid = np.arange(8.0).reshape(2, 4)  # cells of 100 x 100 pixels
    pixels = np.array([[0.0, 0.0], [99.9, 99.9], [100.0, 0.0], [399.9, 0.0], [0.0, 100.0], [399.9, 199.9]])
    assert sample_grid(grid, pixels, CAMERA, outside=-1).tolist() == [0, 0, 1, 3, 4, 7]


@pytest.mark.parametrize(
    "pixel", [(-0.01, 50), (400.0, 50), (50, -0.01), (50, 200.0), (1e12, 0), (np.nan, 3), (3, np.inf), (-np.inf, 3)]
)
def test_outside_the_image_there_is_nothing(pixel):
    grid = np.ones((2, 4))
    assert sample_grid(grid, np.array([pixel]), CAMERA, outside=-1).tolist() == [-1]


def test_grids_need_not_divide_the_image():
    grid = np.arange(21.0).reshape(3, 7)
    columns, rows = np.meshgrid(np.arange(400), np.arange(200))
    values = sample_grid(grid, np.stack([columns, rows], -1) + 1e-6, CAMERA, outside=-1)
    np.testing.assert_array_equal(values, grid[rows * 3 // 200, columns * 7 // 400])


def surface() -> tuple[np.ndarray, np.ndarray]:
    """Points (P, 3) all over the box person's skin and their outward normals."""
    corners = BODY.template[BODY.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    shares = np.random.default_rng(0).dirichlet(np.ones(3), (len(corners), 8))
    points = np.einsum("fsc,fcx->fsx", shares, corners).reshape(-1, 3)
    return points, np.repeat(normals / np.linalg.norm(normals, axis=1, keepdims=True), 8, axis=0)


SKIN, NORMALS = surface()


def person_facing(heading: float) -> tuple[np.ndarray, Modalities, Camera]:
    """A T-posed box person 4 m away; at 0 facing the camera. Everything is labelled as theirs."""
    camera = camera_from_fov(960, 720, 60, "test")
    upright = matrix_from_rotvec([np.pi, 0, 0]) @ matrix_from_rotvec([0, heading, 0])
    points = SKIN @ upright.T + np.array([0, 0, 4.0])
    labels = np.ones((1, 36, 48), np.uint8)
    disparity = np.tile(np.linspace(0, 1, 48, dtype=np.float16), (1, 36, 1))
    track = Track(
        1, np.ones(1, bool), np.zeros((1, 25, 2), np.float32), np.ones((1, 25), np.float32),
        np.zeros((1, 25, 3), np.float32), 1.0,
    )  # fmt: skip
    modalities = Modalities(np.zeros(1), np.zeros(1, int), (960, 720), (track,), labels, disparity)
    return points[None, None], modalities, camera


@pytest.mark.parametrize(("heading", "front_is_seen"), [(0.0, True), (np.pi, False)])
def test_the_side_towards_the_camera_is_seen_and_the_other_is_not(heading, front_is_seen):
    points, modalities, camera = person_facing(heading)
    visible = sample_bodies(points, np.ones((1, 1), bool), modalities, camera).visible[0, 0]
    # Of the trunk: hands and arms are so thin that both sides count as one surface.
    trunk = (np.abs(SKIN[:, 0]) < 0.15) & (SKIN[:, 1] > -0.1) & (SKIN[:, 1] < 0.25)
    front, back = visible[trunk & (NORMALS[:, 2] > 0.9)], visible[trunk & (NORMALS[:, 2] < -0.9)]
    seen, hidden = (front, back) if front_is_seen else (back, front)
    assert seen.mean() > 0.9
    assert hidden.mean() < 0.1


def test_disparity_is_read_where_the_vertex_is_seen():
    points, modalities, camera = person_facing(0.3)
    found = sample_bodies(points, np.ones((1, 1), bool), modalities, camera)
    columns = np.floor(camera.project(points[0, 0])[:, 0] / 20).astype(int)
    seen = found.visible[0, 0]
    expected = np.linspace(0, 1, 48, dtype=np.float16)[columns]
    np.testing.assert_allclose(found.disparity[0, 0, seen], expected[seen], atol=1e-3)
    assert (found.disparity[0, 0, ~seen] == 0).all()
    assert found.mean_disparity[0, 0] == pytest.approx(expected[seen].astype(float).mean(), abs=1e-3)
    assert found.weight[0, 0] == 1


def test_the_mask_of_somebody_else_hides():
    points, modalities, camera = person_facing(0.0)
    for value in (BACKGROUND, 2, UNCLAIMED):
        hidden = sample_bodies(
            points, np.ones((1, 1), bool), replace(modalities, labels=np.full_like(modalities.labels, value)), camera
        )
        assert not hidden.visible.any()
        assert hidden.weight[0, 0] == 0
        assert hidden.mean_disparity[0, 0] == 0


def test_frames_without_the_person_and_people_outside_have_no_weight():
    points, modalities, camera = person_facing(0.0)
    absent = sample_bodies(points, np.zeros((1, 1), bool), modalities, camera)
    outside = sample_bodies(points + np.array([50.0, 0, 0]), np.ones((1, 1), bool), modalities, camera)
    behind = sample_bodies(points - np.array([0, 0, 8.0]), np.ones((1, 1), bool), modalities, camera)
    for found in (absent, outside, behind):
        assert not found.visible.any()
        assert found.weight[0, 0] == 0


def test_without_a_depth_network_visibility_is_still_known():
    points, modalities, camera = person_facing(0.0)
    found = sample_bodies(points, np.ones((1, 1), bool), replace(modalities, disparity=None), camera)
    assert found.visible.any()
    assert not found.disparity.any()


def test_floor_samples_lie_on_the_floor_beside_the_feet():
    clip = make_clip(BODY, [Walker(1.0, (-1, 5), 0.5), Walker(1.0, (1, 6), -1.0)], frames=6, noise_px=0)
    feet = clip.camera.project(clip.joints[:, :, [7, 8]])
    sizes = np.full((2, 6), 250.0)
    found = sample_floor(feet, np.ones((2, 6, 2)), sizes, clip.modalities, clip.camera)
    assert len(found.rays) == len(found.disparity) == len(found.people) > 10
    # The one on the left is the first.
    assert (found.rays[found.people == 0, 0] < 0).all()
    assert (found.rays[found.people == 1, 0] > 0).all()
    # The disparity under each ray is that of the true floor: depth = height / -(ray . up).
    truth = clip.camera_height / -(found.rays @ clip.up)
    far, gap = 1 / 30, 1 / 1.5 - 1 / 30
    assert np.median(np.abs(np.log((far + gap * found.disparity) * truth))) < 0.03


def test_no_floor_is_sampled_under_lifted_feet_people_or_without_depth():
    clip = make_clip(BODY, [Walker(1.0, (-1, 5), 0.5)], frames=3)
    feet, sizes = clip.camera.project(clip.joints[:, :, [7, 8]]), np.full((1, 3), 250.0)
    crowded = replace(clip.modalities, labels=np.full_like(clip.modalities.labels, UNCLAIMED))
    for planted, modalities in (
        (np.zeros((1, 3, 2)), clip.modalities),
        (np.ones((1, 3, 2)), replace(clip.modalities, disparity=None)),
        (np.ones((1, 3, 2)), crowded),
    ):
        found = sample_floor(feet, planted, sizes, modalities, clip.camera)
        assert found.rays.shape == (0, 3)
        assert found.disparity.shape == (0,)


def test_floor_samples_are_limited_in_number():
    clip = make_clip(BODY, [Walker(1.0, (-1, 5), 0.5)], frames=40)
    feet, sizes = clip.camera.project(clip.joints[:, :, [7, 8]]), np.full((1, 40), 250.0)
    found = sample_floor(feet, np.ones((1, 40, 2)), sizes, clip.modalities, clip.camera, most=40)
    assert 10 < len(found.rays) <= 60
    # They follow the walker to the end.
    assert np.ptp(found.rays[:, 0]) > 0.8 * np.ptp(clip.camera.rays(feet)[..., 0])


def test_many_bodies_at_once_are_each_seen_as_if_alone(monkeypatch):
    walkers = [Walker(1.0, (-0.4, 4), 0.5), Walker(0.9, (0.3, 5), -1.0), Walker(1.1, (0.0, 7), 2.0)]
    clip = make_clip(BODY, walkers, frames=9)
    valid = np.random.default_rng(0).random((3, 9)) < 0.8
    monkeypatch.setattr(sampling, "_CHUNK_POINTS", 2 * clip.vertices.shape[2])  # several chunks a person
    together = sample_bodies(clip.vertices, valid, clip.modalities, clip.camera)
    assert 0.1 < together.visible[valid].mean() < 0.9
    for n, t in np.ndindex(3, 9):
        of_frame = replace(
            clip.modalities,
            tracks=clip.modalities.tracks[n : n + 1],
            labels=clip.modalities.labels[t : t + 1],
            disparity=clip.modalities.disparity[t : t + 1],
        )
        alone = sample_bodies(clip.vertices[n : n + 1, t : t + 1], valid[n : n + 1, t : t + 1], of_frame, clip.camera)
        for name in ("visible", "disparity", "mean_disparity", "weight"):
            np.testing.assert_array_equal(getattr(together, name)[n, t], getattr(alone, name)[0, 0])


def test_a_body_that_is_nowhere_is_not_seen_and_harms_nobody():
    clip = make_clip(BODY, [Walker(1.0, (-0.4, 4), 0.5)], frames=3)
    points = clip.vertices.copy()
    points[0, 1] = np.nan
    points[0, 2, :3] = np.inf
    found = sample_bodies(points, np.ones((1, 3), bool), clip.modalities, clip.camera)
    assert not found.visible[0, 1].any()
    assert found.visible[0, 0].any()
    assert np.isfinite(found.mean_disparity).all()


def test_grids_of_several_frames_are_each_read_for_their_own_pixels():
    grids = np.arange(24.0).reshape(3, 2, 4)
    pixels = np.array([[50.0, 50.0], [350.0, 150.0], [150.0, 150.0]])
    assert sample_frames(grids, np.array([2, 0, 1]), pixels, CAMERA, outside=-1).tolist() == [16, 7, 13]
