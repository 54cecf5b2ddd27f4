"""Projection of one body and its hard z-buffer: the innermost loops of the room, as inlined helpers.

Raster coordinates: x right, y down in pixels, pixel CENTRES at whole numbers. 1/z is linear over the picture of a flat
face, so it is what is interpolated and compared: nearer is larger, and 0 means that nothing was drawn.
"""

import math

import numpy as np

from core_solver.raster.compiling import helper

NEAR = 0.05  # metres; nobody films closer, and the picture of a nearer vertex says nothing
NO_FACE = -1

_FAR_OUT = np.float32(1e6)  # pixels; beyond, single precision cannot place an edge
_EDGE_ON = np.float32(1e-4)  # area over squared size of faces too thin to hold a pixel or a meaningful slope
# Neighbours overlap by this share of a face, so that rounding leaves no pinhole along their common edge.
_INSIDE = np.float32(-1e-5)


@helper
def project(vertices, lens, screen):
    """Write raster x, y and 1/z of vertices (V, 3) to screen (V, 3); vertices that cannot be drawn become NaN."""
    fx, fy, cx, cy = lens[0], lens[1], lens[2], lens[3]
    for i in range(vertices.shape[0]):
        z = np.float32(vertices[i, 2])
        inverse = np.float32(1) / z
        x = fx * np.float32(vertices[i, 0]) * inverse + cx
        y = fy * np.float32(vertices[i, 1]) * inverse + cy
        # Written so that a NaN anywhere fails.
        drawable = z >= NEAR and inverse > 0 and abs(x) < _FAR_OUT and abs(y) < _FAR_OUT
        screen[i, 0] = x if drawable else np.nan
        screen[i, 1] = y if drawable else np.nan
        screen[i, 2] = inverse if drawable else np.nan


@helper
def crop_box(screen, width, height):
    """Pixels (x0, y0, x1, y1), ends excluded, that hold every drawable vertex and one pixel around, cut to the grid."""
    left, top = np.float32(width), np.float32(height)
    right, bottom = np.float32(-1), np.float32(-1)
    for i in range(screen.shape[0]):
        x, y = screen[i, 0], screen[i, 1]
        # In this order a NaN changes nothing: each call replaces its first argument only by a number beyond it.
        left, right = min(left, x), max(right, x)
        top, bottom = min(top, y), max(bottom, y)
    x0, x1 = max(0, math.floor(left) - 1), min(width, math.floor(right) + 3)
    y0, y1 = max(0, math.floor(top) - 1), min(height, math.floor(bottom) + 3)
    if x1 <= x0 or y1 <= y0:
        return 0, 0, 0, 0
    return x0, y0, x1, y1


@helper
def draw(screen, faces, box, inverse_depth, face):
    """Draw the faces that look at the camera into the crop `box`.

    A face is anticlockwise seen from outside; in a picture whose y points down its area is then negative.

    Args:
        screen: (V, 3) from `project`.
        faces: (F, 3).
        box: the crop.
        inverse_depth: (h, w) zeros; becomes 1/z of the nearest face.
        face: (h, w) `NO_FACE`; becomes the index of the nearest face.
    """
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = screen[i, 0], screen[i, 1]
        bx, by = screen[j, 0], screen[j, 1]
        cx, cy = screen[k, 0], screen[k, 1]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if not area < 0:
            continue
        left, right = min(ax, bx, cx), max(ax, bx, cx)
        top, bottom = min(ay, by, cy), max(ay, by, cy)
        x0, x1 = max(box[0], math.ceil(left)), min(box[2] - 1, math.floor(right))
        y0, y1 = max(box[1], math.ceil(top)), min(box[3] - 1, math.floor(bottom))
        if x0 > x1 or y0 > y1:
            continue
        width, height = right - left, bottom - top
        if -area < _EDGE_ON * (width * width + height * height):
            continue
        inverse_area = np.float32(1) / area
        step_a, step_b = (by - cy) * inverse_area, (cy - ay) * inverse_area
        q = screen[k, 2]
        qa, qb = screen[i, 2] - q, screen[j, 2] - q
        column = np.float32(x0)
        for y in range(y0, y1 + 1):
            row = np.float32(y)
            a = ((bx - column) * (cy - row) - (by - row) * (cx - column)) * inverse_area
            b = ((cx - column) * (ay - row) - (cy - row) * (ax - column)) * inverse_area
            for x in range(x0, x1 + 1):
                if a >= _INSIDE and b >= _INSIDE and np.float32(1) - a - b >= _INSIDE:
                    here = q + a * qa + b * qb
                    if here > inverse_depth[y - box[1], x - box[0]]:
                        inverse_depth[y - box[1], x - box[0]] = here
                        face[y - box[1], x - box[0]] = f
                a += step_a
                b += step_b
