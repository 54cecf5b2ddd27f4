import time
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.scene.support import build_support
from tests.solver.scene.rooms import BARE, BOX, NOTHING, STAIRS, Room

RNG = np.random.default_rng(0)
PLACES = np.stack([RNG.uniform(-0.8, 0.8, 400), RNG.uniform(2.7, 7, 400)], axis=1)


def support_of(room: Room, depth: np.ndarray | None = None):
    return build_support(room.depth() if depth is None else depth, room.camera, room.ground)


def ask(room: Room, world: np.ndarray, depth: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Height above the world's zero and trust under points of the world."""
    height, trust = support_of(room, depth).heights_under(room.to_camera(world))
    return room.height_of(height), trust


def lifted(places: np.ndarray, height) -> np.ndarray:
    return np.column_stack([places, np.broadcast_to(height, len(places))])


@pytest.mark.parametrize("above", [-0.05, 0.0, 0.1, 0.6])
def test_a_flat_floor_lies_where_it_is_under_feet_of_any_height(above):
    height, trust = ask(BARE, lifted(PLACES, above))
    np.testing.assert_allclose(height, 0, atol=1e-3)
    assert trust.min() > 0.9


@pytest.mark.parametrize("slope", [0.1, 0.2, -0.12])
def test_a_slope_is_followed(slope):
    room = replace(BARE, slope=slope)
    truth = slope * PLACES[:, 1]
    height, trust = ask(room, lifted(PLACES, truth + 0.03))
    np.testing.assert_allclose(height, truth, atol=3e-3)
    assert trust.min() > 0.7


@pytest.mark.parametrize("above", [-0.07, 0.0, 0.03, 0.12])
def test_every_stair_carries_who_stands_on_it(above):
    step = RNG.integers(0, 5, 200)
    places = np.stack([RNG.uniform(-0.8, 0.8, 200), 3 + 0.28 * step + RNG.uniform(0.05, 0.23, 200)], axis=1)
    truth = 0.17 * (step + 1)
    height, trust = ask(STAIRS, lifted(places, truth + above))
    np.testing.assert_allclose(height, truth, atol=5e-3)
    assert trust.min() > 0.9


def test_the_top_of_a_box_and_the_floor_beside_it():
    top = np.stack([RNG.uniform(-0.36, 0.36, 100), RNG.uniform(3.04, 3.76, 100)], axis=1)
    height, trust = ask(BOX, lifted(top, 0.47))
    np.testing.assert_allclose(height, 0.45, atol=5e-3)
    assert trust.min() > 0.9
    height, _ = ask(BOX, lifted(np.array([[0.47, 3.3], [-0.46, 3.5], [0.0, 2.9]]), 0.02))
    np.testing.assert_allclose(height, 0, atol=5e-3)


def test_what_is_high_above_a_foot_does_not_carry_it():
    """A foot deep inside a box: nothing carries it there, so the ground plane is told, without trust."""
    height, trust = ask(BOX, np.array([[0.0, 3.4, 0.0]]))
    assert trust.tolist() == [0]
    assert height[0] == pytest.approx(0, abs=1e-6)


def test_noise_of_the_depth_is_averaged_and_lowers_the_trust():
    trusts = []
    for noise, error in ((0.0, 1e-3), (0.01, 0.015), (0.02, 0.03)):
        depth = BARE.depth() * (1 + noise * np.random.default_rng(1).normal(size=(256, 448)))
        height, trust = ask(BARE, lifted(PLACES, 0.0), depth.astype(np.float32))
        assert np.quantile(np.abs(height), 0.9) < error
        trusts.append(np.median(trust))
    assert trusts == sorted(trusts, reverse=True)
    assert trusts[-1] < 0.7


def test_a_foot_that_hides_its_floor_stands_on_the_floor_beside_it():
    depth, (x, y) = BARE.depth(), floor_places()
    depth[(np.abs(x) < 0.07) & (y > 3.93) & (y < 5.5)] = np.nan  # the shadow of foot and leg
    height, trust = ask(BARE, np.array([[0.0, 4.0, 0.02], [0.02, 4.1, 0.0]]), depth)
    np.testing.assert_allclose(height, 0, atol=1e-3)
    assert trust.min() > 0.7


def floor_places() -> tuple[np.ndarray, np.ndarray]:
    """World x and y of what each pixel of the bare room shows."""
    points = (BARE.camera.grid_rays(256, 448) * BARE.depth()[..., None]) @ BARE.rotation
    return points[..., 0], points[..., 1]


def test_trust_fades_with_the_distance_to_what_is_known():
    x, y = floor_places()
    trusts = []
    for radius in (0.05, 0.15, 0.2, 0.35):
        depth = BARE.depth()
        depth[np.hypot(x, y - 4) < radius] = np.nan
        height, trust = ask(BARE, np.array([[0.0, 4.0, 0.0]]), depth)
        assert height[0] == pytest.approx(0, abs=1e-3)
        trusts.append(trust[0])
    assert trusts == sorted(trusts, reverse=True)
    assert trusts[0] > 0.9
    assert trusts[-1] == 0


@pytest.mark.parametrize("depth", [np.full((32, 48), np.nan, np.float32), np.full((32, 48), 3.0, np.float32)])
def test_without_a_walkable_surface_there_is_the_plane(depth):
    room = Room(NOTHING, tilt=0.0, slope=0.1)  # a wall right ahead, or nothing at all
    support = support_of(room, depth)
    points = room.to_camera([[0.3, 4.0, 0.2], [-1.0, 2.0, 1.0]])
    height, trust = support.heights_under(points)
    assert trust.tolist() == [0, 0]
    np.testing.assert_allclose(room.height_of(height), [0.4, 0.2], atol=1e-9)
    np.testing.assert_allclose(support.floor_under(points), height)


def test_points_of_any_shape_and_points_that_are_nowhere():
    support = support_of(BARE)
    points = np.broadcast_to(BARE.to_camera([0.0, 4.0, 0.1]), (2, 3, 2, 3)).copy()
    points[0, 1, 0] = np.nan
    height, trust = support.heights_under(points)
    assert height.shape == trust.shape == (2, 3, 2)
    assert np.isfinite(height).all()
    assert trust[0, 1, 0] == 0
    assert (np.delete(trust.ravel(), 2) > 0.9).all()
    assert support.heights_under(np.zeros((0, 3)))[0].shape == (0,)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0, 0.3), st.floats(0, 0.9))
