"""Clips shaken by known motions: the maps must undo them, and what was seen must land where the first frame saw it."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.stabilise import is_worth_measuring, measure_shake, steady
from core_solver.video import VideoClip, camera_motion, open_video

SIZE = (640, 360)
FRAMES = 9


def turn(pan: float, tilt: float, roll: float, focal: float = 600.0) -> np.ndarray:
    """What small turns of a camera, in radians, do to its picture: pixels to pixels, from the picture's corner."""
    K = np.array([[focal, 0, SIZE[0] / 2], [0, focal, SIZE[1] / 2], [0, 0, 1]])
    return K @ cv2.Rodrigues(np.array([tilt, pan, roll]))[0] @ np.linalg.inv(K)


def between_centres(homography: np.ndarray) -> np.ndarray:
    """The same map in OpenCV's coordinates."""
    shift = np.array([[1, 0, -0.5], [0, 1, -0.5], [0, 0, 1]])
    return shift @ homography @ np.linalg.inv(shift)


def apply(homography: np.ndarray, points: np.ndarray) -> np.ndarray:
    ahead = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ homography.T
    return ahead[:, :2] / ahead[:, 2:]


def scene() -> np.ndarray:
    noise = np.random.default_rng(3).integers(0, 255, (40, 70, 3), np.uint8)
    return cv2.resize(noise, SIZE, interpolation=cv2.INTER_CUBIC)


def shaken_clip(path: Path, views: list[np.ndarray]) -> VideoClip:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, SIZE)
    for view in views:
        writer.write(view)
    writer.release()
    return open_video(path)


def shakes(strength: float) -> list[np.ndarray]:
    angles = np.random.default_rng(4).normal(0, strength, (FRAMES, 3))
    angles[0] = 0
    return [turn(*a) for a in angles]


