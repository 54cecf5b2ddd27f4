"""Videos written here, with known frames and times, and broken ones."""

import shutil
import struct
import subprocess
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.errors import VideoError
from core_solver.video import camera_motion, nearest_rate, open_video, regular_times

needs_ffmpeg = pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg makes this test's video")


def grey_of_frame(index: int) -> int:
    return 20 + 8 * index


def write_video(path: Path, frames: int = 12, size: tuple[int, int] = (64, 48), rate: float = 25.0) -> Path:
    """A video whose frame number can be read off its brightness."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, size)
    assert writer.isOpened()
    for index in range(frames):
        writer.write(np.full((size[1], size[0], 3), grey_of_frame(index), np.uint8))
    writer.release()
    return path


def make_with_ffmpeg(path: Path, *arguments: str) -> Path:
    subprocess.run(["ffmpeg", "-v", "error", "-y", *arguments, str(path)], check=True, timeout=60)
    return path


def test_delivers_every_frame_once_with_its_time(tmp_path: Path) -> None:
    clip = open_video(write_video(tmp_path / "a.avi"))
    seen = list(clip.frames())
    assert (clip.width, clip.height, clip.frame_rate, clip.is_variable) == (64, 48, Fraction(25), False)
    assert [info for info, _ in seen] == list(clip.frame_list)
    assert [info.index for info, _ in seen] == list(range(12))
    np.testing.assert_allclose([info.time for info, _ in seen], np.arange(12) / 25, atol=1e-12)
    np.testing.assert_allclose([p.mean() for _, p in seen], [grey_of_frame(i) for i in range(12)], atol=3)
    assert seen[0][1].shape == (48, 64, 3)


def test_range_and_step_keep_file_numbers_and_times(tmp_path: Path) -> None:
    clip = open_video(write_video(tmp_path / "a.avi"), start_s=0.08, end_s=0.36, every=3)
    assert [info.index for info in clip.frame_list] == [2, 5, 8]
    assert clip.delivered_rate == Fraction(25, 3)
    assert [round((picture.mean() - 20) / 8) for _, picture in clip.frames()] == [2, 5, 8]


def test_spread_reaches_both_ends(tmp_path: Path) -> None:
    clip = open_video(write_video(tmp_path / "a.avi"))
    assert [info.index for info, _ in clip.spread(3)] == [0, 6, 11]
    assert len(list(clip.spread(50))) == 12


def test_fractional_rates_are_exact(tmp_path: Path) -> None:
    clip = open_video(write_video(tmp_path / "a.avi", rate=30000 / 1001))
    assert clip.frame_rate == Fraction(30000, 1001)
    assert clip.frame_list[-1].time == pytest.approx(11 * 1001 / 30000, abs=1e-12)


@needs_ffmpeg
def test_odd_sizes(tmp_path: Path) -> None:
    source = ("-f", "lavfi", "-i", "testsrc=s=67x45:d=0.5:r=10", "-c:v", "ffv1", "-pix_fmt", "bgr0")
    clip = open_video(make_with_ffmpeg(tmp_path / "odd.avi", *source))
    assert (clip.width, clip.height) == (67, 45)
    assert all(picture.shape == (45, 67, 3) for _, picture in clip.frames())


def turn_clockwise(path: Path) -> None:
    """Set the track's display matrix, as a phone does that was held upright: a quarter turn clockwise."""
    content = path.read_bytes()
    upright = struct.pack(">9i", 1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
    turned = struct.pack(">9i", 0, 1 << 16, 0, -(1 << 16), 0, 0, 0, 0, 1 << 30)
    place = content.index(upright, content.index(b"tkhd"))
    path.write_bytes(content[:place] + turned + content[place + len(turned) :])


def test_phone_video_is_delivered_upright(tmp_path: Path) -> None:
    path = tmp_path / "phone.mp4"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10, (96, 64))
    stored = np.zeros((64, 96, 3), np.uint8)
    stored[:, :48] = 255  # what is left in the file is above for the viewer
    for _ in range(4):
        writer.write(stored)
    writer.release()
    turn_clockwise(path)
    clip = open_video(path)
    assert (clip.width, clip.height) == (64, 96)
    for _, picture in clip.frames():
        assert picture.shape == (96, 64, 3)
        assert picture[:40].min() > 200
        assert picture[56:].max() < 50


