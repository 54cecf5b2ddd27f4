"""The footage as small JPEG pictures, sized so that the page stays light."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import VideoError
from core_solver.footage import TakeFootage
from core_solver.progress import Progress
from core_solver.take import CameraModel, Take

Image = NDArray[np.uint8]

BYTES = 15_000_000  # of the pictures of a short take together, before base64 makes them a third longer
_SHORT = 300  # pictures; a longer take may have more bytes
_LONG_SHARE = 1.6  # but never more than this many times as many
_MOST_PICTURES = 900  # a longer take shows every second, third, ... frame
_LONG_SIDES = (960, 800, 720, 640, 540, 450, 380, 320, 256, 200)  # pixels, the largest that fits is taken
_QUALITY = 74
_SAMPLES = 5  # pictures whose size tells how large all of them will be
_RESERVE = 0.9  # of the budget: other pictures may be busier than the samples


@dataclass(frozen=True)
class Footage:
    """Pictures of a take's video.

    Attributes:
        width: pixels of each picture.
        height: pixels of each picture.
        frames: (n,) the take's frame of each picture, increasing.
        pictures: n JPEG files.
    """

    width: int
    height: int
    frames: tuple[int, ...]
    pictures: tuple[bytes, ...]


def read_footage(take: Take, video: Path, progress: Progress) -> Footage:
    """Read the pictures of a take.

    Raises:
        VideoError: unreadable, or not the take's own video.
    """
    footage = TakeFootage(take, video)
    stride = -(-take.frame_count // _MOST_PICTURES)
    frames = range(0, take.frame_count, stride)
    size = _fitting_size(footage, frames)
    pictures = []
    with progress.stage("footage", len(frames)) as advance:
        for picture in footage.pictures(frames):
            pictures.append(_encode(picture, size))
            advance(1)
    return Footage(*size, tuple(frames), tuple(pictures))


def _fitting_size(footage: TakeFootage, frames: Sequence[int]) -> tuple[int, int]:
    """(width, height) of the largest pictures that keep within the budget."""
    spread = np.unique(np.linspace(0, len(frames) - 1, min(_SAMPLES, len(frames))).astype(int))
    budget = _RESERVE * BYTES * min(max(len(frames) / _SHORT, 1.0), _LONG_SHARE)
    samples = list(footage.pictures([frames[position] for position in spread]))

    def fits(size: tuple[int, int]) -> bool:
        mean = sum(len(_encode(picture, size)) for picture in samples) / len(samples)
        return mean * len(frames) <= budget

    sizes = list(_sizes(footage.take.meta.camera))
    return next((size for size in sizes if fits(size)), sizes[-1])


def _sizes(camera: CameraModel) -> Iterator[tuple[int, int]]:
    for long_side in _LONG_SIDES:
        factor = min(1.0, long_side / max(camera.width, camera.height))
        yield max(1, round(camera.width * factor)), max(1, round(camera.height * factor))


def _encode(picture: Image, size: tuple[int, int]) -> bytes:
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    fine, data = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not fine:
        raise VideoError("a picture of the video could not be made smaller: convert the video to MP4 (H.264)")
    return data.tobytes()
