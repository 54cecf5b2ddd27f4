from dataclasses import replace

import cv2
import numpy as np
import pytest

from core_solver.geometry import GroundFrame, matrix_from_rotvec
from core_solver.scene.ground import fit_cloud_plane, fit_ground
from core_solver.scene.normals import depth_normals, grid_points
from tests.solver.scene.rooms import BARE, STAIRS, Room

RNG = np.random.default_rng(0)


def degrees(a: np.ndarray, b: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1, 1))))


def cloud_of(room: Room, relative_error: np.ndarray | float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    points = grid_points((room.depth(128, 224) * (1 + relative_error)).astype(np.float32), room.camera)
    return points.reshape(-1, 3), depth_normals(points).reshape(-1, 3)


def soles_on(room: Room, count: int = 120, noise: float = 0.02) -> np.ndarray:
    """Where feet rested in the room, one row each."""
    rng = np.random.default_rng(7)
    places = rng.uniform((-1.5, 2.5), (1.5, 6.5), (count, 2))
    world = np.column_stack([places, room.slope * places[:, 1] + rng.normal(size=count) * noise])
    return room.to_camera(world)


def guess(room: Room, tilt_degrees: tuple[float, float] = (0, 0), height: float = 1.0) -> GroundFrame:
    """The room's gravity, seen wrongly, as a first guess of both gravity and ground."""
    x, z = np.radians(tilt_degrees)
    up = matrix_from_rotvec([x, 0, 0]) @ matrix_from_rotvec([0, 0, z]) @ room.up
    return GroundFrame(-up, up, room.camera_height * height)


def waves(seed: int) -> np.ndarray:
    """What a network may get wrong: smooth errors of 8 % of the depth."""
    bumps = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(128, 224)), (0, 0), 18)
    return 0.08 * bumps / bumps.std()


def test_a_true_guess_stays():
    fit = fit_ground(guess(BARE), soles_on(BARE, noise=0.0), np.ones(120), *cloud_of(BARE))
    assert degrees(fit.ground.normal, BARE.up) < 0.1
    assert degrees(-fit.ground.gravity, BARE.up) < 0.1
    assert fit.ground.offset == pytest.approx(1.7, abs=0.005)
    assert fit.inlier_share > 0.99
    assert fit.cloud_sigma == pytest.approx(np.radians(1))


@pytest.mark.parametrize("tilt", [(4, 0), (0, 4), (-3, 3)])
@pytest.mark.parametrize("height", [0.9, 1.1])
def test_floor_and_feet_mend_a_tilted_guess(tilt, height):
    prior = guess(BARE, tilt, height)
    fit = fit_ground(prior, soles_on(BARE), np.ones(120), *cloud_of(BARE))
    assert degrees(fit.ground.normal, BARE.up) < 0.25 * degrees(prior.normal, BARE.up)
    assert degrees(-fit.ground.gravity, BARE.up) < 0.75 * degrees(prior.normal, BARE.up)
    assert fit.ground.offset == pytest.approx(1.7, abs=0.03)


@pytest.mark.parametrize("tilt", [(4, 0), (0, 4)])
def test_feet_alone_and_a_floor_alone_do_as_well_as_they_can(tilt):
    prior = guess(BARE, tilt)
    before = degrees(prior.normal, BARE.up)
    feet = fit_ground(prior, soles_on(BARE), np.ones(120))
    floor = fit_ground(prior, np.zeros((0, 3)), np.zeros(0), *cloud_of(BARE))
    assert degrees(feet.ground.normal, BARE.up) < 0.4 * before
    assert degrees(floor.ground.normal, BARE.up) < 0.6 * before
    assert np.isnan(feet.cloud_tilt)
    both = fit_ground(prior, soles_on(BARE), np.ones(120), *cloud_of(BARE))
    assert both.tilt_sigma < min(feet.tilt_sigma, floor.tilt_sigma) < np.radians(3)


