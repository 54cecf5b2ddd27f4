"""A take's own video, as the camera of the take saw it.

Where that camera shook, the take keeps how each frame lies over the first one. Whoever compares the video, or what was
seen in it, with the take moves it accordingly.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import VideoError
from core_solver.take import Take
from core_solver.video import Image, VideoClip, open_video

Array = NDArray[np.float64]


class TakeFootage:
    """The pictures of a take.

    Attributes:
        take: the take.
        numbers: (T,) for each of its frames the number in the video.
    """

    def __init__(self, take: Take, video: Path) -> None:
        """Open the video.

        Raises:
            VideoError: unreadable, of another size, or too short for the take.
        """
        self.take = take
        self.numbers = [take.meta.first_frame + take.meta.frame_step * frame for frame in range(take.frame_count)]
        self._clip: VideoClip = open_video(video, rotation=int(take.meta.settings.get("rotate") or 0))
        self._check_own()

    def pictures(self, frames: Sequence[int]) -> Iterator[Image]:
        """The (H, W, 3) BGR pictures at these increasing frames of the take.

        Raises:
            VideoError: the video has changed since it was opened.
        """
        decoded = self._clip.frames_at([self.numbers[frame] for frame in frames])
        for frame, (_, picture) in zip(frames, decoded, strict=True):
            yield picture if self.take.steadying is None else move_picture(self.take.steadying[frame], picture)

    def _check_own(self) -> None:
        clip, camera, name = self._clip, self.take.meta.camera, self.take.meta.video_name
        if (clip.width, clip.height) != (camera.width, camera.height):
            raise VideoError(
                f"{clip.path.name} has {clip.width}x{clip.height} pixels but the take was solved from "
                f"{camera.width}x{camera.height}: give the take's own video ({name})"
            )
        if self.numbers[-1] >= len(clip.frame_list):
            raise VideoError(f"{clip.path.name} ends before the take does: give the take's own video ({name})")


def move_picture(to_first: Array, picture: Image) -> Image:
    """A (H, W, 3) picture moved by a (3, 3) map of its pixels; what was outside repeats the border."""
    size = picture.shape[1], picture.shape[0]
    moved = cv2.warpPerspective(picture, between_centres(to_first), size, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.uint8)


def move_points(to_first: Array, points: NDArray) -> Array:
    """Points (..., 2) moved by a (3, 3) map."""
    ahead = points @ to_first[:, :2].T + to_first[:, 2]
    return ahead[..., :2] / ahead[..., 2:]


def move_box(to_first: Array, box: NDArray) -> Array:
    """The upright box (4,) as left, top, right, bottom around one moved by a (3, 3) map."""
    left, top, right, bottom = np.asarray(box, float)
    corners = move_points(to_first, np.array([[left, top], [right, top], [left, bottom], [right, bottom]]))
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)])


def between_centres(maps: Array) -> Array:
    """Maps (..., 3, 3) of our pixels as OpenCV has them: it counts from the first pixel's centre."""
    return shifted(maps, -0.5)


def shifted(maps: Array, by: float) -> Array:
    """Maps (..., 3, 3) of coordinates that are `by` larger in both directions."""
    shift = np.array([[1, 0, by], [0, 1, by], [0, 0, 1.0]])
    return shift @ maps @ np.linalg.inv(shift)
