"""Frames in, upright and with exact timestamps; and whether the camera stood still.

Only decoding is trusted: a container's frame count, and often its frame rate, are guesses. Opening a clip therefore
walks once through it without converting pictures, which is several times faster than using them.
"""

import logging
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

# Errors are ours to word: FFmpeg's own lines on stderr would bury them. Read by OpenCV when it opens its first video.
os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")

import cv2

from core_solver.errors import VideoError
from core_solver.perception.observations import FrameInfo

Image = NDArray[np.uint8]

_log = logging.getLogger(__name__)

_OPENCV_ERRORS_ONLY = 2
cv2.setLogLevel(_OPENCV_ERRORS_ONLY)  # its warnings would bury ours as FFmpeg's lines would

_QUARTER_TURNS = {90: cv2.ROTATE_90_CLOCKWISE, 180: cv2.ROTATE_180, 270: cv2.ROTATE_90_COUNTERCLOCKWISE}
_NTSC_BASES = (12, 15, 24, 30, 48, 60, 90, 120, 240)
_RATE_TOLERANCE = 2e-4  # NTSC rates lie 1e-3 below the whole number
_SNAP_FRAMES = 0.1  # a time this close to index / rate is rounding by the container
_SNAP_SECONDS = 1e-3  # Matroska and WebM store whole milliseconds


@dataclass(frozen=True)
class VideoClip:
    """A part of a video, opened and walked through once.

    Attributes:
        path: the file.
        width: pixels of the upright frames.
        height: pixels of the upright frames.
        frame_rate: of the file, frames per second; the usual rate where it varies.
        is_variable: whether the frames come at uneven intervals.
        every: each how-manieth frame of the file is delivered.
        frame_list: the frames that `frames` delivers.
        rotation: degrees clockwise by which pictures are turned after decoding, for a file whose own flag is wrong.
    """

    path: Path
    width: int
    height: int
    frame_rate: Fraction
    is_variable: bool
    every: int
    frame_list: tuple[FrameInfo, ...]
    rotation: int = 0

    @property
    def delivered_rate(self) -> Fraction:
        """Frames per second that `frames` delivers."""
        return self.frame_rate / self.every

    def frames(self) -> Iterator[tuple[FrameInfo, Image]]:
        """Decode: yields each frame's place and its (height, width, 3) BGR picture.

        Raises:
            VideoError: the file has changed or broken since it was opened, or its picture changes size.
        """
        return self.frames_at(range(len(self.frame_list)))

    def frames_at(self, positions: Sequence[int]) -> Iterator[tuple[FrameInfo, Image]]:
        """Decode only the frames at these increasing positions of `frame_list`; the others cost little."""
        wanted = {self.frame_list[p].index: self.frame_list[p] for p in positions}
        last = max(wanted, default=-1)
        capture = _open_capture(self.path)
        try:
            for index in range(last + 1):
                if not capture.grab():
                    raise VideoError(f"{self.path.name} ended at frame {index}: it changed since it was opened")
                if index in wanted:
                    yield wanted[index], self._picture(capture, index)
        finally:
            capture.release()

    def spread(self, count: int) -> Iterator[tuple[FrameInfo, Image]]:
        """Decode `count` frames spread evenly from the first to the last (all, if there are fewer)."""
        ends = np.linspace(0, len(self.frame_list) - 1, min(count, len(self.frame_list)))
        return self.frames_at([round(p) for p in ends])

    def _picture(self, capture: cv2.VideoCapture, index: int) -> Image:
        fine, picture = capture.retrieve()
        if not fine or picture is None:
            raise VideoError(f"frame {index} of {self.path.name} cannot be decoded: convert the video to MP4 (H.264)")
        if self.rotation:
            picture = cv2.rotate(picture, _QUARTER_TURNS[self.rotation])
        if picture.shape != (self.height, self.width, 3):
            raise VideoError(f"the picture of {self.path.name} changes size at frame {index}: cut the video there")
        return picture  # type: ignore[return-value] - OpenCV's 8-bit BGR


