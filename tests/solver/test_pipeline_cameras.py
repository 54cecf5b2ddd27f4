"""What the pipeline makes of the video's own camera: its stated lens, its shake, its rotation."""

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace

import cv2
import numpy as np
import pytest

from core_solver import pipeline
from core_solver.camera import CameraEstimate
from core_solver.perception.observations import CroppedMask, Detection, FrameObservations
from core_solver.take import read_take
from tests.solver import test_pipeline as plain
from tests.solver.scenes import make_clip
from tests.solver.test_pipeline import BODY, CAMERA, COUPLE, FRAMES, HEIGHT, WIDTH, draw_video

stage, couple = plain.stage, plain.couple  # its fixtures


def see_through(patch: pytest.MonkeyPatch, change: Callable[[int, FrameObservations], FrameObservations]) -> None:
    """Let the networks see each frame changed."""
    still = pipeline.observe

    def observe(*arguments, **keywords) -> Iterator[FrameObservations]:
        return (change(t, seen) for t, seen in enumerate(still(*arguments, **keywords)))

    patch.setattr(pipeline, "observe", observe)


def moved_left(seen: FrameObservations, pixels: int) -> FrameObservations:
    def move(person: Detection) -> Detection:
        shift = np.array([pixels, 0], np.float32)
        mask = np.roll(person.mask.values, -pixels, axis=1)
        return replace(
            person, box=person.box - np.tile(shift, 2), keypoints=person.keypoints - shift, mask=CroppedMask(0, 0, mask)
        )

    disparity = None if seen.disparity is None else shifted_plane(seen.disparity, pixels)
    return FrameObservations(seen.frame, tuple(map(move, seen.detections)), disparity)


def shifted_plane(plane: np.ndarray, pixels: int) -> np.ndarray:
    by = np.array([[1, 0, -pixels * plane.shape[1] / WIDTH], [0, 1, 0]])
    size = plane.shape[1], plane.shape[0]
    return cv2.warpAffine(plane.astype(np.float32), by, size, borderMode=cv2.BORDER_REPLICATE).astype(np.float16)


def turned(seen: FrameObservations) -> FrameObservations:
    """A quarter turn anticlockwise: what was to the right is above."""

    def turn(person: Detection) -> Detection:
        u, v = person.keypoints.T
        keypoints = np.stack([v, WIDTH - u], axis=1)
        box = np.concatenate([keypoints.min(axis=0) - 4, keypoints.max(axis=0) + 4]).astype(np.float32)
        x, y, z = person.landmarks.T
        mask = CroppedMask(0, 0, np.ascontiguousarray(np.rot90(person.mask.values)))
        return replace(person, keypoints=keypoints, box=box, landmarks=np.stack([y, -x, z], axis=1), mask=mask)

    disparity = None if seen.disparity is None else np.ascontiguousarray(np.rot90(seen.disparity))
    return FrameObservations(seen.frame, tuple(map(turn, seen.detections)), disparity)


def test_the_lens_that_the_video_states_is_used(stage, monkeypatch):
    lens = CameraEstimate(replace(CAMERA, source="metadata: a lens"), 0.1)
    monkeypatch.setattr(pipeline, "camera_from_metadata", lambda *_arguments: lens)
    take = stage.run(fov_degrees=None)
    assert take.meta.camera.fx == CAMERA.fx
    assert take.meta.camera.source == "metadata: a lens, give or take 10 %"
    assert any("Stabilisation" in note for note in stage.progress.notes)
    assert any("no calibration" in warning for warning in take.meta.warnings)


def test_what_a_camera_file_is_called_says_nothing_about_how_well_it_is_known(stage):
    file = stage.folder / "assumed, give or take.json"
    file.write_text(json.dumps(asdict(CAMERA)))
    take = stage.run(fov_degrees=None, camera=str(file))
    assert take.meta.camera.fx == CAMERA.fx
    assert not any("no calibration" in warning for warning in take.meta.warnings)


def test_a_small_shake_is_compensated_and_told(stage, monkeypatch):
    """Four pixels to and fro, in the picture and in what the networks see of it."""
    take = stage.run()
    draw_video(stage.video, shake=4)
    see_through(monkeypatch, lambda t, seen: moved_left(seen, 4 if t % 3 == 1 else 0))
    shaken = stage.run()
    (warning,) = shaken.meta.warnings
    assert re.match(
        r"The camera shakes by \d\.\d pixels: compensated by a similarity of the background, 0\.\d", warning
    )
    assert warning in stage.progress.notes
    assert take.steadying is None
    kept = read_take(stage.output).steadying
    assert kept is not None
    for t in range(FRAMES):
        np.testing.assert_allclose(kept[t] @ (100, 80, 1), (104 if t % 3 == 1 else 100, 80, 1), atol=0.7)
    for steady, moved in zip(take.people, shaken.people, strict=True):
        assert np.linalg.norm(steady.gamma - moved.gamma, axis=-1).max() < 0.05


def test_a_turned_video_is_noticed_and_mended(stage, monkeypatch):
    """The file shows everything a quarter turn anticlockwise: heads to the left."""
    draw_video(stage.video, turned=True)
    see_through(monkeypatch, lambda _t, seen: turned(seen))
    warned = stage.run()
    assert any("lie on their side" in w and "--rotate 90" in w for w in warned.meta.warnings)
    assert (warned.meta.camera.width, warned.meta.camera.height) == (HEIGHT, WIDTH)
    stage.show(make_clip(BODY, COUPLE, frames=FRAMES, camera=CAMERA))
    mended = stage.run(rotate=90)
    assert (mended.meta.camera.width, mended.meta.camera.height) == (WIDTH, HEIGHT)
    assert mended.meta.settings["rotate"] == 90
    assert not any("lie on" in w for w in mended.meta.warnings)
