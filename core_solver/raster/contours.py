"""Silhouettes in Gauss-Newton form: points of a body's outline and where along a row or column the mask ends.

The area between two outlines is the length over which they differ, summed over all rows, and as well summed over all
columns. So each pair of a covered pixel and an empty neighbour measures, along its row or column, how far the outline
has to move. Both sums are the area on which body and mask disagree; they are mixed by the squared components of the
outline's normal, because a walk that grazes the outline is long and says little.
"""

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import helper, kernel
from core_solver.raster.people import box_of, count_claimed, crop_of, draw_people, fill_cost
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.shading import plane
from core_solver.raster.terms import as_bytes, owners_for

Floats = NDArray[np.float32]

_GOLDEN = (math.sqrt(5) - 1) / 2
_CENTRE = 1 / 3
_ROUND = 2  # pixels to each side from which the outline's normal is taken


@dataclass(frozen=True)
class Contours:
    """S points of each body's outline; those without evidence have weight 0 and target = here.

    A point lies on the face seen at the centre of the last covered pixel, so that it is truly on the body. It should
    move along its axis by as much as the outline beside it: target - here.

    Attributes:
        face: (T, N, S) int32, index of the face that holds the point.
        barycentric: (T, N, S, 3) shares of the face's corners in space (not in the picture); their sum is 1.
        axis: (T, N, S) uint8, 0 if the point moves along u, 1 along v.
        here: (T, N, S) where the point projects along its axis, pixels of the grid.
        target: (T, N, S) where it should, pixels of the grid.
        weight: (T, N, S) pairs the point stands for, times the squared component of the outline's normal along its
            axis: sum(weight * |target - here|) estimates the area in which body and mask disagree, in pixels.
    """

    face: NDArray[np.int32]
    barycentric: Floats
    axis: NDArray[np.uint8]
    here: Floats
    target: Floats
    weight: Floats


