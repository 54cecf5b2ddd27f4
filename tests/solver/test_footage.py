"""A video shaken by known shifts: with the take's maps every picture, overlay and page shows it standing still."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver.errors import VideoError
from core_solver.footage import TakeFootage
from core_solver.preview.overlay import TakeOverFootage
from core_solver.progress import SilentProgress
from core_solver.report.footage import read_footage
from core_solver.take import Take
from tests.solver.preview.takes import make_camera, make_take, write_video

SHIFTS = [(0, 0), (6, -3), (-5, 4), (2, 7)]
SIZE = (320, 240)
INSIDE = np.s_[16:-16, 16:-16]  # what every frame shows


def wall() -> np.ndarray:
    noise = np.random.default_rng(3).integers(0, 255, (12, 16, 3), np.uint8)
    return cv2.resize(noise, SIZE, interpolation=cv2.INTER_CUBIC)


@pytest.fixture
def shaken(tmp_path: Path) -> tuple[Take, Path]:
    """A take of every second frame of a video, and the video."""
    writer = cv2.VideoWriter(
        str(tmp_path / "clip.avi"), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25, SIZE
    )
    for x, y in SHIFTS:
        picture = np.roll(wall(), (y, x), axis=(0, 1))
        writer.write(picture)
        writer.write(255 - picture)  # not the take's
    writer.release()
    maps = np.array([[[1, 0, -x], [0, 1, -y], [0, 0, 1]] for x, y in SHIFTS], float)
    take = make_take(make_camera(*SIZE), people=(), frames=len(SHIFTS), frame_step=2)
    return replace(take, steadying=maps), tmp_path / "clip.avi"


def difference(picture: np.ndarray) -> float:
    return float(np.abs(picture[INSIDE].astype(float) - wall()[INSIDE]).mean())


def test_pictures_stand_still(shaken: tuple[Take, Path]) -> None:
    take, video = shaken
    assert [difference(picture) < 5 for picture in TakeFootage(take, video).pictures(range(4))] == [True] * 4
    raw = TakeFootage(replace(take, steadying=None), video).pictures(range(4))
    assert [difference(picture) < 5 for picture in raw] == [True, False, False, False]


def test_some_frames_are_moved_by_their_own_maps(shaken: tuple[Take, Path]) -> None:
    take, video = shaken
    footage = TakeFootage(take, video)
    assert footage.numbers == [0, 2, 4, 6]
    assert [difference(picture) < 5 for picture in footage.pictures([1, 3])] == [True, True]


def test_overlays_stand_still(shaken: tuple[Take, Path]) -> None:
    take, video = shaken
    for picture in TakeOverFootage(take, video).pictures(range(4)):
        upper = np.s_[16:200, 16:-16]  # the time stands below
        assert np.abs(picture[upper].astype(float) - wall()[upper]).mean() < 5


def test_the_reports_pictures_stand_still(shaken: tuple[Take, Path]) -> None:
    take, video = shaken
    footage = read_footage(take, video, SilentProgress())
    assert (footage.width, footage.height) == SIZE
    for data in footage.pictures:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert difference(picture) < 8


def test_another_video_is_refused(tmp_path: Path) -> None:
    take = make_take()
    with pytest.raises(VideoError, match=r"160x120 pixels but .* 320x240: give the take's own video \(clip\.avi\)"):
        TakeFootage(take, write_video(tmp_path / "a.avi", make_camera(160, 120), 12))
    with pytest.raises(VideoError, match=r"ends before the take does: .*clip\.avi"):
        TakeFootage(take, write_video(tmp_path / "b.avi", take.meta.camera, 5))
