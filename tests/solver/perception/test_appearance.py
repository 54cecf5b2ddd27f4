"""Clothes of painted people."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.perception.appearance import APPEARANCE_SIZE, describe_clothes
from tests.solver.perception.people import standing_pose

BODY = np.concatenate([standing_pose(128, 0).keypoints * (1, 0.6), np.zeros((8, 2))]).astype(np.float32)


def person(shirt: tuple[int, int, int], trousers: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """A crop with grey background, and the mask."""
    crop = np.full((256, 256, 3), 120, np.uint8)
    mask = np.zeros((256, 256), np.float32)
    hips = int(BODY[11, 1])
    mask[10:240, 60:200] = 1
    crop[10:hips, 60:200] = shirt
    crop[hips:240, 60:200] = trousers
    return crop, mask


def describe(shirt, trousers) -> np.ndarray:
    return describe_clothes(*person(shirt, trousers), BODY)


def test_same_clothes_match_and_others_do_not() -> None:
    red_blue = describe((30, 30, 200), (150, 60, 40))
    darker = describe((20, 20, 180), (135, 50, 35))
    swapped = describe((150, 60, 40), (30, 30, 200))
    grey = describe((128, 128, 128), (60, 60, 60))
    assert red_blue @ darker > 0.95
    assert red_blue @ swapped < 0.8
    assert red_blue @ grey < 0.8


def test_only_the_person_counts() -> None:
    crop, mask = person((30, 30, 200), (150, 60, 40))
    painted = crop.copy()
    painted[mask == 0] = (0, 255, 0)
    np.testing.assert_array_equal(describe_clothes(crop, mask, BODY), describe_clothes(painted, mask, BODY))


def test_without_pixels_it_is_still_a_unit_vector() -> None:
    crop, mask = person((1, 2, 3), (3, 2, 1))
    vector = describe_clothes(crop, np.zeros_like(mask), BODY)
    assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-5)


@given(st.integers(0, 2**32 - 1))
def test_any_keypoints_give_a_unit_vector(seed: int) -> None:
    rng = np.random.default_rng(seed)
    crop, mask = person((30, 30, 200), (150, 60, 40))
    vector = describe_clothes(crop, mask, rng.normal(0, 500, (25, 2)).astype(np.float32))
    assert vector.shape == (APPEARANCE_SIZE,)
    assert np.linalg.norm(vector) == pytest.approx(1, abs=1e-5)
