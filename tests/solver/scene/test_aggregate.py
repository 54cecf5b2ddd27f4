import tracemalloc
from dataclasses import replace

import cv2
import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import GroundFrame
from core_solver.scene.aggregate import cloud, ground_depth, median_depth, median_picture
from core_solver.scene.thinning import thin_evenly
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, Modalities

BENT = Camera(320, 240, 300.0, 290.0, 165.0, 118.0, (-0.15, 0.03, 0.002, -0.001, 0.0), "test")


def scene_of(disparity: np.ndarray, labels: np.ndarray) -> Modalities:
    frames = len(disparity)
    times = np.arange(frames) / 25
    return Modalities(times, np.arange(frames), (320, 240), (), labels, disparity.astype(np.float16))


def test_the_median_of_each_frames_own_depth():
    rng = np.random.default_rng(0)
    slope = np.linspace(0, 0.5, 32)
    disparity = (slope + rng.uniform(0, 0.5, (9, 24, 1))).astype(np.float16)
    disparity[:] = disparity[:, :1]
    far, gap = rng.uniform(0.03, 0.05, 9), rng.uniform(0.4, 0.6, 9)
    found = median_depth(scene_of(disparity, np.zeros((9, 24, 32), np.uint8)), far, gap)
    expected = np.median(1 / (far[:, None, None] + gap[:, None, None] * disparity.astype(float)), axis=0)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_tall_maps_are_put_together_in_the_right_order():
    disparity = np.tile(np.linspace(0, 1, 150)[:, None], (3, 1, 20))
    found = median_depth(scene_of(disparity, np.zeros((3, 150, 20), np.uint8)), np.full(3, 0.1), np.full(3, 1.0))
    np.testing.assert_allclose(found, 1 / (0.1 + disparity[0]), rtol=2e-3)


@pytest.mark.parametrize("person", [1, UNCLAIMED])
def test_people_leave_the_background_behind_them_and_never_seen_is_nan(person):
    frames, far, gap = 10, np.full(10, 0.1), np.full(10, 1.0)
    disparity = np.full((frames, 30, 60), 0.2)
    labels = np.zeros((frames, 30, 60), np.uint8)
    for t in range(frames):
        where = (slice(5, 25), slice(5 * t, 5 * t + 8))
        disparity[t][where], labels[t][where] = 0.9, person
    still = (slice(10, 20), slice(20, 30))
    disparity[:, still[0], still[1]], labels[:, still[0], still[1]] = 0.7, person
    found = median_depth(scene_of(disparity, labels), far, gap)
    assert np.isnan(found[still]).all()
    seen = np.isfinite(found)
    np.testing.assert_allclose(found[seen], 1 / 0.3, rtol=1e-3)
    # Around who never moves a rim is unsure, no more.
    unknown = cv2.dilate((~seen).astype(np.uint8), np.ones((1, 1))).sum()
    assert 10 * 10 <= unknown <= 14 * 14


def test_a_thin_person_is_masked_on_a_coarser_depth_map():
    """Labels are finer than disparity: an arm one label wide must not leak into the scene."""
    labels = np.zeros((3, 96, 128), np.uint8)
    labels[:, 20:70, 61] = 1
    disparity = np.full((3, 30, 40), 0.2)
    disparity[:, 6:22, 19] = 0.9
    found = median_depth(scene_of(disparity, labels), np.full(3, 0.1), np.full(3, 1.0))
    assert np.nanmin(found) > 3


def test_of_many_frames_the_first_counts_as_much_as_the_last():
    disparity = np.zeros((300, 4, 4))
    disparity[150:] = 1.0
    disparity[299] = 1.0
    found = median_depth(scene_of(disparity, np.zeros((300, 4, 4), np.uint8)), np.full(300, 0.5), np.full(300, 0.5))
    assert set(np.unique(found)) <= {np.float32(1.0), np.float32(2.0), np.float32(1.5)}


def test_what_only_one_frame_between_the_chosen_ones_shows_is_found():
    labels = np.zeros((200, 30, 30), np.uint8)
    labels[:, 10:20, 10:20] = 1
    labels[77] = 0
    disparity = np.full((200, 30, 30), 0.3)
    disparity[77, 10:20, 10:20] = 0.5
    found = median_depth(scene_of(disparity, labels), np.full(200, 0.1), np.full(200, 1.0), most_frames=10)
    np.testing.assert_allclose(found[13:17, 13:17], 1 / 0.6, rtol=1e-3)
    np.testing.assert_allclose(found[:6], 1 / 0.4, rtol=1e-3)


