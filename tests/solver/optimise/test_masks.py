"""Grids freed of distortion, against OpenCV's own undistortion."""

import cv2
import numpy as np
import pytest

from core_solver.camera import Camera
from core_solver.optimise.masks import ideal_grids, raster_grid

BARREL = Camera(480, 360, 400.0, 380.0, 235.0, 185.0, (-0.25, 0.06, 0.002, -0.001, 0.0), "truth")
STRAIGHT = Camera(480, 360, 400.0, 380.0, 235.0, 185.0, (0.0, 0.0, 0.0, 0.0, 0.0), "truth")


def smooth_picture(rows: int, columns: int) -> np.ndarray:
    """Values that tell where they come from."""
    y, x = np.mgrid[:rows, :columns]
    return (100 * np.sin(x / columns * 5) + 100 * np.cos(y / rows * 4)).astype(np.float32)


def test_a_grid_keeps_the_pictures_shape_and_is_no_finer_than_it():
    assert (raster_grid(BARREL, 160).width, raster_grid(BARREL, 160).height) == (160, 120)
    assert (raster_grid(BARREL, 5000).width, raster_grid(BARREL, 5000).height) == (480, 360)
    assert raster_grid(BARREL, 160).fx == pytest.approx(400 / 3)
    portrait = Camera(360, 480, 400.0, 380.0, 185.0, 235.0, (0.0, 0.0, 0.0, 0.0, 0.0), "truth")
    assert (raster_grid(portrait, 160).width, raster_grid(portrait, 160).height) == (120, 160)


def test_of_a_straight_lens_nothing_changes():
    grids = np.random.default_rng(0).integers(0, 5, (2, 360, 480)).astype(np.uint8)
    np.testing.assert_array_equal(ideal_grids(grids, STRAIGHT, raster_grid(STRAIGHT, 480)), grids)


def test_of_a_coarse_grid_every_cell_is_read():
    """A grid of another resolution is laid over the whole picture, corner on corner."""
    grids = np.arange(12, dtype=np.uint8).reshape(1, 3, 4)
    found = ideal_grids(grids, STRAIGHT, raster_grid(STRAIGHT, 480))
    np.testing.assert_array_equal(found[0], np.kron(grids[0], np.ones((120, 120), np.uint8)))


@pytest.mark.parametrize("long_side", [480, 240])
def test_a_distorted_picture_becomes_opencvs_undistorted_one(long_side):
    picture = smooth_picture(360, 480)
    pinhole = raster_grid(BARREL, long_side)
    found = ideal_grids(picture[None], BARREL, pinhole)[0]
    # OpenCV counts from the centre of the first pixel, we from its corner.
    matrix = BARREL.matrix - np.array([[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]])
    target = np.array([[pinhole.fx, 0, pinhole.cx - 0.5], [0, pinhole.fy, pinhole.cy - 0.5], [0, 0, 1]])
    maps = cv2.initUndistortRectifyMap(
        matrix, np.array(BARREL.distortion), None, target, (pinhole.width, pinhole.height), cv2.CV_32FC1
    )
    truth = cv2.remap(picture, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    # Nearest values are at most half a pixel off.
    steepest = max(np.abs(np.diff(picture, axis=axis)).max() for axis in (0, 1))
    assert np.abs(found - truth).max() < 1.5 * steepest
    assert np.abs(found - truth).mean() < 0.6 * steepest
    # The lens does bend this picture: without undistortion the comparison fails by far.
    plain = cv2.resize(picture, (pinhole.width, pinhole.height))
    assert np.abs(plain - truth).max() > 5 * steepest


def test_beyond_the_footage_the_border_goes_on():
    pincushion = Camera(480, 360, 200.0, 200.0, 240.0, 180.0, (0.3, 0.0, 0.0, 0.0, 0.0), "truth")
    grids = np.zeros((1, 360, 480), np.uint8)
    grids[:, 0], grids[:, -1], grids[:, :, 0], grids[:, :, -1] = 7, 7, 7, 7
    found = ideal_grids(grids, pincushion, raster_grid(pincushion, 480))[0]
    assert (found[[0, 0, -1, -1], [0, -1, 0, -1]] == 7).all()
    assert found[180, 240] == 0


def test_types_stay():
    for kind in (np.uint8, np.float16):
        assert ideal_grids(np.zeros((1, 4, 4), kind), BARREL, raster_grid(BARREL, 32)).dtype == kind