@pytest.mark.parametrize(("rotation", "bright_corner"), [(0, (0, 0)), (90, (0, -1)), (180, (-1, -1)), (270, (-1, 0))])
def test_a_wrong_rotation_flag_is_mended_by_hand(tmp_path: Path, rotation: int, bright_corner: tuple[int, int]) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "a.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (96, 64))
    picture = np.zeros((64, 96, 3), np.uint8)
    picture[:24, :24] = 255
    for _ in range(3):
        writer.write(picture)
    writer.release()
    clip = open_video(tmp_path / "a.avi", rotation=rotation)
    assert (clip.width, clip.height) == ((64, 96) if rotation in (90, 270) else (96, 64))
    for _, shown in clip.frames():
        corners = {(y, x): int(shown[y, x].max()) for y in (0, -1) for x in (0, -1)}
        assert max(corners, key=corners.__getitem__) == bright_corner


def test_a_slanting_rotation_is_refused(tmp_path: Path) -> None:
    with pytest.raises(VideoError, match="90, 180 or 270"):
        open_video(write_video(tmp_path / "a.avi"), rotation=45)


@needs_ffmpeg
def test_variable_rate_keeps_real_times(tmp_path: Path) -> None:
    uneven = "select='not(eq(n,3)+eq(n,4)+eq(n,9))'"
    source = ("-f", "lavfi", "-i", "testsrc=s=64x48:d=1:r=20", "-vf", uneven, "-fps_mode", "vfr")
    clip = open_video(make_with_ffmpeg(tmp_path / "vfr.mp4", *source))
    assert clip.is_variable
    kept = [n for n in range(20) if n not in {3, 4, 9}]
    np.testing.assert_allclose([info.time for info in clip.frame_list], np.array(kept) / 20, atol=2e-3)
    assert clip.frame_rate == 20