def test_whatever_the_depth_heights_are_finite_and_trust_is_a_share(seed, noise, holes):
    rng = np.random.default_rng(seed)
    depth = BOX.depth(64, 112) * np.exp(noise * rng.normal(size=(64, 112)))
    depth[rng.random(depth.shape) < holes] = np.nan
    points = BOX.to_camera(rng.uniform((-2, 1, -1), (2, 8, 2), (50, 3)))
    support = support_of(BOX, depth.astype(np.float32)).calibrated(points, rng.random(50))
    height, trust = support.heights_under(points)
    assert np.isfinite(height).all()
    assert (trust >= 0).all()
    assert (trust <= 1).all()


def test_soles_lift_a_surface_that_lies_too_low_as_a_whole():
    support = support_of(BARE)
    soles = BARE.to_camera(lifted(PLACES, 0.06 + RNG.normal(size=len(PLACES)) * 0.01))
    found = support.calibrated(soles, np.ones(len(soles)))
    height, _ = found.heights_under(soles)
    np.testing.assert_allclose(BARE.height_of(height), 0.06, atol=0.005)
    assert found.trust > 0.85


def test_soles_on_a_wavy_floor_say_that_it_is_not_to_be_trusted():
    waves = cv2.GaussianBlur(np.random.default_rng(3).normal(size=(256, 448)), (0, 0), 20)
    depth = (BARE.depth() * (1 + 0.08 * waves / waves.std())).astype(np.float32)
    support = support_of(BARE, depth)
    soles = BARE.to_camera(lifted(PLACES, 0.0))
    assert np.median(support.heights_under(soles)[1]) > 0.5  # smooth waves look like a floor
    found = support.calibrated(soles, np.ones(len(soles)))
    assert found.trust < 0.3
    # So the plane takes over.
    before, after = (np.abs(BARE.height_of(s.floor_under(soles))).mean() for s in (support, found))
    assert after < 0.3 * before


def test_soles_on_stairs_confirm_the_stairs():
    step = RNG.integers(0, 5, 200)
    places = np.stack([RNG.uniform(-0.8, 0.8, 200), 3 + 0.28 * step + 0.14], axis=1)
    soles = STAIRS.to_camera(lifted(places, 0.17 * (step + 1) + RNG.normal(size=200) * 0.02))
    rests = (RNG.random(200) < 0.8).astype(float)
    found = support_of(STAIRS).calibrated(soles, rests)
    assert found.trust > 0.95
    assert abs(found.lift) < 0.01
    few = support_of(STAIRS).calibrated(soles[:2], np.ones(2))
    assert (few.trust, few.lift) == (1, 0)


def test_a_clip_is_asked_in_no_time():
    support = support_of(BOX)
    points = BOX.to_camera(RNG.uniform((-1, 2.8, 0), (1, 7, 0.3), (3, 300, 2, 3)))
    start = time.process_time()
    support.heights_under(points)
    assert time.process_time() - start < 0.3