def test_blurred_edges_leave_nothing_between_the_surfaces():
    column = np.arange(120)
    blurred = np.tile(cv2.GaussianBlur(np.where(column < 60, 0.8, 0.2)[None], (0, 0), 1.0), (5, 40, 1))
    found = median_depth(scene_of(blurred, np.zeros((5, 40, 120), np.uint8)), np.full(5, 0.1), np.full(5, 1.0))
    between = (found > 1 / 0.9 + 0.1) & (found < 1 / 0.3 - 0.1)
    assert between.mean() < 0.001


def test_disparity_that_is_no_number_is_not_seen():
    disparity = np.full((4, 20, 20), 0.5)
    disparity[1], disparity[:, 3, 4] = np.nan, np.inf
    disparity[2, 10, 10] = -5.0  # behind infinity
    found = median_depth(scene_of(disparity, np.zeros((4, 20, 20), np.uint8)), np.full(4, 0.1), np.full(4, 1.0))
    assert np.isnan(found[3, 4])
    rest = found[np.isfinite(found)]
    assert len(rest) >= 399
    np.testing.assert_allclose(rest, 1 / 0.6, rtol=1e-3)


def test_memory_does_not_grow_with_the_clip():
    def peak(frames: int) -> int:
        tiled = np.broadcast_to(np.linspace(0, 1, 96, dtype=np.float16), (frames, 64, 96))
        scene = scene_of(tiled, np.broadcast_to(np.zeros((), np.uint8), (frames, 64, 96)))
        tracemalloc.start()
        median_depth(replace(scene, disparity=tiled), np.full(frames, 0.1), np.full(frames, 1.0))
        _, most = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return most

    assert peak(600) < 1.1 * peak(150)


def test_without_disparity_there_is_nothing_to_aggregate():
    modalities = Modalities(np.zeros(2), np.zeros(2, int), (320, 240), (), np.zeros((2, 3, 4), np.uint8), None)
    with pytest.raises(ValueError, match="disparity"):
        median_depth(modalities, np.ones(2), np.ones(2))


def ground_of(tilt: float, height: float = 1.7) -> GroundFrame:
    up = np.array([0.08, -np.cos(tilt), -np.sin(tilt)])
    up /= np.linalg.norm(up)
    return GroundFrame(-up, up, height)


