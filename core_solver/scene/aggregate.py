"""From per-frame disparity to one static depth map and a coloured cloud."""

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.geometry import GroundFrame
from core_solver.scene.median import StreamingMedian
from core_solver.scene.normals import grid_points
from core_solver.scene.sharpen import sharpen
from core_solver.scene.thinning import thin_evenly
from core_solver.tracking.tracks import BACKGROUND, Modalities

Array = NDArray[np.float64]

_MOST_FRAMES = 512  # frames everybody's medians are taken over; more would only take time
_HORIZON_MARGIN = 0.02


def median_depth(
    modalities: Modalities, inverse_far: Array, inverse_gap: Array, most_frames: int = _MOST_FRAMES
) -> NDArray[np.float32]:
    """Per-pixel median over time of the background's depth (paper, scene point cloud), edges sharpened.

    Frame after frame, so that memory does not grow with the clip. Of long clips evenly spread frames are looked at,
    and of the others only what those never showed.

    Args:
        modalities: labels and disparity; the disparity must be there.
        inverse_far: (T,) 1 / z_far in 1/metres.
        inverse_gap: (T,) 1 / z_near - 1 / z_far in 1/metres.
        most_frames: how many frames to look at everywhere; a few dozen give a draft.

    Returns:
        (hd, wd) metres on the disparity's grid, NaN where the background was never seen.
    """
    disparity = modalities.disparity
    if disparity is None:
        raise ValueError("median_depth needs disparity")
    count, height, width = disparity.shape
    median = StreamingMedian((height, width))
    unseen = np.ones((height, width), bool)

    def look(t: int, where: NDArray[np.bool_]) -> None:
        wanted = _background(modalities.labels[t], (width, height)) & where
        if not wanted.any():
            return
        inverse = inverse_far[t] + inverse_gap[t] * sharpen(disparity[t]).astype(np.float32)
        wanted &= np.isfinite(inverse) & (inverse > 0)
        unseen[wanted] = False
        median.add(1 / np.where(wanted, inverse, 1), wanted)

    spread = np.unique(np.linspace(0, count - 1, min(count, most_frames)).astype(int))
    for t in spread:
        look(t, np.ones_like(unseen))
    never_shown = unseen.copy()
    for t in np.setdiff1d(np.arange(count), spread):
        look(t, never_shown)
    return median.result()


def _background(labels: NDArray[np.uint8], size: tuple[int, int]) -> NDArray[np.bool_]:
    """Background on another grid, kept clear of people's blurred edges."""
    # At full scale even the smallest share of a cell survives the averaging.
    people = np.where(labels == BACKGROUND, 0, 255).astype(np.uint8)
    resized = cv2.resize(people, size, interpolation=cv2.INTER_AREA if people.shape[1] > size[0] else cv2.INTER_NEAREST)
    return cv2.dilate(resized, np.ones((5, 5), np.uint8)) == 0


def ground_depth(camera: Camera, ground: GroundFrame, size: tuple[int, int], farthest: float) -> NDArray[np.float32]:
    """Depth of the bare ground plane: the prior that stands in where no depth network is to be had.

    Args:
        camera: intrinsics.
        ground: the plane.
        size: (width, height) of the grid laid over the image.
        farthest: metres; NaN beyond, and above the horizon.
    """
    rays = camera.grid_rays(size[1], size[0])
    fall = -(rays @ ground.normal)
    depth = ground.offset / np.where(fall > _HORIZON_MARGIN, fall, np.nan)
    return np.where(depth < farthest, depth, np.nan).astype(np.float32)


def median_picture(
    frames: Iterable[tuple[int, NDArray[np.uint8]]], labels: NDArray[np.uint8], size: tuple[int, int]
) -> NDArray[np.uint8]:
    """Background colours: the median over some frames of the pixels that are not people.

    Args:
        frames: pairs of a take frame and its (H, W, 3) BGR picture; a few dozen are plenty.
        labels: (T, h, w) from tracking.
        size: (width, height) of the result.

    Returns:
        (h, w, 3) RGB; where people stood throughout, their colours.
    """
    pictures, bare = [], []
    for t, picture in frames:
        pictures.append(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
        bare.append(_background(labels[t], size))
    stack, mask = np.stack(pictures), np.stack(bare)
    mask |= ~mask.any(axis=0)
    masked = np.ma.masked_array(stack, np.repeat(~mask[..., None], 3, axis=-1))
    return np.ma.median(masked, axis=0).filled(0)[..., ::-1].astype(np.uint8)


def cloud(
    depth: NDArray[np.float32], picture: NDArray[np.uint8], camera: Camera, most: int
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Unproject a depth map.

    Args:
        depth: (h, w) metres, NaN where unknown.
        picture: (h, w, 3) RGB.
        camera: intrinsics of the whole image.
        most: points at most, thinned evenly in space.

    Returns:
        points (P, 3) metres, camera frame, and colours (P, 3).
    """
    known = np.isfinite(depth)
    points = grid_points(depth, camera)[known].astype(np.float32)
    keep = thin_evenly(points, most)
    return points[keep], picture[known][keep]