def open_video(
    path: Path, start_s: float | None = None, end_s: float | None = None, every: int = 1, rotation: int = 0
) -> VideoClip:
    """Open a video and list its frames.

    Args:
        path: the file.
        start_s: first second wanted; None for the beginning.
        end_s: the clip ends before this second; None for the end.
        every: 1 for all frames, 2 for every other one, and so on.
        rotation: 0, 90, 180 or 270 degrees clockwise, besides what the file's own flag asks for.

    Raises:
        VideoError: missing, empty, not a video, a range outside the video, or fewer than two frames.
    """
    if every < 1:
        raise VideoError(f"every {every} frames is not possible: give 1 or more")
    if rotation and rotation not in _QUARTER_TURNS:
        raise VideoError(f"a rotation by {rotation} degrees is not possible: give 90, 180 or 270")
    picture_times, (height, width), reported_rate = _walk(path)
    if rotation in (90, 270):
        height, width = width, height
    if len(picture_times) < 2:
        raise VideoError(f"{path.name} has only one frame: motion needs a video of at least two")
    times, rate, is_variable = regular_times(picture_times, reported_rate)
    chosen = _within(path, times, rate, start_s, end_s)[::every]
    if len(chosen) < 2:
        raise VideoError(
            f"{len(chosen)} of the frames of {path.name} are in the chosen range and two are needed: "
            "choose a longer range or a smaller --every"
        )
    frame_list = tuple(FrameInfo(int(i), float(times[i])) for i in chosen)
    return VideoClip(path, width, height, rate, is_variable, every, frame_list, rotation)


def nearest_rate(frames_per_second: float) -> Fraction:
    """The exact rate meant by a rounded one: 29.97 is 30000/1001, 25.0 is 25."""
    candidates = [Fraction(max(round(frames_per_second), 1)), *(Fraction(1000 * n, 1001) for n in _NTSC_BASES)]
    best = min(candidates, key=lambda rate: abs(float(rate) - frames_per_second))
    if abs(float(best) / frames_per_second - 1) < _RATE_TOLERANCE:
        return best
    return Fraction(frames_per_second).limit_denominator(100)


def regular_times(times: Sequence[float], reported_rate: float) -> tuple[NDArray[np.float64], Fraction, bool]:
    """Exact times of a constant-rate video, or the measured ones of a variable-rate video.

    Args:
        times: (n,) seconds as decoded, n >= 2.
        reported_rate: the container's frames per second; not positive where unknown.

    Returns:
        (n,) seconds from the first frame, the frame rate, and whether the rate varies.
    """
    seconds = np.asarray(times, float) - times[0]
    index = np.arange(len(seconds))
    intervals = np.diff(seconds)
    fallback = nearest_rate(reported_rate) if np.isfinite(reported_rate) and reported_rate > 0 else Fraction(30)
    if not np.all(intervals > 0):
        _log.warning("the video's timestamps do not increase: %s frames a second are assumed", fallback)
        return index / float(fallback), fallback, False
    # The mean interval is the exact one of a regular video, the median the usual one of a video with gaps.
    for rate in (fallback, nearest_rate(index[-1] / seconds[-1])):
        regular = index / float(rate)
        if np.max(np.abs(seconds - regular)) <= max(_SNAP_FRAMES / float(rate), _SNAP_SECONDS):
            return regular, rate, False
    return seconds, nearest_rate(1 / float(np.median(intervals))), True


def _walk(path: Path) -> tuple[list[float], tuple[int, int], float]:
    """Times as decoded, (height, width) of the upright picture, and the reported rate."""
    capture = _open_capture(path)
    try:
        fine, picture = capture.read()
        if not fine or picture is None:
            raise VideoError(f"{path.name} holds no picture that can be decoded: convert it to MP4 (H.264)")
        times = [capture.get(cv2.CAP_PROP_POS_MSEC) / 1000]
        while capture.grab():
            times.append(capture.get(cv2.CAP_PROP_POS_MSEC) / 1000)
        return times, (picture.shape[0], picture.shape[1]), capture.get(cv2.CAP_PROP_FPS)
    finally:
        capture.release()


def _open_capture(path: Path) -> cv2.VideoCapture:
    if path.is_dir():
        raise VideoError(f"{path} is a folder: give a video file")
    if not path.is_file():
        raise VideoError(f"no video at {path}: check the path")
    if path.stat().st_size == 0:
        raise VideoError(f"{path.name} is empty: copy it again")
    capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    if not capture.isOpened():
        raise VideoError(f"{path.name} is not a video that can be decoded: convert it to MP4 (H.264)")
    # Phones store a turned picture and a flag; frames are delivered upright.
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 1)
    return capture


def _within(
    path: Path, times: NDArray[np.float64], rate: Fraction, start_s: float | None, end_s: float | None
) -> NDArray[np.int64]:
    """Numbers of the frames with start <= time < end."""
    start = 0.0 if start_s is None else start_s
    end = np.inf if end_s is None else end_s
    if start < 0 or end <= start:
        raise VideoError(f"a clip from {start:g} s to {end:g} s is empty: the end must come after the start")
    if start > times[-1]:
        raise VideoError(f"{path.name} is only {times[-1] + 1 / float(rate):.2f} s long: choose an earlier start")
    rounding = 1e-6  # so that --start 0.1 finds frame 6 of a 60 fps video
    return np.flatnonzero((times >= start - rounding) & (times < end - rounding))


# --- Does the camera stand still? ---------------------------------------------------------------------------------