@needs_ffmpeg
def test_cut_off_file_gives_the_frames_it_has(tmp_path: Path) -> None:
    source = ("-f", "lavfi", "-i", "testsrc=s=320x240:d=2:r=20")
    whole = make_with_ffmpeg(tmp_path / "whole.mkv", *source).read_bytes()
    half = tmp_path / "half.mkv"
    half.write_bytes(whole[: len(whole) // 2])
    clip = open_video(half)
    assert 2 <= len(clip.frame_list) < 40
    assert len(list(clip.frames())) == len(clip.frame_list)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda _: None, "no video at"),
        (lambda p: p.mkdir(), "folder"),
        (lambda p: p.write_bytes(b""), "is empty"),
        (lambda p: p.write_text("not a video\n" * 1000), "not a video"),
        (lambda p: p.write_bytes(np.random.default_rng(0).bytes(100_000)), "not a video"),
        (lambda p: write_video(p, frames=1), "only one frame"),
    ],
)
def test_what_is_no_video_is_refused_in_one_line(tmp_path: Path, capfd, make, words: str) -> None:
    path = tmp_path / "clip.avi"
    make(path)
    capfd.readouterr()
    with pytest.raises(VideoError, match=words) as caught:
        open_video(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", ""), "OpenCV and FFmpeg keep quiet"


@pytest.mark.parametrize(
    ("start_s", "end_s", "every", "words"),
    [
        (9.0, None, 1, "0.48 s long"),
        (0.2, 0.1, 1, "the end must come after"),
        (-1.0, None, 1, "the end must come after"),
        (0.0, 0.04, 1, "1 of the frames of a.avi"),
        (0.05, 0.06, 1, "0 of the frames of a.avi"),
        (None, None, 20, "smaller --every"),
        (None, None, 0, "1 or more"),
    ],
)
def test_ranges_without_frames_are_refused(tmp_path: Path, start_s, end_s, every: int, words: str) -> None:
    with pytest.raises(VideoError, match=words):
        open_video(write_video(tmp_path / "a.avi"), start_s, end_s, every)


def test_a_file_that_shrinks_after_opening_is_noticed(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.avi")
    clip = open_video(path)
    write_video(path, frames=5)
    with pytest.raises(VideoError, match="changed since"):
        list(clip.frames())


@given(st.sampled_from([24, 25, 30, 50, 60, 120]), st.booleans())
def test_rounded_rates_are_recognised(base: int, ntsc: bool) -> None:
    exact = Fraction(1000 * base, 1001) if ntsc and base % 25 else Fraction(base)
    assert nearest_rate(round(float(exact), 3)) == exact


def test_times_rounded_by_the_container_are_made_exact() -> None:
    exact = np.arange(300) * 1001 / 30000
    times, rate, varies = regular_times(np.round(exact, 3), 29.97)
    assert (rate, varies) == (Fraction(30000, 1001), False)
    np.testing.assert_allclose(times, exact, atol=1e-12)


def test_a_wrong_reported_rate_is_overruled_by_the_times() -> None:
    times, rate, varies = regular_times(np.arange(100) / 24, 1000.0)
    assert (rate, varies) == (Fraction(24), False)
    np.testing.assert_allclose(times, np.arange(100) / 24)


def test_a_gap_is_not_smoothed_away() -> None:
    measured = np.delete(np.arange(60) / 30, range(20, 26))
    times, rate, varies = regular_times(measured, 30.0)
    assert varies
    assert rate == 30
    np.testing.assert_allclose(times, measured)


def test_useless_times_fall_back_to_the_rate() -> None:
    times, rate, varies = regular_times(np.zeros(10), 50.0)
    assert (rate, varies) == (Fraction(50), False)
    np.testing.assert_allclose(times, np.arange(10) / 50)


def textured_picture() -> np.ndarray:
    noise = np.random.default_rng(1).integers(0, 255, (60, 100, 3), np.uint8)
    return cv2.resize(noise, (1000, 600), interpolation=cv2.INTER_CUBIC)


def window_at(picture: np.ndarray, x: float) -> np.ndarray:
    return cv2.warpAffine(picture, np.array([[1, 0, -x], [0, 1, 0]], float), (800, 600))


@pytest.mark.parametrize("pan", [0.0, 3.0, 40.0, 150.0])
def test_a_pan_is_measured_in_pixels(pan: float) -> None:
    picture = textured_picture()
    motion = camera_motion([window_at(picture, x) for x in np.linspace(0, pan, 11)])
    assert motion.drift_px == pytest.approx(0.9 * pan, abs=0.06 * pan + 0.3)
    assert motion.is_moving == (pan > 10)


def test_a_person_who_walks_is_no_camera_motion() -> None:
    views = []
    for x in range(50, 600, 50):
        view = window_at(textured_picture(), 0).copy()
        view[200:600, x : x + 150] = np.random.default_rng(2).integers(0, 255, (400, 150, 3), np.uint8)
        views.append(view)
    assert not camera_motion(views).is_moving


def test_another_scene_counts_as_motion() -> None:
    other = np.random.default_rng(5).integers(0, 255, (600, 800, 3), np.uint8)
    motion = camera_motion([window_at(textured_picture(), 0), other, other])
    assert motion.lost_frames == 1.0
    assert motion.is_moving


def test_a_bare_wall_counts_as_still() -> None:
    wall = np.full((100, 100, 3), 128, np.uint8)
    assert not camera_motion([wall, wall]).is_moving


@pytest.mark.shared
@pytest.mark.parametrize("name", ["lab_two_people_cam01.mp4", "outdoor_sports2d.mp4", "street_vtest.avi"])
def test_real_static_clips_are_static_and_a_pan_is_not(shared_data: Path, name: str) -> None:
    clip = open_video(shared_data / "clips" / name, end_s=3.0)
    pictures = [picture for _, picture in clip.spread(6)]
    assert not camera_motion(pictures).is_moving
    step = 0.01 * clip.width
    panned = [
        cv2.warpAffine(p, np.array([[1, 0, -i * step], [0, 1, 0]]), (clip.width, clip.height), borderMode=2)
        for i, p in enumerate(pictures)
    ]
    assert camera_motion(panned).is_moving
