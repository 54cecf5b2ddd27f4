"""The fused operator: mean log depth inside the mask and silhouette error, both with gradients, in one pass."""

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import helper, kernel
from core_solver.raster.people import box_of, count_claimed, crop_of, draw_people, fill_cost, owners_of
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.shading import COLUMNS, shade, to_camera_frame
from core_solver.raster.zbuffer import NO_FACE, crop_box, draw, project

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class RasterTerms:
    """Terms of bodies against their masks; * is (B,) or (T, N).

    Attributes:
        log_depth: (*,) mean of log metres over the pixels where the body, its mask and visibility meet; 0 without any.
        pixels: (*,) int32, number of those pixels.
        log_depth_gradient: (*, V, 3) per metre, exact while each pixel goes on seeing the same face.
        silhouette: (*,) visible pixels where body and mask disagree, divided by the mask's visible pixels; 0 for a mask
            of which nothing is visible, because nothing is then known of the person.
        silhouette_gradient: (*, V, 3) per metre.
    """

    log_depth: Floats
    pixels: NDArray[np.int32]
    log_depth_gradient: Floats
    silhouette: Floats
    silhouette_gradient: Floats


def fused(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, masks: ArrayLike, visible: ArrayLike | None = None
) -> RasterTerms:
    """Compare bodies with masks, each body alone.

    Args:
        vertices: (B, V, 3) metres, camera frame; what is drawn of them is told at `depth_buffer`.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid.
        masks: (B, H, W) true in the person's mask.
        visible: (B, H, W) true where the picture is evidence of this person; None is everywhere.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
    shape = (len(vertices), pinhole.height, pinhole.width)
    masks = as_bytes(masks, shape)
    visible = np.ones(shape, np.uint8) if visible is None else as_bytes(visible, shape)
    terms = empty_terms(vertices.shape)
    _fuse(vertices, faces, pinhole.lens, masks, visible, *_arrays(terms))
    return terms


def solve_terms(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike
) -> RasterTerms:
    """Compare everybody in a clip with the labelled pixels; who hides whom is decided by depth (see `visibility`).

    Args:
        vertices: (T, N, V, 3) metres, camera frame.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid of the labels.
        labels: (T, H, W) uint8: 0 background, a person's id, or 255 where somebody unknown stands.
        ids: (N,) labels of the people.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
    labels = as_bytes(labels, (len(vertices), pinhole.height, pinhole.width))
    terms = empty_terms(vertices.shape)
    _solve(vertices, faces, pinhole.lens, labels, owners_for(ids, vertices), *_arrays(terms))
    return terms


def as_bytes(values: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.uint8]:
    """Booleans or bytes of the given shape, as contiguous bytes.

    Raises:
        ValueError: another shape.
    """
    values = np.ascontiguousarray(values)
    if values.shape != shape:
        raise ValueError(f"expected pixels of shape {shape}, not {values.shape}")
    return values.view(np.uint8) if values.dtype == np.bool_ else values.astype(np.uint8, copy=False)


def owners_for(ids: ArrayLike, vertices: Floats) -> NDArray[np.int16]:
    """`owners_of` the ids of people (T, N, V, 3).

    Raises:
        ValueError: as many ids as people are needed, all different, in 1 to 254.
    """
    if np.size(ids) != vertices.shape[1]:
        raise ValueError(f"{vertices.shape[1]} people need as many labels, not {np.size(ids)}")
    return owners_of(ids)


def empty_terms(shape: tuple[int, ...]) -> RasterTerms:
    """Terms to be filled in for vertices of this shape."""
    bodies = shape[:-2]
    return RasterTerms(
        log_depth=np.zeros(bodies, np.float32),
        pixels=np.zeros(bodies, np.int32),
        log_depth_gradient=np.zeros(shape, np.float32),
        silhouette=np.zeros(bodies, np.float32),
        silhouette_gradient=np.zeros(shape, np.float32),
    )


def _arrays(terms: RasterTerms) -> tuple[NDArray, ...]:
    return terms.log_depth, terms.pixels, terms.log_depth_gradient, terms.silhouette, terms.silhouette_gradient


@kernel
def _fuse(vertices, faces, lens, masks, visible, log_depth, pixels, depth_gradient, silhouette, outline_gradient):
    for body in numba.prange(vertices.shape[0]):
        log_depth[body], pixels[body], silhouette[body] = _fuse_body(
            vertices[body], faces, lens, masks[body], visible[body], depth_gradient[body], outline_gradient[body]
        )


@helper
def _fuse_body(vertices, faces, lens, mask, visible, depth_gradient, outline_gradient):
    screen = np.empty(vertices.shape, np.float32)
    project(vertices, lens, screen)
    box = crop_box(screen, mask.shape[1], mask.shape[0])
    crop = (box[3] - box[1], box[2] - box[0])
    inverse_depth, face, cost = np.zeros(crop, np.float32), np.full(crop, NO_FACE, np.int32), np.empty(crop, np.int8)
    draw(screen, faces, box, inverse_depth, face)
    _fill_cost(mask, visible, box, cost)
    claimed = _count_claimed(mask, visible)
    return _compare(
        vertices, faces, lens, screen, box, inverse_depth, face, cost, claimed, depth_gradient, outline_gradient
    )


@kernel
def _solve(vertices, faces, lens, labels, owners, log_depth, pixels, depth_gradient, silhouette, outline_gradient):
    for frame in numba.prange(vertices.shape[0]):
        _solve_frame(
            vertices[frame], faces, lens, labels[frame], owners, log_depth[frame], pixels[frame],
            depth_gradient[frame], silhouette[frame], outline_gradient[frame],
        )  # fmt: skip


@helper
def _solve_frame(
    vertices, faces, lens, labels, owners, log_depth, pixels, depth_gradient, silhouette, outline_gradient
):
    drawn = draw_people(vertices, faces, lens, labels, owners, 0)
    pool = np.empty(drawn.face.shape, np.int8)
    for n in range(vertices.shape[0]):
        box, cost = box_of(drawn, n), crop_of(drawn, pool, n)
        fill_cost(drawn, owners, labels, n, box, cost)
        inverse_depth, face = crop_of(drawn, drawn.inverse_depth, n), crop_of(drawn, drawn.face, n)
        log_depth[n], pixels[n], silhouette[n] = _compare(
            vertices[n], faces, lens, drawn.screen[n], box, inverse_depth, face, cost, count_claimed(cost),
            depth_gradient[n], outline_gradient[n],
        )  # fmt: skip


@helper
def _compare(vertices, faces, lens, screen, box, inverse_depth, face, cost, claimed, depth_gradient, outline_gradient):
    """Write both gradients of one drawn body; mean log depth, its pixels, and the share of wrong pixels."""
    gradient = np.zeros((vertices.shape[0], COLUMNS), np.float32)
    logs, pixels, costs = shade(screen, faces, box, inverse_depth, face, cost, gradient)
    to_camera_frame(vertices, screen, lens, gradient, pixels, claimed, depth_gradient, outline_gradient)
    wrong = claimed + costs
    return logs / max(pixels, 1), pixels, wrong / claimed if claimed > 0 else 0.0


@helper
def _fill_cost(mask, visible, box, cost):
    for y in range(box[1], box[3]):
        for x in range(box[0], box[2]):
            wanted = -1 if mask[y, x] != 0 else 1
            cost[y - box[1], x - box[0]] = wanted if visible[y, x] != 0 else 0


@helper
def _count_claimed(mask, visible):
    claimed = 0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            claimed += (mask[y, x] != 0) & (visible[y, x] != 0)
    return claimed
