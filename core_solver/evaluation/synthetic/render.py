"""What a perfect observer sees: labels, depth and visibility, frame by frame."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.evaluation.synthetic.actor import Actor
from core_solver.evaluation.synthetic.world import SeenTerrain
from core_solver.raster.depth import depth_buffer
from core_solver.raster.pinhole import Pinhole

Array = NDArray[np.float64]

_CHUNK = 32  # frames skinned at once
_SURFACE_M = 0.12  # a keypoint lies inside the body: this far behind the visible surface it still counts as seen


@dataclass(frozen=True)
class Grids:
    """Sizes of the pictures that lie over the whole image.

    Attributes:
        labels: (width, height).
        disparity: (width, height).
    """

    labels: tuple[int, int]
    disparity: tuple[int, int]


@dataclass(frozen=True)
class ExactFrame:
    """One frame without any error; N people.

    Attributes:
        labels: (h, w) uint8, 0 or 1 + the person's number.
        depth: (hd, wd) metres, people and scenery.
        visible: (N,) share of each body that is seen: neither outside the picture nor behind anything.
        inside: (N, 25) keypoint in the picture.
        hidden_by_others: (N, 25) keypoint behind another person or the scenery.
        hidden_by_self: (N, 25) keypoint behind the person's own body.
    """

    labels: NDArray[np.uint8]
    depth: Array
    visible: Array
    inside: NDArray[np.bool_]
    hidden_by_others: NDArray[np.bool_]
    hidden_by_self: NDArray[np.bool_]


def render_frames(
    actors: Sequence[Actor], keypoints: Array, scenery: SeenTerrain, camera: Camera, grids: Grids
) -> Iterator[ExactFrame]:
    """Draw all frames.

    Args:
        actors: the people.
        keypoints: (N, T, 25, 3) camera frame.
        scenery: what stands still.
        camera: without distortion.
        grids: sizes.
    """
    width, height = grids.labels
    pinhole = Pinhole.on_grid(camera, width, height)
    still = scenery.depth(camera.grid_rays(height, width))
    still_small = scenery.depth(camera.grid_rays(*grids.disparity[::-1]))
    faces = actors[0].body.faces
    count = len(actors[0].gamma)
    for start in range(0, count, _CHUNK):
        frames = slice(start, min(start + _CHUNK, count))
        vertices = np.stack([actor.vertices(frames) for actor in actors], axis=1).astype(np.float32)
        for offset, bodies in enumerate(vertices):
            depth, _ = depth_buffer(bodies, faces, pinhole)
            inside = _share_inside(bodies, camera)
            yield _compose(depth, inside, keypoints[:, start + offset], still, still_small, camera, grids)


def _share_inside(bodies: Array, camera: Camera) -> Array:
    """(N,) share of each body's vertices that lie in the picture."""
    pixels = camera.project(np.maximum(bodies, (-np.inf, -np.inf, 0.05)))
    return (_in_picture(pixels, camera) & (bodies[..., 2] > 0.05)).mean(axis=1)


def _in_picture(pixels: Array, camera: Camera) -> NDArray[np.bool_]:
    return np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=-1, keepdims=True)[..., 0]


def _compose(
    depth: NDArray[np.float32], inside: Array, keypoints: Array, still: Array, still_small: Array, camera: Camera,
    grids: Grids,
) -> ExactFrame:  # fmt: skip
    layers = np.concatenate([still[None], depth])
    labels = np.argmin(layers, axis=0)
    front = np.take_along_axis(layers, labels[None], axis=0)[0]
    drawn = np.isfinite(depth).sum(axis=(1, 2))
    seen = np.array([np.count_nonzero(labels == n + 1) for n in range(len(depth))])
    visible = np.where(drawn > 0, seen / np.maximum(drawn, 1), 0) * inside

    pixels = camera.project(np.maximum(keypoints, (-np.inf, -np.inf, 0.05)))
    in_picture = _in_picture(pixels, camera) & (keypoints[..., 2] > 0.05)
    cells = np.floor(np.where(in_picture[..., None], pixels, 0) * grids.labels / (camera.width, camera.height))
    column, row = np.moveaxis(cells.astype(int), -1, 0)
    behind = in_picture & (keypoints[..., 2] > front[row, column] + _SURFACE_M)
    own = labels[row, column] == np.arange(1, len(depth) + 1)[:, None]
    nearest = depth.min(axis=0) if len(depth) else still
    small = cv2.resize(nearest, grids.disparity, interpolation=cv2.INTER_NEAREST)
    return ExactFrame(
        labels=labels.astype(np.uint8),
        depth=np.minimum(small, still_small),
        visible=visible,
        inside=in_picture,
        hidden_by_others=behind & ~own,
        hidden_by_self=behind & own,
    )
