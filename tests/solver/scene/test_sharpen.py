import cv2
import numpy as np
import pytest

from core_solver.scene.sharpen import sharpen

HEIGHT, WIDTH = 120, 200
ROW, COLUMN = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
EDGES = {
    "upright": COLUMN < 90,
    "level": ROW < 50,
    "slanting": COLUMN + 0.6 * ROW < 130,
    "round": np.hypot(COLUMN - 100, ROW - 60) < 35,
}


def blur(picture: np.ndarray, sigma: float) -> np.ndarray:
    return cv2.GaussianBlur(picture.astype(np.float32), (0, 0), sigma)


@pytest.mark.parametrize("edge", EDGES)
@pytest.mark.parametrize("sigma", [0.7, 1.0, 1.8])
def test_hardly_a_pixel_is_left_between_two_surfaces(edge, sigma):
    truth = np.where(EDGES[edge], 0.8, 0.3)
    blurred = blur(truth, sigma)
    found = sharpen(blurred)
    flying = (np.abs(blurred - 0.55) < 0.2).sum()
    assert (np.abs(found - 0.55) < 0.2).sum() <= 0.02 * flying
    # The edge lies where it was.
    assert (np.abs(found - truth) > 0.1).sum() <= 0.02 * flying


def test_a_person_before_a_floor_keeps_their_outline_and_the_floor_its_slope():
    floor = np.clip((ROW - 30) / 120, 0, 1)
    person = (np.abs(COLUMN - 100) < 15) & (ROW > 20) & (ROW < 80)
    truth = np.where(person, 0.7, floor)
    blurred = blur(truth, 1.2)
    found = sharpen(blurred)
    assert (np.abs(found - truth) > 0.08).sum() < 0.05 * (np.abs(blurred - truth) > 0.08).sum()
    away = cv2.dilate(person.astype(np.uint8), np.ones((25, 25))) == 0
    np.testing.assert_array_equal(found[away], blurred[away])


@pytest.mark.parametrize(
    "surface",
    [
        np.clip((ROW - 40) / 80, 0, 1),  # a floor up to its horizon
        0.2 + 0.003 * COLUMN + 0.002 * ROW,
        np.full((HEIGHT, WIDTH), 0.4),
        0.5 + 0.2 * np.sin(COLUMN / 25) * np.cos(ROW / 30),
    ],
)
def test_smooth_surfaces_stay(surface):
    np.testing.assert_array_equal(sharpen(surface), surface)


def test_steps_that_are_sharp_stay():
    truth = np.where(EDGES["round"], 0.8, 0.3).astype(np.float32)
    np.testing.assert_array_equal(sharpen(truth), truth)


def test_range_and_offset_do_not_matter():
    blurred = blur(np.where(EDGES["slanting"], 0.8, 0.3), 1.3)
    np.testing.assert_allclose(sharpen(40 * blurred - 7), 40 * sharpen(blurred) - 7, atol=1e-4)


def test_a_clip_is_sharpened_frame_by_frame_and_keeps_its_type():
    clip = np.stack([blur(np.where(mask, 0.8, 0.3), 1.2) for mask in EDGES.values()]).astype(np.float16)
    found = sharpen(clip)
    assert found.dtype == np.float16
    for one, frame in zip(found, clip, strict=True):
        np.testing.assert_array_equal(one, sharpen(frame))
    assert sharpen(clip[:0]).shape == (0, HEIGHT, WIDTH)


def test_holes_stay_holes_and_harm_nobody():
    blurred = blur(np.where(EDGES["upright"], 0.8, 0.3), 1.2)
    blurred[20:30, 80:100] = np.nan
    found = sharpen(blurred)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(blurred))
    assert (np.abs(found[50:] - 0.55) < 0.2).sum() == 0
    nothing = np.full((5, 6), np.nan, np.float32)
    assert np.isnan(sharpen(nothing)).all()
    assert sharpen(np.ones((2, 9), np.float32)).tolist() == np.ones((2, 9)).tolist()
