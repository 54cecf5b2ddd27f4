"""What a drawn body says against its mask: mean log depth, wrong pixels, and how both change with its vertices.

The evidence is one small integer a pixel, the COST of covering it: -1 in the person's mask, 1 beside it, 0 where
nothing is known. Covering all pixels of a body then changes the number of wrong pixels by the sum of their costs.

Depth: the pixels a body covers are held fast; the depth seen there changes with the plane of the face.
Silhouette: its outline runs somewhere between the centres of a covered pixel and an empty neighbour, anywhere with the
same probability. Moving it outwards by dx covers the empty one in dx of the cases, moving it inwards uncovers the other
one, so the slope is the mean of the two costs. It pulls at the face seen in the covered pixel.
"""

import math

import numpy as np

from core_solver.raster.compiling import helper

# Columns of the gradient that `shade` gathers in raster coordinates.
_DEPTH_X, _DEPTH_Y, _DEPTH_Q, _OUTLINE_X, _OUTLINE_Y = range(5)
# Logs are taken of products of 1/z, as many as double precision holds, because a log takes longer than all the rest.
_LEAST, _MOST = 1e-200, 1e200
COLUMNS = 5  # of that gradient


@helper
def shade(screen, faces, box, inverse_depth, face, cost, gradient):
    """Compare one drawn body with its evidence.

    Args:
        screen: (V, 3) from `project`.
        faces: (F, 3).
        box: crop that the next three arrays show.
        inverse_depth: (h, w) from `draw`.
        face: (h, w) from `draw`.
        cost: (h, w) int8, see above.
        gradient: (V, COLUMNS) zeros; receives the slopes of the sum of log depths and of the number of wrong pixels.

    Returns:
        Sum of log depths where body and mask meet, the number of those pixels, and the sum of costs under the body.
    """
    logs, product, pixels, costs = 0.0, 1.0, 0, 0
    for row in range(face.shape[0]):
        for column in range(face.shape[1]):
            if face[row, column] < 0:
                continue
            here = cost[row, column]
            costs += here
            across, down = _pull(face, cost, row, column)
            if here >= 0 and across == 0 and down == 0:
                continue
            f = face[row, column]
            i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
            x, y = np.float32(column + box[0]), np.float32(row + box[1])
            a, b, slopes = plane(screen, i, j, k, x, y)
            c = np.float32(1) - a - b
            if here < 0:
                q = inverse_depth[row, column]
                product *= q
                if not _LEAST < product < _MOST:
                    logs, product = logs - math.log(product), 1.0
                pixels += 1
                _add_depth(gradient, i, a, q, slopes)
                _add_depth(gradient, j, b, q, slopes)
                _add_depth(gradient, k, c, q, slopes)
            if across != 0 or down != 0:
                _add_outline(gradient, i, a, across, down)
                _add_outline(gradient, j, b, across, down)
                _add_outline(gradient, k, c, across, down)
    return logs - math.log(product), pixels, costs


@helper
def plane(screen, i, j, k, x, y):
    """Weights of the first two corners of a face at a point of the picture, and the slopes of 1/z along x and y."""
    ax, ay, bx, by, cx, cy = screen[i, 0], screen[i, 1], screen[j, 0], screen[j, 1], screen[k, 0], screen[k, 1]
    inverse_area = np.float32(1) / ((bx - ax) * (cy - ay) - (by - ay) * (cx - ax))
    a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) * inverse_area
    b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) * inverse_area
    qa, qb = screen[i, 2] - screen[k, 2], screen[j, 2] - screen[k, 2]
    along_x = ((by - cy) * qa + (cy - ay) * qb) * inverse_area
    along_y = ((cx - bx) * qa + (ax - cx) * qb) * inverse_area
    return a, b, (along_x, along_y)


@helper
def _pull(face, cost, row, column):
    """Slope of the number of wrong pixels when the outline beside a covered pixel moves along x and y."""
    height, width = face.shape
    twice_x, twice_y = 0, 0
    if column + 1 < width and face[row, column + 1] < 0:
        twice_x += cost[row, column] + cost[row, column + 1]
    if column > 0 and face[row, column - 1] < 0:
        twice_x -= cost[row, column] + cost[row, column - 1]
    if row + 1 < height and face[row + 1, column] < 0:
        twice_y += cost[row, column] + cost[row + 1, column]
    if row > 0 and face[row - 1, column] < 0:
        twice_y -= cost[row, column] + cost[row - 1, column]
    return np.float32(0.5) * np.float32(twice_x), np.float32(0.5) * np.float32(twice_y)


@helper
def _add_depth(gradient, vertex, share, q, slopes):
    """Slope of log z = -log q by one corner: its own 1/z, and its shift, which carries the plane along."""
    pull = share / q
    gradient[vertex, _DEPTH_X] += pull * slopes[0]
    gradient[vertex, _DEPTH_Y] += pull * slopes[1]
    gradient[vertex, _DEPTH_Q] -= pull


@helper
def _add_outline(gradient, vertex, share, across, down):
    gradient[vertex, _OUTLINE_X] += share * across
    gradient[vertex, _OUTLINE_Y] += share * down


@helper
def to_camera_frame(vertices, screen, lens, gradient, pixels, claimed, depth_gradient, outline_gradient):
    """Turn raster slopes of sums into slopes of means by vertices (V, 3) in metres; vertices not drawn get zeros."""
    depth_share = np.float32(1.0 / max(pixels, 1))
    outline_share = np.float32(1.0 / claimed) if claimed > 0 else np.float32(0)
    for i in range(vertices.shape[0]):
        q = screen[i, 2]
        if not q > 0:
            depth_gradient[i, :] = 0
            outline_gradient[i, :] = 0
            continue
        X, Y = np.float32(vertices[i, 0]), np.float32(vertices[i, 1])
        across, down = gradient[i, _DEPTH_X] * lens[0], gradient[i, _DEPTH_Y] * lens[1]
        depth_gradient[i, 0] = depth_share * across * q
        depth_gradient[i, 1] = depth_share * down * q
        depth_gradient[i, 2] = -depth_share * (across * X + down * Y + gradient[i, _DEPTH_Q]) * q * q
        across, down = gradient[i, _OUTLINE_X] * lens[0], gradient[i, _OUTLINE_Y] * lens[1]
        outline_gradient[i, 0] = outline_share * across * q
        outline_gradient[i, 1] = outline_share * down * q
        outline_gradient[i, 2] = -outline_share * (across * X + down * Y) * q * q
