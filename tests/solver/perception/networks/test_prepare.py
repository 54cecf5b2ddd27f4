"""Where pixels go on their way into a network."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.perception.blazepose import inverse, transform
from core_solver.perception.networks.prepare import cut, lay_picture, person_crop, to_tensor
from core_solver.perception.networks.spec import NetworkSpec

PLAIN = NetworkSpec(
    Path("a.toml"), Path("a.onnx"), "rtmo", (64, 48), "NCHW", "rgb", (0.0,) * 3, (1.0,) * 3, 1.0, {}, {}
)

SIDES = st.integers(16, 2000)


@given(st.floats(-500, 3000), st.floats(-500, 3000), st.floats(0, 2000), st.floats(0, 2000), SIDES, SIDES)
def test_crops_go_there_and_back(left, top, across, down, width, height) -> None:
    crop = person_crop(np.float32([left, top, left + across, top + down]), (width, height), 1.25)
    points = np.array([[0, 0], [width, height], [3.5, 7.25]])
    np.testing.assert_allclose(transform(inverse(crop), transform(crop, points)), points, atol=1e-6)
    corners = transform(crop, points[:2])
    # The same scale both ways, the box in the middle, and around it a quarter more than it needs.
    assert crop[0, 0] == crop[1, 1] > 0
    assert crop[0, 1] == crop[1, 0] == 0
    np.testing.assert_allclose(corners.mean(axis=0), [left + across / 2, top + down / 2], atol=1e-2)
    room = (corners[1] - corners[0]) / np.maximum([across, down], 8)
    assert room.min() == pytest.approx(1.25, rel=1e-3)


@given(SIDES, SIDES, SIDES, SIDES, st.sampled_from(["centre", "corner", "stretch"]))
def test_pictures_lie_whole_in_the_input(width: int, height: int, across: int, down: int, fit: str) -> None:
    image = np.full((height, width, 3), 200, np.uint8)
    laid, to_picture = lay_picture(image, (across, down), replace(PLAIN, fit=fit, pad=7))
    assert laid.shape == (down, across, 3)
    inside = transform(inverse(to_picture), np.array([[0, 0], [width, height]], float))
    assert (inside[0] >= -1e-9).all()
    assert (inside[1] <= np.array([across, down]) + 1e-9).all()
    left, top, right, bottom = np.round(inside).astype(int).ravel()
    assert (laid[top:bottom, left:right] == 200).all()
    assert (laid == 200).all(axis=2).sum() == (right - left) * (bottom - top)
    if fit == "stretch":
        assert (left, top, right, bottom) == (0, 0, across, down)
    elif fit == "corner":
        assert (left, top) == (0, 0)
    else:
        assert abs(left - (across - right)) <= 1
        assert abs(top - (down - bottom)) <= 1


@pytest.mark.parametrize("fit", ["centre", "corner", "stretch"])
def test_a_spot_is_found_again_where_it_was(fit: str) -> None:
    image = np.zeros((240, 400, 3), np.uint8)
    image[60:80, 300:320] = 255
    laid, to_picture = lay_picture(image, (160, 160), replace(PLAIN, fit=fit, pad=0))
    rows, columns = np.nonzero(laid[..., 0] > 127)
    middle = np.array([[columns.mean() + 0.5, rows.mean() + 0.5]])
    np.testing.assert_allclose(transform(to_picture, middle), [[310, 70]], atol=1.5)


def test_a_crop_shows_the_person_at_its_place() -> None:
    image = np.zeros((300, 300, 3), np.uint8)
    cv2.rectangle(image, (200, 100), (219, 139), (255, 255, 255), -1)
    crop = person_crop(np.float32([160, 60, 260, 180]), (96, 128), 1.25)
    shown = cut(image, crop, (96, 128))
    assert shown.shape == (128, 96, 3)
    rows, columns = np.nonzero(shown[..., 0] > 127)
    middle = transform(crop, np.array([[columns.mean() + 0.5, rows.mean() + 0.5]]))
    np.testing.assert_allclose(middle, [[210, 120]], atol=0.8)
    # Half outside: what is not in the picture is black.
    outside = cut(
        np.full((300, 300, 3), 255, np.uint8), person_crop(np.float32([-60, 0, 60, 160]), (96, 128), 1), (96, 128)
    )
    assert (outside[:, :40] == 0).all()
    assert (outside[:, 60:] == 255).all()


def test_colour_normalisation_and_layout() -> None:
    picture = np.full((4, 6, 3), (10, 100, 200), np.uint8)  # BGR
    spec = replace(PLAIN, mean=(1.0, 2.0, 3.0), std=(2.0, 4.0, 8.0), scale=0.5)
    tensor = to_tensor(picture, spec)
    assert tensor.shape == (3, 4, 6)
    assert tensor.dtype == np.float32
    np.testing.assert_allclose(tensor[:, 0, 0], [(100 - 1) / 2, (50 - 2) / 4, (5 - 3) / 8])
    swapped = to_tensor(picture, replace(spec, colour="bgr", layout="NHWC"))
    assert swapped.shape == (4, 6, 3)
    np.testing.assert_allclose(swapped[0, 0], [(5 - 1) / 2, (50 - 2) / 4, (100 - 3) / 8])
