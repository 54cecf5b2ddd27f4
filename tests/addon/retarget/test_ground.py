"""The ground against scenes whose heights are known: stairs, slopes, rooms, noise and holes."""

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

TREAD, RISE, STEPS = 0.28, 0.17, 6


def stairs_height(x: np.ndarray) -> np.ndarray:
    """Level to x = 1, then six stairs, then level."""
    return RISE * np.clip(np.floor((x - 1) / TREAD) + 1, 0, STEPS)


def stairs(rng: np.random.Generator, count: int, noise: float) -> np.ndarray:
    """(P, 3) treads, risers, a wall at y = 1 and a ceiling."""
    xy = rng.uniform([0, -1], [4, 1], (count, 2))
    treads = np.column_stack([xy, stairs_height(xy[:, 0])])
    few = count // 3
    step = rng.integers(0, STEPS, few)
    risers = np.column_stack(
        [
            1 + TREAD * step,
            rng.uniform(-1, 1, few),
            RISE * (step + rng.uniform(0, 1, few)),
        ]
    )
    wall = np.column_stack([rng.uniform(0, 4, few), np.ones(few), rng.uniform(0, 2.5, few)])
    ceiling = np.column_stack([rng.uniform([0, -1], [4, 1], (few, 2)), np.full(few, 2.6)])
    points = np.concatenate([treads, risers, wall, ceiling])
    return points + noise * rng.normal(size=points.shape)


def from_edge(x: np.ndarray) -> np.ndarray:
    """Distance to the nearest edge of a stair, metres."""
    edge = np.clip(np.round((x - 1) / TREAD), 0, STEPS - 1)
    return np.abs(x - 1 - TREAD * edge)


@pytest.mark.parametrize(("count", "noise"), [(20_000, 0.01), (100_000, 0.015), (100_000, 0.0)])
def test_stairs_under_noise(addon: Any, count: int, noise: float) -> None:
    rng = np.random.default_rng(1)
    ground = addon("retarget.ground").Ground.from_points(stairs(rng, count, noise))
    xy = rng.uniform([0.1, -0.85], [3.9, 0.85], (4000, 2))
    xy = xy[from_edge(xy[:, 0]) > 0.04]
    truth = stairs_height(xy[:, 0])
    expected = truth + rng.uniform(-0.08, 0.08, len(xy))
    error = np.abs(ground.height(xy, expected) - truth)
    assert np.percentile(error, 99.5) < 0.015
    assert np.median(error) < 0.002


@pytest.mark.parametrize("slope", [0.1, 0.3, 0.5])
def test_slopes_and_holes_in_them(addon: Any, slope: float) -> None:
    rng = np.random.default_rng(2)
    xy = rng.uniform([0, -1], [4, 1], (60_000, 2))
    xy = xy[np.hypot(xy[:, 0] - 2.5, xy[:, 1]) > 0.4]
    points = np.column_stack([xy, slope * xy[:, 0]]) + 0.015 * rng.normal(size=(len(xy), 3))
    ground = addon("retarget.ground").Ground.from_points(points)
    places = rng.uniform([0.1, -0.9], [3.9, 0.9], (3000, 2))
    error = np.abs(ground.height(places, slope * places[:, 0]) - slope * places[:, 0])
    unseen = np.hypot(places[:, 0] - 2.5, places[:, 1]) < 0.38
    assert unseen.sum() > 50
    assert error[~unseen].max() < 0.02
    assert error[unseen].max() < 0.03


def test_furniture_walls_and_ghosts_of_people_do_not_lift_the_floor(addon: Any) -> None:
    rng = np.random.default_rng(3)
    floor = np.column_stack([rng.uniform(-2, 2, (80_000, 2)), np.zeros(80_000)])
    angle = rng.uniform(0, 2 * np.pi, 8000)
    person = np.column_stack([0.2 * np.cos(angle), 0.2 * np.sin(angle), rng.uniform(0.0, 1.7, 8000)])
    sparse_wall = np.column_stack([rng.uniform(-2, 2, 1500), np.full(1500, 1.5), rng.uniform(0, 2, 1500)])
    table = np.column_stack([rng.uniform([-1.5, -1.5], [-0.8, -0.8], (5000, 2)), np.full(5000, 0.72)])
    points = np.concatenate([floor[np.hypot(floor[:, 0], floor[:, 1]) > 0.2], person, sparse_wall, table])
    ground = addon("retarget.ground").Ground.from_points(points + 0.005 * rng.normal(size=points.shape))
    xy = rng.uniform(-1.9, 1.9, (4000, 2))
    assert np.abs(ground.height(xy, np.full(len(xy), 0.05))).max() < 0.02
    assert abs(float(ground.height([-1.1, -1.1], 0.7)) - 0.72) < 0.01
    assert abs(float(ground.height([-1.1, -1.1], 0.0))) < 0.01