@pytest.mark.parametrize("slope", [0.15, -0.15, 0.2])
def test_on_a_ramp_the_ground_slants_and_gravity_does_not(slope):
    ramp = replace(BARE, slope=slope)
    fit = fit_ground(guess(ramp), soles_on(ramp), np.ones(120), *cloud_of(ramp))
    assert degrees(fit.ground.normal, ramp.ground.normal) < 1.5
    assert degrees(-fit.ground.gravity, ramp.up) < 1.5
    assert fit.ground.offset == pytest.approx(ramp.ground.offset, rel=0.03)


def test_a_wavy_floor_has_little_to_say_against_feet():
    planes = [fit_cloud_plane(guess(BARE), *cloud_of(BARE, waves(seed))) for seed in range(4)]
    slopes = np.array([p.slope for p in planes if p is not None])
    sigmas = np.array([p.sigma for p in planes if p is not None])
    assert len(slopes) == 4
    assert sigmas.min() > np.radians(2)
    # The waves' own planes lie wrong, and not by more than is said of them.
    assert np.degrees(np.linalg.norm(slopes, axis=1)).max() > 0.3
    assert 0.05 < np.sqrt(np.mean((slopes / sigmas[:, None]) ** 2)) < 1.2
    fit = fit_ground(guess(BARE), soles_on(BARE), np.ones(120), *cloud_of(BARE, waves(0)))
    assert degrees(fit.ground.normal, BARE.up) < 1


def test_a_wrong_depth_range_tilts_the_cloud_and_not_the_ground():
    """1/D + c turns the floor into another plane, which nothing but the feet can tell from the true one."""
    depth = BARE.depth(128, 224)
    points, normals = cloud_of(BARE, 1 / (1 + 0.04 * depth) - 1)
    plane = fit_cloud_plane(guess(BARE), points, normals)
    assert plane is not None
    assert np.degrees(np.linalg.norm(plane.slope)) > 3
    fit = fit_ground(guess(BARE), soles_on(BARE), np.ones(120), points, normals)
    assert degrees(fit.ground.normal, BARE.up) < 1.5


def test_raised_feet_and_those_in_nonsense_places_do_not_drag_the_plane():
    soles = soles_on(BARE)
    soles[::4] += RNG.uniform(0.1, 0.8, (30, 1)) * BARE.up
    soles[1] = np.nan
    fit = fit_ground(guess(BARE, (2, -2)), soles, np.ones(120))
    assert degrees(fit.ground.normal, BARE.up) < 1.5
    assert fit.ground.offset == pytest.approx(1.7, abs=0.04)
    nonsense = RNG.normal(size=(120, 3)) + np.array([0, 1.7, 4])
    fit = fit_ground(guess(BARE), nonsense, np.ones(120))
    assert degrees(fit.ground.normal, BARE.up) < 6


def test_with_nothing_to_fit_the_guess_stays():
    prior = guess(BARE, (1, 2))
    nothing = np.full((50, 3), np.nan)
    for points in (None, nothing):
        fit = fit_ground(prior, np.zeros((4, 3)), np.zeros(4), points, points)
        np.testing.assert_allclose(fit.ground.normal, prior.normal, atol=1e-12)
        np.testing.assert_allclose(fit.ground.gravity, prior.gravity, atol=1e-12)
        assert fit.ground.offset == pytest.approx(prior.offset)
        assert fit.tilt_sigma == pytest.approx(np.radians(3))
        assert fit.inlier_share == 0


def test_stairs_are_no_floor_that_tilts_the_ground():
    soles = STAIRS.to_camera(np.column_stack([RNG.uniform(-0.8, 0.8, 60), RNG.uniform(2, 2.9, 60), np.zeros(60)]))
    fit = fit_ground(guess(STAIRS), soles, np.ones(60), *cloud_of(STAIRS))
    assert degrees(fit.ground.normal, STAIRS.up) < 3


def test_the_order_of_points_does_not_matter():
    points, normals = cloud_of(BARE, waves(0))
    soles, order = soles_on(BARE), RNG.permutation(len(points))
    a = fit_ground(guess(BARE), soles, np.ones(120), points, normals)
    b = fit_ground(guess(BARE), soles[::-1], np.ones(120), points[order], normals[order])
    np.testing.assert_allclose(a.ground.normal, b.ground.normal, atol=1e-9)
    assert a.tilt_sigma == pytest.approx(b.tilt_sigma)
