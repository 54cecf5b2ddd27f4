"""The footage with the solved bodies over it, as frames and as a video file."""

import logging
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera, camera_from_model
from core_solver.errors import UserError
from core_solver.footage import TakeFootage
from core_solver.preview.bodies import PosablePerson
from core_solver.preview.labels import Label, draw_labels
from core_solver.preview.render import ShownBody, draw_bodies
from core_solver.preview.text import draw_text, text_size
from core_solver.progress import Advance
from core_solver.take import Take

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

log = logging.getLogger(__name__)


class TakeOverFootage:
    """A take together with the video it was solved from."""

    def __init__(self, take: Take, video: Path) -> None:
        """Open the video.

        Raises:
            VideoError: unreadable, of another size, or too short for the take.
        """
        self.take = take
        self.people = [PosablePerson(person) for person in take.people]
        self.camera: Camera = camera_from_model(take.meta.camera)
        self._footage = TakeFootage(take, video)

    def pictures(self, frames: Sequence[int]) -> Iterator[Image]:
        """The footage with bodies and text at these increasing frames of the take."""
        for frame, picture in zip(frames, self._footage.pictures(frames), strict=True):
            yield self._draw(picture, frame, self._footage.numbers[frame])

    def _draw(self, picture: Image, frame: int, number: int) -> Image:
        present = [person for person in self.people if person.is_present(frame)]
        bodies = [
            ShownBody(p.vertices(frame), p.person.faces, p.colour, seen=bool(p.person.valid[frame])) for p in present
        ]
        result = draw_bodies(picture, bodies, self.camera)
        scale = min(picture.shape[:2]) / 720
        stamp = self._stamp(result, f"frame {number}   {self.take.times[frame]:.2f} s", 0.75 * scale)
        names = [self._name(person, body) for person, body in zip(present, bodies, strict=True)]
        draw_labels(result, [name for name in names if name is not None], 0.8 * scale, [stamp])
        return result

    @staticmethod
    def _stamp(picture: Image, text: str, size: float) -> Array:
        """Write at the lower left; returns the box (4,) it takes."""
        width, height = text_size(text, size)
        left, bottom = 6 * size, picture.shape[0] - 2 * size
        draw_text(picture, text, (left, bottom), size)
        return np.array([left, bottom - height, left + width, bottom])

    def _name(self, person: PosablePerson, body: ShownBody) -> Label | None:
        """The name for the crown of the head, where that is in the picture."""
        up = -np.asarray(self.take.meta.gravity)
        crown = body.vertices[int(np.argmax(body.vertices @ up))]
        if crown[2] <= 0:
            return None
        u, v = (float(pixel) for pixel in self.camera.project(crown))
        if not (0 <= u < self.camera.width and 0 <= v < self.camera.height):
            return None
        text = person.short_label if body.seen else f"{person.short_label} (not seen)"
        return Label(text, (u, v), person.colour)


def write_overlay(footage: TakeOverFootage, path: Path, advance: Advance) -> None:
    """Write the overlay of every frame of the take.

    Raises:
        UserError: the video cannot be written there; an older file stays.
    """
    times = footage.take.times
    # The mean: where a video's frames come unevenly, the overlay at least lasts as long.
    rate = (len(times) - 1) / float(times[-1] - times[0]) if len(times) > 1 else float(footage.take.meta.frame_rate)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        _write_frames(footage, part, rate, advance)
        _make_widely_playable(part)
        part.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place with -o") from error
    finally:
        part.unlink(missing_ok=True)


def _write_frames(footage: TakeOverFootage, path: Path, rate: float, advance: Advance) -> None:
    width, height = footage.camera.width, footage.camera.height
    odd_width, odd_height = width % 2, height % 2
    # Video codecs halve the colour planes and so want even sizes: repeat the last row or column.
    size = (width + odd_width, height + odd_height)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, size)
    if not writer.isOpened():
        raise UserError(f"cannot write a video at {path.parent}: check free space and rights, or choose another -o")
    try:
        for picture in footage.pictures(range(footage.take.frame_count)):
            writer.write(cv2.copyMakeBorder(picture, 0, odd_height, 0, odd_width, cv2.BORDER_REPLICATE))
            advance(1)
    finally:
        writer.release()


def _make_widely_playable(path: Path) -> None:
    """Turn MPEG-4 part 2, all that OpenCV can write, into H.264 where an ffmpeg program is installed."""
    ffmpeg = shutil.which("ffmpeg")
    if ffmpeg is None:
        return
    better = path.with_name(f"{path.stem}.h264{path.suffix}")
    command = [
        ffmpeg, "-loglevel", "error", "-nostdin", "-y", "-i", str(path), "-c:v", "libx264", "-crf", "20",
        "-preset", "veryfast", "-pix_fmt", "yuv420p", "-movflags", "+faststart", str(better),
    ]  # fmt: skip
    try:
        finished = subprocess.run(command, capture_output=True, text=True, check=False)
        if finished.returncode == 0:
            better.replace(path)
        else:
            log.info("ffmpeg could not write H.264 (%s): the preview stays MPEG-4", finished.stderr.strip())
    except OSError as error:
        log.info("ffmpeg did not start (%s): the preview stays MPEG-4", error)
    finally:
        better.unlink(missing_ok=True)