def test_without_an_expected_height_the_lower_of_two_floors_counts(addon: Any) -> None:
    rng = np.random.default_rng(4)
    low, high = (np.column_stack([rng.uniform(-1, 1, (20_000, 2)), np.full(20_000, z)]) for z in (0.1, 1.4))
    ground = addon("retarget.ground").Ground.from_points(np.concatenate([low, high]))
    assert abs(float(ground.height([0.2, 0.3])) - 0.1) < 1e-6
    assert abs(float(ground.height([0.2, 0.3], 1.3)) - 1.4) < 1e-6
    only_high = addon("retarget.ground").Ground.from_points(high)
    assert abs(float(only_high.height([0.2, 0.3])) - 1.4) < 1e-6


def test_nothing_seen_is_the_plane(addon: Any) -> None:
    Ground = addon("retarget.ground").Ground
    xy = np.random.default_rng(5).uniform(-9, 9, (3, 4, 2))
    np.testing.assert_array_equal(Ground.flat(0.3).height(xy), np.full((3, 4), 0.3))
    np.testing.assert_array_equal(Ground.from_points(np.zeros((0, 3))).height(xy), np.zeros((3, 4)))
    far = Ground.from_points([[50.0, 50.0, 1.0], [np.nan, 0.0, 0.0], [0.0, np.inf, 0.0]])
    np.testing.assert_array_equal(far.height(xy, 1.0), np.zeros((3, 4)))


@settings(max_examples=25, deadline=None)
@given(
    shift=st.tuples(*[st.integers(-40, 40)] * 2),
    rise=st.floats(-0.3, 0.3),
    seed=st.integers(0, 100),
)
def test_a_moved_scene_has_the_moved_ground(addon: Any, shift: tuple[int, int], rise: float, seed: int) -> None:
    """By whole coarse columns, so that the same points share columns."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-1, 1, (1500, 2))
    points = np.column_stack([xy, 0.2 * xy[:, 0] + 0.01 * rng.normal(size=1500)])
    moved = points + np.array([0.8 * shift[0], 0.8 * shift[1], rise])
    Ground = addon("retarget.ground").Ground
    places = rng.uniform(-0.8, 0.8, (50, 2))
    expected = 0.2 * places[:, 0]
    here = Ground.from_points(points).height(places, expected)
    there = Ground.from_points(moved).height(places + 0.8 * np.array(shift), expected + rise)
    assert np.percentile(np.abs(there - rise - here), 90) < 2e-3
    assert np.abs(here - expected).max() < 0.04


def test_a_million_points_are_quick(addon: Any) -> None:
    points = stairs(np.random.default_rng(6), 500_000, 0.01)
    assert len(points) > 999_000
    start = time.process_time()
    addon("retarget.ground").Ground.from_points(points)
    assert time.process_time() - start < 3.0  # measured 0.5 s; the rest is for slow machines


def test_a_cloud_counts_where_people_stand_on_it(addon: Any) -> None:
    rng = np.random.default_rng(7)
    Ground = addon("retarget.ground").Ground
    points = stairs(rng, 60_000, 0.01)
    xy = rng.uniform([0.2, -0.8], [3.8, 0.8], (300, 2))
    on_stairs = np.column_stack([xy, stairs_height(xy[:, 0]) + 0.05 * rng.normal(size=300)])
    assert float(Ground.under(points, on_stairs).height([3.5, 0.0], 1.0)) > 0.9
    bulging = points + np.column_stack([np.zeros((len(points), 2)), 0.2 * np.sin(3 * points[:, 0])])
    level = np.column_stack([xy, 0.03 * rng.normal(size=300)])
    np.testing.assert_array_equal(Ground.under(bulging, level).height(xy, 0.0), np.zeros(300))
    assert float(Ground.under(points, np.zeros((0, 3))).height([3.5, 0.0], 1.0)) > 0.9


def test_each_place_has_the_surface_that_its_soles_fit(addon: Any) -> None:
    rng = np.random.default_rng(11)
    Ground = addon("retarget.ground").Ground
    scene = stairs(rng, 60_000, 0.01)
    # Metres aside a level floor that the cloud shows a hand's length too high.
    xy = rng.uniform([0, 4], [4, 6], (30_000, 2))
    bulge = np.column_stack([xy, 0.2 + 0.05 * np.sin(xy[:, 0])])
    places = rng.uniform([0.2, 4.2], [3.8, 5.8], (400, 2))
    on_floor = np.column_stack([places, 0.02 * rng.normal(size=400)])
    steps = np.array([1.42, 1.70, 1.98, 2.26])
    on_stairs = np.column_stack([steps, np.zeros(4), stairs_height(steps)])
    ground = Ground.under(np.concatenate([scene, bulge]), np.concatenate([on_floor, on_stairs]))
    np.testing.assert_allclose(ground.height(on_stairs[:, :2], on_stairs[:, 2]), on_stairs[:, 2], atol=0.03)
    np.testing.assert_array_equal(ground.height(places, on_floor[:, 2]), np.zeros(400))
    # Feet on what neither the plane nor the cloud shows stay there.
    raised = on_floor + np.array([0.0, 0.0, 1.0])
    lifted = Ground.under(np.concatenate([scene, bulge]), np.concatenate([raised, on_stairs]))
    np.testing.assert_array_equal(lifted.height(places, raised[:, 2]), raised[:, 2])
