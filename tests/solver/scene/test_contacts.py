import numpy as np
import pytest

from core_solver.body.skeleton import keypoint_index
from core_solver.scene.contacts import contact_probability, still_feet
from core_solver.scene.support import build_support
from tests.solver.scene.rooms import BOX

LEFT = [keypoint_index(f"left_{part}") for part in ("heel", "toe", "ankle")]
RIGHT = [keypoint_index(f"right_{part}") for part in ("heel", "toe", "ankle")]
FRAMES, SIZE = 40, 200.0
TIMES = np.arange(FRAMES) / 25


def feet(left_speed: float = 0.0, right_speed: float = 0.0, times: np.ndarray = TIMES) -> np.ndarray:
    """Keypoints (1, T, 25, 2) of a person of 200 pixels whose feet move sideways at these sizes a second."""
    pixels = np.tile(np.random.default_rng(0).normal(size=(25, 2)) * 50 + 300, (1, len(times), 1, 1))
    pixels[0, :, LEFT, 0] += left_speed * SIZE * times
    pixels[0, :, RIGHT, 0] += right_speed * SIZE * times
    return pixels


def still(pixels: np.ndarray, confidence: float | np.ndarray = 0.9, size: float = SIZE, times: np.ndarray = TIMES):
    shape = pixels.shape[:3]
    return still_feet(pixels, np.broadcast_to(confidence, shape), np.full(shape[:2], size), times)


def test_a_resting_foot_is_still_and_a_swinging_one_is_not():
    result = still(feet(0.0, 2.0))
    assert result.shape == (1, FRAMES, 2)
    assert (result[..., 0] > 0.9).all()
    assert (result[..., 1] < 0.05).all()


def test_far_and_near_people_are_judged_alike():
    near = feet(0.3, 0.4)
    np.testing.assert_allclose(still(near), still(near / 10, size=SIZE / 10), atol=1e-9)


def test_speed_is_per_second_at_any_rate_and_at_uneven_times():
    uneven = np.cumsum(np.random.default_rng(1).choice([0.02, 0.04, 0.07], FRAMES))
    slow, fast = (still(feet(0.05, 1.5, times), times=times) for times in (TIMES / 2, uneven))
    for result in (slow, fast):
        assert (result[..., 0] > 0.9).all()
        assert (result[..., 1] < 0.05).all()


def test_a_trembling_detector_does_not_lift_a_resting_foot():
    noise = np.random.default_rng(2).normal(size=(1, FRAMES, 25, 2)) * 0.01 * SIZE
    assert np.median(still(feet() + noise)[..., 0]) > 0.7


def test_a_foot_that_is_not_seen_is_not_said_to_rest():
    confidence = np.full((1, FRAMES, 25), 0.9)
    confidence[0, 5, LEFT] = 0
    confidence[0, 6, LEFT] = 0.25
    result = still(feet(), confidence)
    assert result[0, 5, 0] == 0
    assert 0 < result[0, 6, 0] < 0.6
    assert (result[0, :, 1] > 0.9).all()


@pytest.mark.parametrize("count", [1, 2])
def test_clips_of_one_and_two_frames(count):
    result = still(feet(times=TIMES[:count]), times=TIMES[:count])
    assert (result > 0.9).all()


def contact(height: float, resting: float = 1.0, distance: float = 3.0) -> float:
    result = contact_probability(np.full((1, 1, 2), height), np.full((1, 1, 2), resting), np.full((1, 1), distance))
    assert result.shape == (1, 1, 2)
    return result[0, 0, 1].item()


def test_contact_needs_a_low_foot_and_a_resting_one():
    assert contact(0.0) > 0.9
    assert contact(0.5) < 0.01
    assert contact(0.0, resting=0.0) == 0
    assert contact(0.0, resting=0.4) == pytest.approx(0.4, rel=0.05)


def test_contact_is_two_sided():
    """A one-sided test would call a foot deep below the ground, or everybody who floats, a foot in contact."""
    for height in (0.02, 0.05, 0.1, 0.3):
        assert contact(height) == pytest.approx(contact(-height))
    heights = [contact(h) for h in (0.0, 0.03, 0.06, 0.1, 0.2)]
    assert heights == sorted(heights, reverse=True)


def test_far_feet_are_given_more_room():
    assert contact(0.3, distance=3.0) < 0.05
    assert contact(0.3, distance=30.0) > 0.8


def test_a_foot_on_a_box_is_in_contact_when_the_scene_says_that_it_stands_on_it():
    """Heights are above the support: half a metre above the floor is none above a box of half a metre."""
    depth, camera = BOX.depth(), BOX.camera
    feet = BOX.to_camera([[[[0.1, 3.4, 0.46], [0.8, 3.4, 0.46]]]])  # on the box, and as high beside it
    support = build_support(depth, camera, BOX.ground)
    above = feet @ BOX.up - support.floor_under(feet)
    result = contact_probability(above, np.ones((1, 1, 2)), np.full((1, 1), 3.4))[0, 0]
    assert result[0] > 0.9
    assert result[1] < 0.01
    on_plane = contact_probability(BOX.ground.height_above(feet), np.ones((1, 1, 2)), np.full((1, 1), 3.4))
    assert on_plane.max() < 0.01
