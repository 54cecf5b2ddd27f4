"""Focal lengths from edges at right angles, against rooms whose edges are projected as they really are."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.camera import Camera, camera_from_fov
from core_solver.camera_estimation.box_world import box_costs
from core_solver.geometry import matrix_from_rotvec

SIZE = (1280, 720)
FOCALS = np.exp(np.linspace(math.log(0.45), math.log(2.2), 61))


def room_frame(pitch: float, turn: float, roll: float) -> np.ndarray:
    """Axes of a room in columns (right, down, away), camera frame; degrees."""
    nod, swing, bank = matrix_from_rotvec(np.radians([[-pitch, 0, 0], [0, turn, 0], [0, 0, roll]]))
    return bank @ nod @ swing


def seen_edges(camera: Camera, frame: np.ndarray, rng: np.random.Generator, count: int = 60) -> np.ndarray:
    """Edges along the room's axes all over the picture, ends half a pixel wrong, each seen in every picture."""
    rays = camera.rays(rng.uniform((100, 100), (SIZE[0] - 100, SIZE[1] - 100), (20 * count, 2)))
    middles = rays / rays[:, 2:] * rng.uniform(4, 8, (20 * count, 1))
    along = frame[:, rng.integers(0, 3, len(middles))].T * rng.uniform(0.2, 0.7, (len(middles), 1))
    pixels = camera.project(np.stack([middles - along, middles + along], axis=1))
    long = np.linalg.norm(pixels[:, 1] - pixels[:, 0], axis=1) > 0.03 * SIZE[0]
    pixels = pixels[long][:count] + rng.normal(0, 0.5, (count, 2, 2))
    return np.column_stack([pixels.reshape(count, 4), np.ones(count)]).astype(np.float32)


def ups(frame: np.ndarray, off_degrees: float = 0.0) -> np.ndarray:
    up = matrix_from_rotvec([math.radians(off_degrees), 0, 0]) @ -frame[:, 1]
    return np.tile(up, (len(FOCALS), 1))


@given(
    fov=st.floats(35, 80), pitch=st.floats(0, 25), turn=st.floats(20, 70), roll=st.floats(-10, 10),
    seed=st.integers(0, 99),
)  # fmt: skip
@settings(max_examples=10, deadline=None)
def test_a_room_seen_over_corner_fixes_the_lens(fov, pitch, turn, roll, seed):
    camera = camera_from_fov(*SIZE, fov, "truth")
    frame = room_frame(pitch, turn, roll)
    costs = box_costs(seen_edges(camera, frame, np.random.default_rng(seed)), SIZE, FOCALS, ups(frame, 5))
    assert costs.min() < -5
    assert abs(math.log(FOCALS[costs.argmin()] * SIZE[0] / camera.fx)) < 0.06


def test_a_wall_seen_straight_on_says_nothing_of_the_lens():
    """Its edges stay parallel in the picture whatever the lens: all focal lengths fit alike."""
    camera = camera_from_fov(*SIZE, 60, "truth")
    frame = room_frame(0, 0, 0)
    rng = np.random.default_rng(0)
    edges = seen_edges(camera, frame, rng, 200)
    flat = np.abs(edges[:, 2:4] - edges[:, :2]).min(axis=1) < 3  # without those that lead away
    costs = box_costs(edges[flat], SIZE, FOCALS, ups(frame))
    assert np.ptp(costs[10:50]) < 1


@pytest.mark.parametrize("seed", range(3))
def test_edges_at_random_show_no_box(seed):
    rng = np.random.default_rng(seed)
    angles, lengths = rng.uniform(0, math.pi, 100), rng.uniform(40, 200, 100)
    half = np.column_stack([np.cos(angles), np.sin(angles)]) * lengths[:, None] / 2
    middles = rng.uniform(0, SIZE, (100, 2))
    edges = np.column_stack([middles - half, middles + half, np.ones(100)]).astype(np.float32)
    assert np.array_equal(box_costs(edges, SIZE, FOCALS, ups(np.eye(3))), np.zeros(len(FOCALS)))


def test_without_edges_nothing_is_said():
    for none in (None, np.zeros((0, 5), np.float32), np.zeros((3, 5), np.float32)):
        assert not box_costs(none, SIZE, FOCALS, ups(np.eye(3))).any()


def test_edges_that_are_all_one_do_no_harm():
    same = np.tile(np.array([10, 10, 200, 50, 1], np.float32), (20, 1))
    assert np.isfinite(box_costs(same, SIZE, FOCALS, ups(np.eye(3)))).all()
