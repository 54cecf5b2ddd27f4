import cv2
import numpy as np
import pytest

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import GroundFrame
from core_solver.scene.aggregate import cloud, ground_depth, median_depth, median_picture
from core_solver.tracking.tracks import BACKGROUND, UNCLAIMED, Modalities

BENT = Camera(320, 240, 300.0, 290.0, 165.0, 118.0, (-0.15, 0.03, 0.002, -0.001, 0.0), "test")


def scene_of(disparity: np.ndarray, labels: np.ndarray) -> Modalities:
    frames = len(disparity)
    times = np.arange(frames) / 25
    return Modalities(times, np.arange(frames), (320, 240), (), labels, disparity.astype(np.float16))


def test_the_median_of_each_frames_own_depth():
    rng = np.random.default_rng(0)
    disparity = rng.random((9, 24, 32)).astype(np.float16)
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


def test_many_frames_are_thinned_from_first_to_last():
    disparity = np.zeros((300, 4, 4))
    disparity[150:] = 1.0
    disparity[299] = 1.0
    found = median_depth(scene_of(disparity, np.zeros((300, 4, 4), np.uint8)), np.full(300, 0.5), np.full(300, 0.5))
    assert set(np.unique(found)) <= {np.float32(1.0), np.float32(2.0), np.float32(1.5)}


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


def test_a_cloud_is_thinned_evenly():
    depth = np.ones((50, 50), np.float32)
    picture = np.repeat(np.arange(50, dtype=np.uint8)[:, None], 50, axis=1)[..., None].repeat(3, axis=-1)
    points, colours = cloud(depth, picture, BENT, 100)
    assert len(points) == len(colours) == 100
    assert np.ptp(colours[:, 0]) == 49
    assert np.bincount(colours[:, 0] // 10, minlength=5).min() >= 18


def test_an_unknown_scene_is_an_empty_cloud():
    points, colours = cloud(np.full((4, 5), np.nan, np.float32), np.zeros((4, 5, 3), np.uint8), BENT, 10)
    assert points.shape == colours.shape == (0, 3)
    assert BACKGROUND == 0