def seen_through(maps: list[np.ndarray]) -> list[np.ndarray]:
    return [
        cv2.warpPerspective(scene(), between_centres(m), SIZE, flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        for m in maps
    ]


def nobody(count: int = FRAMES) -> list[FrameObservations]:
    return [FrameObservations(FrameInfo(t, t / 25), (), None) for t in range(count)]


def test_known_turns_are_undone(tmp_path: Path) -> None:
    truth = shakes(0.004)
    clip = shaken_clip(tmp_path / "shaken.avi", seen_through(truth))
    assert is_worth_measuring(camera_motion([picture for _, picture in clip.frames()]))
    shake = measure_shake(clip, nobody())
    assert shake is not None
    grid = np.stack(np.meshgrid(np.linspace(40, 600, 5), np.linspace(40, 320, 5)), -1).reshape(-1, 2)
    error = [
        np.linalg.norm(apply(back, apply(there, grid)) - grid, axis=1)
        for back, there in zip(shake.maps, truth, strict=True)
    ]
    assert np.median(error) < 0.1
    assert np.max(error) < 0.5
    corners = np.array([[0.0, 0], [640, 0], [0, 360], [640, 360]])
    moved = [np.linalg.norm(apply(m, corners) - corners, axis=1) for m in truth]
    assert shake.size_px == pytest.approx(float(np.percentile(moved, 90)), rel=0.05, abs=0.2)
    assert shake.residual_px < 0.2
    assert shake.is_compensated
    still = shake.steady_picture(3, next(p for i, (_, p) in enumerate(clip.frames()) if i == 3))
    assert np.abs(still[30:-30, 30:-30].astype(float) - scene()[30:-30, 30:-30]).mean() < 4


def test_the_richer_model_is_taken_where_it_predicts_better(tmp_path: Path) -> None:
    keystone = [np.array([[1, 0, 0], [0, 1, 0], [6e-5 * t, 3e-5 * t, 1]]) for t in range(FRAMES)]
    shear = [np.array([[1, 0.004 * t, -0.5 * t], [0, 1 + 0.003 * t, 0], [0, 0, 1.0]]) for t in range(FRAMES)]
    shift = [np.array([[1, 0, 1.3 * t], [0, 1, -0.7 * t], [0, 0, 1.0]]) for t in range(FRAMES)]
    for maps, expected in ((keystone, "homography"), (shear, "affine"), (shift, "similarity")):
        shake = measure_shake(shaken_clip(tmp_path / f"{expected}.avi", seen_through(maps)), nobody())
        assert shake is not None
        assert shake.model == expected


def test_a_tripod_needs_nothing_and_a_pan_is_hopeless(tmp_path: Path) -> None:
    for strength, name in ((0.0, "tripod"), (0.15, "pan")):
        clip = shaken_clip(tmp_path / f"{name}.avi", seen_through(shakes(strength)))
        assert not is_worth_measuring(camera_motion([picture for _, picture in clip.frames()]))


def test_a_camera_that_travels_is_not_called_static(tmp_path: Path) -> None:
    """The lower half of the scene is nearer and moves three times as far: no map of the plane undoes that."""
    far, near = scene(), scene()[::-1].copy()
    views = []
    for t in range(FRAMES):
        view = cv2.warpAffine(far, np.array([[1, 0, 1.0 * t], [0, 1, 0]]), SIZE, borderMode=cv2.BORDER_REFLECT)
        below = cv2.warpAffine(near, np.array([[1, 0, 3.0 * t], [0, 1, 0]]), SIZE, borderMode=cv2.BORDER_REFLECT)
        view[180:] = below[180:]
        views.append(view)
    shake = measure_shake(shaken_clip(tmp_path / "travels.avi", views), nobody())
    assert shake is not None
    assert not shake.is_compensated


def test_a_frame_without_background_takes_its_neighbours_motion(tmp_path: Path) -> None:
    maps = [np.array([[1, 0, 2.0 * t], [0, 1, 0], [0, 0, 1]]) for t in range(FRAMES)]
    views = seen_through(maps)
    views[4] = np.zeros_like(views[4])
    shake = measure_shake(shaken_clip(tmp_path / "flash.avi", views), nobody())
    assert shake is not None
    assert shake.lost_frames == pytest.approx(1 / FRAMES)
    np.testing.assert_allclose(shake.maps[4], np.linalg.inv(maps[4]), atol=0.3)


def test_a_bare_wall_gives_nothing_to_hold_on_to(tmp_path: Path) -> None:
    wall = np.full((SIZE[1], SIZE[0], 3), 120, np.uint8)
    assert measure_shake(shaken_clip(tmp_path / "wall.avi", [wall] * 3), nobody(3)) is None


# --- what was seen ---

GRID = (384, 216)
Where = Callable[[np.ndarray], np.ndarray]


def person_at(where: Where) -> Detection:
    """Somebody whose mask covers an upright ellipse of the first frame, seen through a map."""
    keypoints = where(np.random.default_rng(5).uniform((260, 100), (340, 280), (25, 2)))
    return Detection(
        score=0.9,
        box=np.array([*keypoints.min(axis=0), *keypoints.max(axis=0)], np.float32),
        keypoints=keypoints.astype(np.float32),
        confidence=np.ones(25, np.float32),
        landmarks=np.random.default_rng(6).normal(size=(25, 3)).astype(np.float32),
        appearance=np.ones(4, np.float32),
        mask=CroppedMask(40, 130, np.zeros((140, 120), np.uint8)),
    )


@given(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02), st.floats(-0.05, 0.05))
def test_people_land_where_the_first_frame_saw_them(pan: float, tilt: float, roll: float) -> None:
    there = turn(pan, tilt, roll)
    unmoved = person_at(lambda p: p)
    seen = person_at(lambda p: apply(there, p))
    # A bright disc in the mask, drawn where this frame sees the first frame's pixel (300, 190).
    centre = apply(there, np.array([[300.0, 190.0]]))[0] * (GRID[0] / SIZE[0], GRID[1] / SIZE[1])
    rows, columns = np.mgrid[40:180, 130:250] + 0.5
    seen.mask.values[:] = 255 * (np.hypot(columns - centre[0], rows - centre[1]) < 20)
    disparity = np.tile(np.linspace(0, 1, 160, dtype=np.float16), (90, 1))
    frame = FrameObservations(FrameInfo(0, 0.0), (seen,), disparity)
    moved = steady([frame], np.linalg.inv(there)[None], SIZE, GRID)[0]
    person = moved.detections[0]
    np.testing.assert_allclose(person.keypoints, unmoved.keypoints, atol=1e-3)
    mask = person.mask
    lit_rows, lit_columns = np.nonzero(mask.values > 127)
    found = np.array([lit_columns.mean() + mask.left + 0.5, lit_rows.mean() + mask.top + 0.5])
    np.testing.assert_allclose(found * (SIZE[0] / GRID[0], SIZE[1] / GRID[1]), (300, 190), atol=1.0)
    assert np.all(person.box[:2] <= unmoved.keypoints.min(axis=0) + 0.5)
    # The picture turned clockwise by `roll`, and so did the person's landmarks.
    angles = [np.arctan2(d.landmarks[0, 1], d.landmarks[0, 0]) for d in (seen, person)]
    assert angles[1] - angles[0] == pytest.approx(-roll, abs=5e-3)
    assert moved.disparity is not None
    place = apply(there, np.array([[320.0, 180.0]]))[0]
    assert float(moved.disparity[45, 80]) == pytest.approx(place[0] / SIZE[0], abs=0.01)


