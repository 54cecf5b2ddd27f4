# SPDX-License-Identifier: GPL-3.0-or-later
"""The video behind the people: a movie clip as the camera's background, straightened when the lens distorts."""

import os
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.take import CameraModel, Meta

from .actions import Curves, write_action
from .camera import SENSOR_WIDTH_MM
from .clock import Clock

# A smaller or larger copy of the video is welcome as long as its shape is the same.
_SHAPE_TOLERANCE = 0.01


class FootageError(UserError):
    """Footage that cannot be shown; the take is imported without it."""


def find_footage(take_path: Path, video_name: str, chosen: str) -> Path:
    """Where the video lies.

    Args:
        take_path: the take file; the video is looked for beside it.
        video_name: file name of the video in the take.
        chosen: a video file or a folder that holds the video, chosen by the user; empty for neither.

    Raises:
        FootageError: it is not there.
    """
    place = Path(bpy.path.abspath(chosen)) if chosen else take_path.parent
    # Unlike pathlib's, these say no where the system keeps the place from us.
    path = place / Path(video_name).name if os.path.isdir(place) else place  # noqa: PTH112
    if not os.path.isfile(path):  # noqa: PTH113
        raise FootageError(f"footage {path} not found: put the video beside the take or choose it on import")
    return path


def show_footage(camera: bpy.types.Object, path: Path, meta: Meta, clock: Clock) -> bpy.types.MovieClip:
    """Put the video behind the camera's view, frame by frame in step with the take.

    Raises:
        FootageError: not a video that Blender reads, or of another shape than the take's.
    """
    clip = _load(path, meta.camera)
    _set_lens(clip, meta.camera)
    _set_timing(clip, meta, clock)
    background = camera.data.background_images.new()
    background.source = "MOVIE_CLIP"
    background.clip = clip
    background.frame_method = "STRETCH"
    background.alpha = 1.0
    background.clip_user.use_render_undistorted = any(meta.camera.distortion)
    camera.data.show_background_images = True
    return clip


def clip_starts(meta: Meta, clock: Clock) -> NDArray[np.float64]:
    """(N,) scene frame at which the clip must start so that each frame of the scene shows the take's own video frame.

    Blender shows video frame (scene frame - start), counted from 0. A take of every frame has one start for all; one
    that skips video frames, or plays at another rate, needs a start that moves, since a clip has no speed of its own.
    """
    return clock.frames - np.floor(meta.first_frame + meta.frame_step * clock.moments + 0.5)


def _load(path: Path, camera: CameraModel) -> bpy.types.MovieClip:
    try:
        clip = bpy.data.movieclips.load(str(path))
    except RuntimeError as error:
        raise FootageError(f"footage {path.name} is not a video that Blender can read") from error
    width, height = clip.size
    if not (width and height):
        bpy.data.movieclips.remove(clip)
        raise FootageError(f"footage {path.name} is not a video that Blender can read")
    if abs(width * camera.height / (height * camera.width) - 1) > _SHAPE_TOLERANCE:
        bpy.data.movieclips.remove(clip)
        raise FootageError(
            f"footage {path.name} is {width} x {height} in Blender but {camera.width} x {camera.height} in the take: "
            "choose the video the take was solved from, stored upright"
        )
    return clip


def _set_lens(clip: bpy.types.MovieClip, camera: CameraModel) -> None:
    """Tell the clip the take's lens, in the clip's own pixels.

    Blender counts the clip's pixels upwards from the bottom. Its Brown model is OpenCV's with the two tangential
    coefficients swapped, and turning the vertical axis round changes the sign of OpenCV's first.
    """
    size = clip.size[0] / camera.width
    k1, k2, p1, p2, k3 = camera.distortion
    lens = clip.tracking.camera
    lens.sensor_width = SENSOR_WIDTH_MM
    lens.pixel_aspect = camera.fy / camera.fx
    lens.focal_length_pixels = camera.fx * size
    lens.principal_point_pixels = (camera.cx * size, (camera.height - camera.cy) * size)
    lens.distortion_model = "BROWN"
    lens.brown_k1, lens.brown_k2, lens.brown_k3, lens.brown_k4 = k1, k2, k3, 0.0
    lens.brown_p1, lens.brown_p2 = p2, -p1


def _set_timing(clip: bpy.types.MovieClip, meta: Meta, clock: Clock) -> None:
    starts = clip_starts(meta, clock)
    clip.frame_start = int(starts[0])
    if np.ptp(starts) > 0:
        curve = Curves("frame_start", starts[:, None], "Footage")
        write_action(clip, f"{clip.name} speed", clock.frames, [curve])