def contours(
    vertices: ArrayLike,
    faces: ArrayLike,
    pinhole: Pinhole,
    labels: ArrayLike,
    ids: ArrayLike,
    samples: int = 48,
    reach_px: int = 12,
) -> Contours:
    """Sample the outlines of everybody in a clip and find the edges of their masks.

    From a covered pixel the walk goes outwards while the mask goes on, or inwards while the mask is absent. A walk
    outwards that meets the body again (between two legs) ends half-way; one inwards that leaves the body and meets it
    again ends without result. No evidence: no edge within reach, pixels where the person may be hidden or that nobody
    known owns, the border of the picture, and people whose mask is nowhere visible.

    Args:
        vertices: (T, N, V, 3) metres, camera frame.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid of the labels.
        labels: (T, H, W) uint8, as in `solve_terms`.
        ids: (N,) labels of the people.
        samples: S, spread evenly over each outline; an outline with fewer pairs has padding of weight 0.
        reach_px: the longest walk, pixels.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
    labels = as_bytes(labels, (len(vertices), pinhole.height, pinhole.width))
    shape = (*vertices.shape[:2], samples)
    found = Contours(
        face=np.zeros(shape, np.int32),
        barycentric=np.full((*shape, 3), _CENTRE, np.float32),
        axis=np.zeros(shape, np.uint8),
        here=np.zeros(shape, np.float32),
        target=np.zeros(shape, np.float32),
        weight=np.zeros(shape, np.float32),
    )
    _trace(
        vertices, faces, pinhole.lens, labels, owners_for(ids, vertices), reach_px,
        found.face, found.barycentric, found.axis, found.here, found.target, found.weight,
    )  # fmt: skip
    return found


@kernel
def _trace(vertices, faces, lens, labels, owners, reach, face, barycentric, axis, here, target, weight):
    for frame in numba.prange(vertices.shape[0]):
        _trace_frame(
            vertices[frame], faces, lens, labels[frame], owners, reach,
            face[frame], barycentric[frame], axis[frame], here[frame], target[frame], weight[frame],
        )  # fmt: skip


@helper
def _trace_frame(vertices, faces, lens, labels, owners, reach, face, barycentric, axis, here, target, weight):
    drawn = draw_people(vertices, faces, lens, labels, owners, reach + 1)
    pool = np.empty(drawn.face.shape, np.int8)
    for n in range(vertices.shape[0]):
        box, cost, seen = box_of(drawn, n), crop_of(drawn, pool, n), crop_of(drawn, drawn.face, n)
        fill_cost(drawn, owners, labels, n, box, cost)
        if count_claimed(cost) == 0:
            continue
        pairs = _list_pairs(seen)
        samples = min(len(pairs), weight.shape[1])
        for sample in range(samples):
            row, column, direction = pairs[_chosen(sample, samples, len(pairs))]
            along = direction // 2
            axis[n, sample] = along
            face[n, sample] = seen[row, column]
            _locate(drawn.screen[n], faces[seen[row, column]], column + box[0], row + box[1], barycentric[n, sample])
            here[n, sample] = (row + box[1] if along == 1 else column + box[0]) + 0.5
            target[n, sample] = here[n, sample]
            across, down = _step(direction)
            distance = _distance_to_edge(seen, cost, row, column, down, across, reach)
            if not np.isnan(distance):
                target[n, sample] += distance * (across + down)
                weight[n, sample] = _share_of_axis(seen, row, column, along) * len(pairs) / samples


@helper
def _list_pairs(face):
    """(P, 3) row, column and direction of all pairs of a covered pixel and an empty neighbour."""
    pairs = np.empty((_scan_pairs(face, np.empty((0, 3), np.int32)), 3), np.int32)
    _scan_pairs(face, pairs)
    return pairs


@helper
def _scan_pairs(face, pairs):
    """Count the pairs, and write as many as there is room for."""
    count = 0
    for row in range(face.shape[0]):
        for column in range(face.shape[1]):
            if face[row, column] < 0:
                continue
            for direction in range(4):
                across, down = _step(direction)
                if _is_empty(face, row + down, column + across):
                    if count < pairs.shape[0]:
                        pairs[count, 0], pairs[count, 1], pairs[count, 2] = row, column, direction
                    count += 1
    return count


@helper
def _step(direction):
    """(across, down) of the four directions: right, left, down, up."""
    sign = 1 - 2 * (direction % 2)
    return (0, sign) if direction >= 2 else (sign, 0)


@helper
def _is_empty(face, row, column):
    """Whether a pixel is in the crop and not covered; a crop ends inside the body only at the border of the picture."""
    return 0 <= row < face.shape[0] and 0 <= column < face.shape[1] and face[row, column] < 0


@helper
def _chosen(sample, samples, pairs):
    """The pair that a sample stands for: one from each of equal stretches of pairs.

    Its place in the stretch follows the golden ratio: a fixed place could fall in step with the rows, in which left
    and right edges of a limb take turns, and so see one edge only.
    """
    if samples == pairs:
        return sample
    place = sample * _GOLDEN
    return int((sample + place - math.floor(place)) * pairs / samples)


@helper
def _locate(screen, corners, column, row, barycentric):
    """Write the shares in space of the corners of a face seen at the centre of a pixel."""
    i, j, k = corners[0], corners[1], corners[2]
    a, b, _ = plane(screen, i, j, k, np.float32(column), np.float32(row))
    # A step in the picture is a longer step in space where the face is farther away.
    a, b, c = a * screen[i, 2], b * screen[j, 2], (1 - a - b) * screen[k, 2]
    barycentric[0], barycentric[1], barycentric[2] = a / (a + b + c), b / (a + b + c), c / (a + b + c)


@helper
def _share_of_axis(face, row, column, along):
    """Squared component of the outline's normal along an axis (0 = x), from the pixels covered round about."""
    x, y = 0, 0
    for down in range(-_ROUND, _ROUND + 1):
        for across in range(-_ROUND, _ROUND + 1):
            if _is_empty(face, row + down, column + across):
                x += across
                y += down
    if x == 0 and y == 0:
        return 0.5
    return (y * y if along == 1 else x * x) / (x * x + y * y)


@helper
def _distance_to_edge(face, cost, row, column, down, across, reach):
    """Pixels by which the outline beside a covered pixel should move outwards (negative: inwards); NaN if unknown."""
    beside = cost[row + down, column + across]
    if beside == 0 or cost[row, column] == 0:
        return np.nan
    if beside < 0:
        return _walk_outwards(face, cost, row + down, column + across, down, across, reach)
    if cost[row, column] < 0:
        return 0.0
    return _walk_inwards(face, cost, row, column, -down, -across, reach)


@helper
def _walk_outwards(face, cost, row, column, down, across, reach):
    for step in range(reach + 1):
        if not (0 <= row < face.shape[0] and 0 <= column < face.shape[1]) or cost[row, column] == 0:
            return np.nan
        if face[row, column] >= 0:
            return step / 2
        if cost[row, column] > 0:
            return float(step)
        row, column = row + down, column + across
    return np.nan


@helper
def _walk_inwards(face, cost, row, column, down, across, reach):
    left_the_body = False
    for step in range(reach + 1):
        if not (0 <= row < face.shape[0] and 0 <= column < face.shape[1]) or cost[row, column] == 0:
            return np.nan
        covered = face[row, column] >= 0
        if left_the_body and covered:
            return np.nan
        if cost[row, column] < 0:
            return -float(step)
        left_the_body = not covered
        row, column = row + down, column + across
    return np.nan