def test_what_the_frame_did_not_see_is_not_known() -> None:
    shift = np.array([[1, 0, 64.0], [0, 1, 0], [0, 0, 1]])
    frame = FrameObservations(FrameInfo(0, 0.0), (), np.ones((90, 160), np.float16))
    moved = steady([frame], shift[None], SIZE, GRID)[0].disparity
    assert moved is not None
    assert np.isnan(moved[:, :15]).all()
    assert (moved[:, 17:] == 1).all()


def test_no_motion_changes_nothing() -> None:
    seen = person_at(lambda p: p)
    seen.mask.values[30:100, 20:90] = 200
    disparity = np.random.default_rng(7).random((90, 160)).astype(np.float16)
    moved = steady([FrameObservations(FrameInfo(0, 0.0), (seen,), disparity)], np.eye(3)[None], SIZE, GRID)[0]
    person = moved.detections[0]
    np.testing.assert_array_equal(person.keypoints, seen.keypoints)
    np.testing.assert_array_equal(person.landmarks, seen.landmarks)
    top, left = seen.mask.top - person.mask.top, seen.mask.left - person.mask.left
    np.testing.assert_array_equal(person.mask.values[top : top + 140, left : left + 120], seen.mask.values)
    assert moved.disparity is not None
    np.testing.assert_array_equal(moved.disparity, disparity)


def test_places_nobody_claims_move_too_and_people_without_mask_stay_without() -> None:
    shift = np.array([[1, 0, 20.0], [0, 1, 0], [0, 0, 1]])  # 12 cells
    person = replace(person_at(lambda p: p), mask=CroppedMask(0, 0, np.zeros((0, 0), np.uint8)))
    place = CroppedMask(40, 130, np.full((30, 25), 255, np.uint8))
    moved = steady([FrameObservations(FrameInfo(0, 0.0), (person,), None, (place,))], shift[None], SIZE, GRID)[0]
    assert moved.detections[0].mask.values.size == 0
    (there,) = moved.unclaimed
    rows, columns = np.nonzero(there.values > 127)
    assert (columns.min() + there.left, columns.max() + there.left) == (142, 166)
    assert (rows.min() + there.top, rows.max() + there.top) == (40, 69)


@pytest.mark.shared
@pytest.mark.parametrize(
    "name", ["lab_two_people_cam01.mp4", "lab_two_people_cam02.mp4", "outdoor_sports2d.mp4", "street_vtest.avi"]
)
def test_real_tripods_are_left_alone(shared_data: Path, name: str) -> None:
    clip = open_video(shared_data / "clips" / name, end_s=3.0)
    assert not is_worth_measuring(camera_motion([picture for _, picture in clip.spread(8)]))


@pytest.mark.shared
def test_a_real_clip_shaken_by_known_turns_is_held_still(shared_data: Path, tmp_path: Path) -> None:
    """People and a bicycle cross it; nobody is masked out here, and the background still wins."""
    source = open_video(shared_data / "clips" / "street_vtest.avi", end_s=1.2)
    width, height = source.width, source.height
    truth = [
        np.linalg.multi_dot([np.diag([width / SIZE[0], width / SIZE[0], 1]), m, np.diag([SIZE[0] / width] * 2 + [1])])
        for m in shakes(0.004)
    ]
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25, (width, height))
    for (_, picture), there in zip(source.frames_at(range(FRAMES)), truth, strict=True):
        writer.write(
            cv2.warpPerspective(picture, between_centres(there), (width, height), borderMode=cv2.BORDER_REFLECT)
        )
    writer.release()
    shake = measure_shake(open_video(tmp_path / "a.avi"), nobody())
    assert shake is not None
    assert shake.is_compensated
    grid = np.stack(np.meshgrid(np.linspace(80, 680, 5), np.linspace(80, 500, 5)), -1).reshape(-1, 2)
    for back, there in zip(shake.maps, truth, strict=True):
        assert np.linalg.norm(apply(back, apply(there, grid)) - grid, axis=1).max() < 0.7
