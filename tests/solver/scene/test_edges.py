"""Gravity from straight edges, against rooms whose edges are drawn where they really are."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import matrix_from_rotvec
from core_solver.scene.edges import find_cues, find_edges

SIZE = (960, 540)
CAMERA = camera_from_fov(*SIZE, 65, "truth")
NOBODY = np.zeros((1, 54, 96), np.uint8)
CAMERA_HEIGHT = 1.7


def frame_of(tilt: float, roll: float) -> np.ndarray:
    """Columns right, up and away of a room, camera frame, for a camera that looks down by `tilt` and is rolled."""
    room = np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, 1]]).T
    return matrix_from_rotvec([0, 0, np.radians(roll)]) @ matrix_from_rotvec([np.radians(tilt), 0, 0]) @ room


def draw(segments: np.ndarray, frame: np.ndarray, camera: Camera = CAMERA) -> np.ndarray:
    """A picture of dark edges (S, 2, 3), metres right, up from the floor and away, on a bright wall."""
    picture = np.full((camera.height, camera.width, 3), 200, np.uint8)
    thickness = round(3 * camera.width / SIZE[0])
    for ends in segments:
        places = (np.linspace(ends[0], ends[1], 40) - (0, CAMERA_HEIGHT, 0)) @ frame.T
        pixels = np.round((camera.project(places[places[:, 2] > 0.3]) - 0.5) * 16).astype(np.int32)
        cv2.polylines(picture, [pixels[:, None]], isClosed=False, color=(60, 60, 60), thickness=thickness, shift=4)
    return picture


def posts(rng: np.random.Generator, count: int) -> np.ndarray:
    feet = np.column_stack([rng.uniform(-2.5, 2.5, count), np.zeros(count), rng.uniform(4, 7, count)])
    return np.stack([feet, feet + np.column_stack([np.zeros(count), rng.uniform(1.5, 2.6, count), np.zeros(count)])], 1)


def rails(places: list[float]) -> np.ndarray:
    """Edges on the floor that lead away from the camera: upright in the picture where they are in its middle."""
    return np.array([[[x, 0, 2.2], [x, 0, 6]] for x in places])


def degrees_off(cues, frame: np.ndarray) -> float:
    """Between true up and the direction most nearly at right angles to all cues."""
    up = np.linalg.svd(np.sqrt(cues.weights)[:, None] * cues.normals)[2][-1]
    return float(np.degrees(np.arccos(min(abs(up @ frame[:, 1]), 1))))


def leant(up: np.ndarray, degrees: float, around: float = 0.0) -> np.ndarray:
    axis = np.cross(up, [np.cos(around), 0.1, np.sin(around)])
    return matrix_from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)) @ up


@given(tilt=st.floats(5, 25), roll=st.floats(-15, 15), seed=st.integers(0, 99), around=st.floats(0, 6.2))
@settings(max_examples=15, deadline=None)
def test_posts_show_up_though_people_lean(tilt, roll, seed, around):
    frame = frame_of(tilt, roll)
    edges = find_edges([(0, draw(posts(np.random.default_rng(seed), 8), frame))], NOBODY)
    cues = find_cues(edges, CAMERA, leant(frame[:, 1], 5, around))
    assert cues is not None
    assert degrees_off(cues, frame) < 2.5


def test_a_rail_on_the_floor_is_not_taken_for_a_post():
    """Straight ahead it looks upright; its parallel neighbours betray it."""
    frame = frame_of(18, 0)
    rng = np.random.default_rng(3)
    scene = np.concatenate([posts(rng, 5), rails([-1.6, -1.1, 0.12, 0.25, 1.2, 1.7])])
    cues = find_cues(find_edges([(0, draw(scene, frame))], NOBODY), CAMERA, leant(frame[:, 1], 5))
    assert cues is not None
    assert degrees_off(cues, frame) < 0.7
    away = np.abs(cues.normals @ frame[:, 2])
    assert away.max() > 0.999  # the rails' own direction is a cue: it is level


def test_level_edges_alone_show_up():
    frame = frame_of(12, 6)
    shelves = np.array([[[-2, y, 5], [2, y, 5]] for y in (0.2, 0.6, 1.0, 1.4, 1.8, 2.2)])
    scene = np.concatenate([shelves, rails([-1.8, -1.3, -0.8, 0.8, 1.3, 1.8])])
    cues = find_cues(find_edges([(0, draw(scene, frame))], NOBODY), CAMERA, leant(frame[:, 1], 4))
    assert cues is not None
    assert degrees_off(cues, frame) < 1.0


def test_edges_on_people_are_not_the_scenes():
    frame = frame_of(10, 0)
    picture = draw(posts(np.random.default_rng(1), 6), frame)
    someone = NOBODY.copy()
    someone[0, :, 20:80] = 7
    free, hidden = (find_edges([(0, picture)], labels) for labels in (NOBODY, someone))
    middle = (free[:, [0, 2]] > 200).all(axis=1) & (free[:, [0, 2]] < 800).all(axis=1)
    assert middle.any()
    assert not ((hidden[:, [0, 2]] > 200).all(axis=1) & (hidden[:, [0, 2]] < 800).all(axis=1)).any()


def test_black_bars_at_the_border_are_no_edges():
    picture = np.full((SIZE[1], SIZE[0], 3), 180, np.uint8)
    picture[:, :4] = picture[:, -4:] = 0
    picture[:3] = picture[-3:] = 0
    assert len(find_edges([(0, picture)], NOBODY)) == 0


def test_an_edge_in_every_picture_counts_once():
    picture = draw(posts(np.random.default_rng(2), 4), frame_of(10, 0))
    once, often = (find_edges([(0, picture)] * count, NOBODY) for count in (1, 5))
    assert len(often) == 5 * len(once)
    assert often[:, 4].sum() == pytest.approx(once[:, 4].sum())


def test_large_pictures_give_the_same_up():
    frame = frame_of(10, 5)
    camera = camera_from_fov(4 * SIZE[0], 4 * SIZE[1], 65, "truth")
    large = draw(posts(np.random.default_rng(2), 8), frame, camera)
    cues = find_cues(find_edges([(0, large)], NOBODY), camera, leant(frame[:, 1], 5))
    assert cues is not None
    assert degrees_off(cues, frame) < 1.5


@pytest.mark.parametrize("scene", [np.zeros((0, 2, 3)), np.array([[[0.5, 0.0, 4.0], [0.5, 0.4, 4.0]]])])
def test_too_few_edges_say_nothing(scene):
    frame = frame_of(10, 0)
    assert find_cues(find_edges([(0, draw(scene, frame))], NOBODY), CAMERA, frame[:, 1]) is None


def test_clutter_says_little():
    """Edges of all directions may hold some that agree by chance, yet they never pull up far."""
    rng = np.random.default_rng(5)
    ends = rng.uniform((0, 0), SIZE, (200, 2, 2))
    edges = np.column_stack([ends.reshape(-1, 4), np.ones(200)]).astype(np.float32)
    guess = frame_of(10, 0)[:, 1]
    cues = find_cues(edges, CAMERA, guess)
    if cues is not None:
        form = (cues.normals * cues.weights[:, None]).T @ cues.normals / np.radians(0.5) ** 2
        form += (np.eye(3) - np.outer(guess, guess)) / np.radians(6) ** 2
        assert np.degrees(np.arccos(abs(np.linalg.eigh(form)[1][:, 0] @ guess))) < 10
