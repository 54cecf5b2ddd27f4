"""The silhouette of the paper: a soft rasteriser over all faces, none left out.

A face covers a pixel by sigmoid(+-d^2 / sigma): d is the distance in pixels from the pixel's centre to the nearest edge
of the face, counted positive inside. A pixel is covered by S = 1 - prod over faces of (1 - coverage). Faces of which a
pixel is more than a few sqrt(sigma) outside change nothing and are passed over; no other face is, front or back.
"""

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import helper, kernel
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.terms import as_bytes
from core_solver.raster.zbuffer import crop_box, project

_NOTHING = np.float32(17)  # -log of the coverage below which a face is passed over: single precision ends there
_NO_DOUBT = np.float32(1e-7)  # emptiness of a pixel below which no face can change it noticeably


def soft_silhouette(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, masks: ArrayLike, visible: ArrayLike, sigma: float
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Compare soft silhouettes with masks.

    Args:
        vertices: (B, V, 3) metres, camera frame.
        faces: (F, 3).
        pinhole: the grid.
        masks: (B, H, W) true in the person's mask.
        visible: (B, H, W) true where the picture is evidence of this person.
        sigma: softness in squared pixels: an edge is blurred over a few sqrt(sigma) pixels.

    Returns:
        loss (B,): sum over the visible pixels of (S - mask)^2, divided by the mask's visible pixels; 0 without any.
        gradient (B, V, 3) of the loss, per metre.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
    shape = (len(vertices), pinhole.height, pinhole.width)
    loss, gradient = np.zeros(len(vertices), np.float32), np.zeros(vertices.shape, np.float32)
    _soften(
        vertices,
        faces,
        pinhole.lens,
        as_bytes(masks, shape),
        as_bytes(visible, shape),
        np.float32(sigma),
        loss,
        gradient,
    )
    return loss, gradient


@kernel
def _soften(vertices, faces, lens, masks, visible, sigma, loss, gradient):
    for body in numba.prange(vertices.shape[0]):
        loss[body] = _soften_body(vertices[body], faces, lens, masks[body], visible[body], sigma, gradient[body])


@helper
def _soften_body(vertices, faces, lens, mask, visible, sigma, gradient):
    claimed, change = 0, 0.0
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            claimed += (mask[y, x] != 0) & (visible[y, x] != 0)
    if claimed == 0:
        return 0.0
    screen = np.empty(vertices.shape, np.float32)
    project(vertices, lens, screen)
    reach = np.float32(math.sqrt(sigma * _NOTHING))
    box = _widened(crop_box(screen, mask.shape[1], mask.shape[0]), math.ceil(reach), mask.shape)
    # Sum over faces of log(1 - coverage), and later how the loss changes with it.
    emptiness = np.zeros((box[3] - box[1], box[2] - box[0]), np.float32)
    slopes = np.zeros((len(vertices), 2), np.float32)
    for backwards in (False, True):
        for f in range(faces.shape[0]):
            _visit(screen, faces[f], box, reach, sigma, emptiness, backwards, slopes)
        if not backwards:
            change = _compare(mask, visible, box, emptiness)
    for i in range(vertices.shape[0]):
        q = screen[i, 2]
        if q > 0:
            across, down = slopes[i, 0] * lens[0] / claimed, slopes[i, 1] * lens[1] / claimed
            gradient[i, 0], gradient[i, 1] = across * q, down * q
            gradient[i, 2] = -(across * vertices[i, 0] + down * vertices[i, 1]) * q * q
    return (change + claimed) / claimed


@helper
def _widened(box, border, shape):
    if box[2] <= box[0]:
        return box
    return (
        max(box[0] - border, 0), max(box[1] - border, 0), min(box[2] + border, shape[1]), min(box[3] + border, shape[0])
    )  # fmt: skip


@helper
def _compare(mask, visible, box, emptiness):
    """Change of the summed squared error against an empty picture; logs of emptiness become the error's slopes."""
    change = 0.0
    for y in range(box[1], box[3]):
        for x in range(box[0], box[2]):
            empty = np.float32(math.exp(emptiness[y - box[1], x - box[0]]))
            wanted = np.float32(mask[y, x] != 0)
            error = np.float32(1) - empty - wanted
            slope = np.float32(0)
            if visible[y, x] != 0:
                change += error * error - wanted
                slope = np.float32(-2) * error * empty if empty > _NO_DOUBT else np.float32(0)
            emptiness[y - box[1], x - box[0]] = slope
    return change


@helper
def _visit(screen, corners, box, reach, sigma, emptiness, backwards, slopes):
    """Add one face to the emptiness of the pixels around it; backwards, add its share of their slopes to `slopes`."""
    i, j, k = corners[0], corners[1], corners[2]
    ax, ay, bx, by, cx, cy = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1], screen[k, 0], screen[k, 1]
    area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
    if not abs(area) >= 0:  # a corner that cannot be drawn
        return
    x0 = max(box[0], math.ceil(min(ax, bx, cx) - reach))
    x1 = min(box[2] - 1, math.floor(max(ax, bx, cx) + reach))
    y0 = max(box[1], math.ceil(min(ay, by, cy) - reach))
    y1 = min(box[3] - 1, math.floor(max(ay, by, cy) + reach))
    for row in range(y0, y1 + 1):
        for column in range(x0, x1 + 1):
            here = emptiness[row - box[1], column - box[0]]
            if backwards and here == 0:
                continue
            x, y = np.float32(column), np.float32(row)
            first = _to_edge(x, y, ax, ay, bx, by)
            second = _to_edge(x, y, bx, by, cx, cy)
            third = _to_edge(x, y, cx, cy, ax, ay)
            squared = min(first[0], second[0], third[0])
            inside = first[4] * area > 0 and second[4] * area > 0 and third[4] * area > 0
            exponent = squared / sigma if inside else -squared / sigma
            if exponent < -_NOTHING:
                continue
            if not backwards:
                emptiness[row - box[1], column - box[0]] -= _softplus(exponent)
                continue
            # d (-softplus) / d exponent = -sigmoid; the distance changes with the two ends of the nearest edge.
            pull = -here * _sigmoid(exponent) * (1 if inside else -1) / sigma
            if squared == first[0]:
                _drag(slopes, i, j, first, pull)
            elif squared == second[0]:
                _drag(slopes, j, k, second, pull)
            else:
                _drag(slopes, k, i, third, pull)


@helper
def _to_edge(x, y, ax, ay, bx, by):
    """Squared distance to an edge, the way there (x, y), its foot as a share of the edge, and the side we are on."""
    ex, ey, px, py = bx - ax, by - ay, x - ax, y - ay
    length = ex * ex + ey * ey
    foot = (px * ex + py * ey) / length if length > 0 else np.float32(0)
    foot = min(max(foot, np.float32(0)), np.float32(1))
    across, down = foot * ex - px, foot * ey - py
    return across * across + down * down, across, down, foot, ex * py - ey * px


@helper
def _drag(slopes, start, end, edge, pull):
    _, across, down, foot, _ = edge
    across, down = 2 * pull * across, 2 * pull * down
    slopes[start, 0] += (1 - foot) * across
    slopes[start, 1] += (1 - foot) * down
    slopes[end, 0] += foot * across
    slopes[end, 1] += foot * down


@helper
def _softplus(x):
    return max(x, np.float32(0)) + np.float32(math.log1p(math.exp(-abs(x))))


@helper
def _sigmoid(x):
    return np.float32(1) / (np.float32(1) + np.float32(math.exp(-x)))