@pytest.mark.parametrize("camera", [camera_from_fov(320, 240, 60, "test"), BENT])
def test_ground_depth_is_where_rays_meet_the_plane(camera):
    ground = ground_of(0.3)
    depth = ground_depth(camera, ground, (64, 48), 30.0)
    assert depth.shape == (48, 64)
    points = camera.grid_rays(48, 64) * depth[..., None]
    known = np.isfinite(depth)
    assert known.mean() > 0.4
    np.testing.assert_allclose(ground.height_above(points[known]), 0, atol=1e-4)
    assert depth[known].min() > 0
    assert depth[known].max() < 30
    # Each grid cell's own pixel sees the point.
    row, column = np.argwhere(known)[len(np.argwhere(known)) // 2]
    pixel = camera.project(points[row, column])
    np.testing.assert_allclose(pixel, [(column + 0.5) * 5, (row + 0.5) * 5], atol=0.05)


def test_above_the_horizon_there_is_no_ground():
    camera = camera_from_fov(320, 240, 60, "test")
    up = np.array([0.0, -1.0, 0.0])
    depth = ground_depth(camera, GroundFrame(-up, up, 1.6), (32, 24), 1e9)
    assert np.isnan(depth[:12]).all()
    assert np.isfinite(depth[13:]).all()
    assert (np.diff(depth[13:, 5]) < 0).all()  # nearer towards the bottom of the picture


def test_the_ground_ends_where_it_is_told_to():
    depth = ground_depth(camera_from_fov(320, 240, 60, "test"), ground_of(0.05), (64, 48), 8.0)
    assert np.nanmax(depth) <= 8


def walk_video(frames: int = 9):
    """A picture with a pattern before which a red person walks, with labels at half the size."""
    rng = np.random.default_rng(0)
    background = cv2.resize(rng.integers(40, 200, (6, 8, 3)).astype(np.uint8), (160, 120))
    pictures, labels = [], np.zeros((frames, 60, 80), np.uint8)
    for t in range(frames):
        picture = background.copy()
        picture[30:110, 16 * t : 16 * t + 20] = (0, 0, 255)
        labels[t, 15:55, 8 * t : 8 * t + 10] = 1
        pictures.append(picture)
    return background, pictures, labels


def test_the_background_picture_has_nobody_in_it_and_is_rgb():
    background, pictures, labels = walk_video()
    found = median_picture(enumerate(pictures), labels, (160, 120))
    assert found.dtype == np.uint8
    assert np.abs(found.astype(int) - background[..., ::-1].astype(int)).max() <= 1


def test_pictures_go_with_the_labels_of_their_own_frame():
    background, pictures, labels = walk_video()
    chosen = [(t, pictures[t]) for t in (1, 4, 7)]
    found = median_picture(chosen, labels, (160, 120))
    assert np.abs(found.astype(int) - background[..., ::-1].astype(int)).max() <= 1


def test_who_never_moves_stays_in_the_background_picture():
    _, pictures, labels = walk_video(3)
    found = median_picture([(0, pictures[0])] * 3, labels, (160, 120))
    assert found[60, 10].tolist() == [255, 0, 0]


@pytest.mark.parametrize("camera", [camera_from_fov(320, 240, 60, "test"), BENT])
def test_a_cloud_projects_back_onto_its_cells_with_their_colours(camera):
    rng = np.random.default_rng(1)
    depth = rng.uniform(1, 20, (24, 32)).astype(np.float32)
    depth[rng.random((24, 32)) < 0.3] = np.nan
    picture = rng.integers(0, 255, (24, 32, 3)).astype(np.uint8)
    points, colours = cloud(depth, picture, camera, 10_000)
    known = np.isfinite(depth)
    assert len(points) == len(colours) == known.sum()
    rows, columns = np.nonzero(known)
    expected = np.stack([(columns + 0.5) * 10, (rows + 0.5) * 10], axis=-1)
    np.testing.assert_allclose(camera.project(points), expected, atol=0.05)
    np.testing.assert_allclose(points[:, 2], depth[known], rtol=1e-6)
    np.testing.assert_array_equal(colours, picture[known])


def floor_cloud(most: int) -> np.ndarray:
    camera = camera_from_fov(320, 240, 60, "test")
    depth = ground_depth(camera, ground_of(0.3), (160, 120), 12.0)
    return cloud(depth, np.zeros((120, 160, 3), np.uint8), camera, most)[0]


def test_a_cloud_is_thinned_evenly_in_space():
    """A depth map crowds its points near the camera; on a floor every square metre should get as many."""
    every, few = floor_cloud(10**6), floor_cloud(400)
    assert 300 < len(few) <= 400

    def spread(points: np.ndarray) -> float:
        gaps = cKDTree(points).query(points, k=2)[0][:, 1]
        return float(np.quantile(gaps, 0.9) / np.quantile(gaps, 0.1))

    assert spread(every) > 3
    assert spread(few) < 2.6
    # Nothing is left out: every point has a chosen one nearby.
    typical = np.median(cKDTree(few).query(few, k=2)[0][:, 1])
    assert cKDTree(few).query(every)[0].max() < 2.5 * typical


@given(
    hnp.arrays(np.float32, st.tuples(st.integers(1, 200), st.just(3)), elements=st.floats(-50, 50, width=32)),
    st.integers(1, 250),
)
def test_thinning_never_keeps_more_and_is_the_same_every_time(points, most):
    keep = thin_evenly(points, most)
    assert 1 <= len(keep) <= most
    assert (np.diff(keep) > 0).all()
    np.testing.assert_array_equal(keep, thin_evenly(points, most))
    if len(points) <= most:
        assert len(keep) == len(points)


def test_thinned_points_keep_their_colours():
    depth = np.ones((50, 50), np.float32)
    picture = np.random.default_rng(0).integers(0, 255, (50, 50, 3)).astype(np.uint8)
    points, colours = cloud(depth, picture, BENT, 100)
    cell = (BENT.project(points) / (320 / 50, 240 / 50)).astype(int)
    np.testing.assert_array_equal(colours, picture[cell[:, 1], cell[:, 0]])


def test_an_unknown_scene_is_an_empty_cloud():
    points, colours = cloud(np.full((4, 5), np.nan, np.float32), np.zeros((4, 5, 3), np.uint8), BENT, 10)
    assert points.shape == colours.shape == (0, 3)
    assert BACKGROUND == 0