MOTION_LONG_SIDE = 640  # pixels; corners are tracked on pictures of this size
_MOVING_SHARE = 0.01  # of the image diagonal
ENOUGH_CORNERS = 12
_ROUND_TRIP_PX = 1.0


@dataclass(frozen=True)
class CameraMotion:
    """How far the background moved against the first frame, measured at the image's four corners.

    Attributes:
        median_px: median displacement over corners and frames, pixels of the footage.
        drift_px: 90th percentile of the same.
        lost_frames: share of the frames in which the first frame's background was not found again.
        diagonal_px: of the image.
    """

    median_px: float
    drift_px: float
    lost_frames: float
    diagonal_px: float

    @property
    def is_moving(self) -> bool:
        """Whether a static camera is a wrong assumption for this clip."""
        return self.drift_px > _MOVING_SHARE * self.diagonal_px or self.lost_frames > 0.5


def camera_motion(images: Sequence[Image], people: Sequence[NDArray[np.float32]] | None = None) -> CameraMotion:
    """Measure the camera's drift from about a dozen frames spread over a clip.

    Args:
        images: (H, W, 3) BGR pictures of one clip, in order, at least one.
        people: for the first picture, boxes (n, 4) left, top, right, bottom in pixels, where no background is sought.

    A background without any corners (a bare wall) gives no evidence of motion and counts as still.
    """
    height, width = images[0].shape[:2]
    diagonal = float(np.hypot(height, width))
    scale = min(1.0, MOTION_LONG_SIDE / max(height, width))
    greys = [small_grey(image, scale) for image in images]
    corners = background_corners(greys[0], people, scale)
    if len(corners) < ENOUGH_CORNERS:
        return CameraMotion(0.0, 0.0, 0.0, diagonal)
    image_corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) * scale
    shifts, lost, guess = [np.zeros(4)], 0, np.eye(2, 3)
    for grey in greys[1:]:
        motion = _dominant_motion(greys[0], grey, corners, guess)
        if motion is None:
            lost += 1
            continue
        guess = motion
        shifts.append(np.linalg.norm(_apply(motion, image_corners) - image_corners, axis=1) / scale)
    still = np.concatenate(shifts[1:] or shifts)
    return CameraMotion(
        float(np.median(still)), float(np.percentile(still, 90)), lost / max(len(greys) - 1, 1), diagonal
    )


def small_grey(image: Image, scale: float) -> Image:
    """A (H, W, 3) BGR picture in grey and smaller."""
    small = cv2.resize(image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.cvtColor(small, cv2.COLOR_BGR2GRAY)  # type: ignore[return-value]


def background_corners(grey: Image, people: Sequence[NDArray[np.float32]] | None, scale: float) -> NDArray[np.float32]:
    """Corners (n, 2) of a small grey picture, from OpenCV's first pixel centre, outside people's boxes in the large."""
    allowed = np.full(grey.shape, 255, np.uint8)
    for box in () if people is None else people:
        left, top, right, bottom = (max(int(x * scale), 0) for x in box)
        allowed[top : bottom + 1, left : right + 1] = 0
    found = cv2.goodFeaturesToTrack(grey, maxCorners=400, qualityLevel=0.01, minDistance=8, mask=allowed)
    return np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2).astype(np.float32)


def follow_corners(
    first: Image, other: Image, corners: NDArray[np.float32], predicted: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where corners (n, 2) of the first grey picture lie in the other, and (n,) which of them came back from there."""
    window = {"winSize": (21, 21), "maxLevel": 4, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    guess = predicted.astype(np.float32)
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, other, corners, guess, **window)  # type: ignore[call-overload]
    back, returned, _ = cv2.calcOpticalFlowPyrLK(other, first, there, corners.copy(), **window)  # type: ignore[call-overload]
    good = (found.ravel() > 0) & (returned.ravel() > 0)
    good &= np.linalg.norm(back - corners, axis=1) < _ROUND_TRIP_PX
    return np.asarray(there, np.float32), good


def _dominant_motion(
    first: Image, other: Image, corners: NDArray[np.float32], guess: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """(2, 3) affine map that carries most corners from the first picture to the other; None if they are not found."""
    there, good = follow_corners(first, other, corners, _apply(guess, corners))
    if good.sum() < max(ENOUGH_CORNERS, 0.1 * len(corners)):
        return None
    motion, inliers = cv2.estimateAffine2D(corners[good], there[good], ransacReprojThreshold=2.0)
    if motion is None or inliers.sum() < ENOUGH_CORNERS / 2:
        return None
    return np.asarray(motion, float)


def _apply(affine: NDArray[np.float64], points: NDArray) -> NDArray[np.float64]:
    return points @ affine[:, :2].T + affine[:, 2]
