"""The people of one frame drawn one by one, and what a pixel is evidence of: occlusion is decided by depth.

A person is hidden where another's body is drawn nearer, and where the labels name another whose body as a whole is
nearer than the person at that place. A person's depth at a place is that of the drawn face or, beside the body, the
mean depth. A pixel that nobody is known to own, though somebody stands there, is evidence for no one.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import helper
from core_solver.raster.zbuffer import NO_FACE, crop_box, draw, project
from core_solver.tracking.tracks import BACKGROUND

MARGIN = np.float32(0.05)  # metres by which another must be nearer: bodies that touch do not hide each other

# What a label means besides a person's index.
NOBODY = -1
UNKNOWN = -2


class Drawn(NamedTuple):
    """One frame's people, each drawn alone into a crop that holds the body and its mask; all crops share a pool.

    Attributes:
        screen: (N, V, 3) raster x, y and 1/z.
        boxes: (N, 4) crops x0, y0, x1, y1, ends excluded.
        starts: (N + 1,) where the crops begin in the pool, one after the other.
        inverse_depth: (P,) 1/z in metres, 0 where empty.
        face: (P,) index of the face, or NO_FACE.
        mean_depth: (N,) metres, of all vertices that can be drawn; -inf without any: that body may be anywhere.
    """

    screen: Any
    boxes: Any
    starts: Any
    inverse_depth: Any
    face: Any
    mean_depth: Any


def owners_of(ids: ArrayLike) -> NDArray[np.int16]:
    """(256,) what each label means: a person's index, NOBODY, or UNKNOWN for people who are not among `ids` (N,)."""
    ids = np.asarray(ids, np.int64).reshape(-1)
    if len(set(ids.tolist())) < len(ids) or np.any((ids <= BACKGROUND) | (ids >= 255)):
        raise ValueError(f"labels of people must differ and lie in 1 to 254, not {ids.tolist()}")
    owners = np.full(256, UNKNOWN, np.int16)
    owners[BACKGROUND] = NOBODY
    owners[ids] = np.arange(len(ids))
    return owners


@helper
def draw_people(vertices, faces, lens, labels, owners, border):
    """Draw the people (N, V, 3) of one frame with labels (H, W) into crops with a border of so many pixels."""
    count = vertices.shape[0]
    height, width = labels.shape
    screen = np.empty(vertices.shape, np.float32)
    boxes, starts = _mask_boxes(labels, owners, count), np.zeros(count + 1, np.int64)
    mean_depth = np.empty(count, np.float32)
    for n in range(count):
        project(vertices[n], lens, screen[n])
        mean_depth[n] = _mean_depth(screen[n])
        _widen(boxes[n], crop_box(screen[n], width, height), border, width, height)
        starts[n + 1] = starts[n] + (boxes[n, 2] - boxes[n, 0]) * (boxes[n, 3] - boxes[n, 1])
    inverse_depth = np.zeros(starts[count], np.float32)
    face = np.full(starts[count], NO_FACE, np.int32)
    drawn = Drawn(screen, boxes, starts, inverse_depth, face, mean_depth)
    for n in range(count):
        draw(screen[n], faces, box_of(drawn, n), crop_of(drawn, inverse_depth, n), crop_of(drawn, face, n))
    return drawn


@helper
def _mask_boxes(labels, owners, count):
    """(count, 4) boxes x0, y0, x1, y1 around each person's labels, ends excluded; x0 > x1 without any."""
    height, width = labels.shape
    boxes = np.empty((count, 4), np.int64)
    for n in range(count):
        boxes[n, 0], boxes[n, 1], boxes[n, 2], boxes[n, 3] = width, height, 0, 0
    for y in range(height):
        for x in range(width):
            if labels[y, x] == BACKGROUND:
                continue
            n = owners[labels[y, x]]
            if n >= 0:
                boxes[n, 0], boxes[n, 1] = min(boxes[n, 0], x), min(boxes[n, 1], y)
                boxes[n, 2], boxes[n, 3] = max(boxes[n, 2], x + 1), max(boxes[n, 3], y + 1)
    return boxes


@helper
def _widen(box, other, border, width, height):
    """Grow a box to hold another one, if that is not empty, and a border."""
    if other[2] > other[0]:
        box[0], box[1] = min(box[0], other[0]), min(box[1], other[1])
        box[2], box[3] = max(box[2], other[2]), max(box[3], other[3])
    if box[2] <= box[0]:
        box[:] = 0
        return
    box[0], box[1] = max(box[0] - border, 0), max(box[1] - border, 0)
    box[2], box[3] = min(box[2] + border, width), min(box[3] + border, height)


@helper
def _mean_depth(screen):
    total, count = 0.0, 0
    for i in range(screen.shape[0]):
        q = screen[i, 2]
        if q > 0:
            total += np.float32(1) / q
            count += 1
    return np.float32(total / count) if count > 0 else np.float32(-np.inf)


@helper
def box_of(drawn, person):
    """The crop of one person as a tuple."""
    boxes = drawn.boxes
    return boxes[person, 0], boxes[person, 1], boxes[person, 2], boxes[person, 3]


@helper
def crop_of(drawn, pool, person):
    """One person's crop (h, w) of a pool such as `drawn.face`."""
    x0, y0, x1, y1 = box_of(drawn, person)
    return pool[drawn.starts[person] : drawn.starts[person + 1]].reshape(y1 - y0, x1 - x0)


@helper
def fill_cost(drawn, owners, labels, person, box, cost):
    """Write what covering a pixel costs a person: -1 in the own mask, 1 beside it, 0 where the person may be hidden.

    Args:
        drawn: the frame's people.
        owners: (256,) from `owners_of`.
        labels: (H, W).
        person: index of the person asked about.
        box: x0, y0, x1, y1 of the pixels asked about, ends excluded.
        cost: (h, w) int8, the pixels of the box, filled in.
    """
    depth = _depth_in(drawn, person, box)
    x0, y0, x1, y1 = box
    for y in range(y0, y1):
        for x in range(x0, x1):
            owner = owners[labels[y, x]]
            if owner == NOBODY:
                here = 1
            elif owner == person:
                here = -1
            elif owner == UNKNOWN or drawn.mean_depth[owner] + MARGIN < depth[y - y0, x - x0]:
                here = 0
            else:
                here = 1
            cost[y - y0, x - x0] = here
    for other in range(drawn.boxes.shape[0]):
        if other != person:
            _hide_behind(drawn, other, box, depth, cost)


@helper
def _depth_in(drawn, person, box):
    """(h, w) depth of a person in a box: the body's where it is drawn, else its mean."""
    x0, y0, x1, y1 = box
    depth = np.full((y1 - y0, x1 - x0), drawn.mean_depth[person])
    crop = crop_of(drawn, drawn.inverse_depth, person)
    left, top, right, bottom = box_of(drawn, person)
    for y in range(max(y0, top), min(y1, bottom)):
        for x in range(max(x0, left), min(x1, right)):
            if crop[y - top, x - left] > 0:
                depth[y - y0, x - x0] = np.float32(1) / crop[y - top, x - left]
    return depth


@helper
def _hide_behind(drawn, other, box, depth, cost):
    """Clear the cost of pixels in a box where another's body is drawn in front of the depth (h, w)."""
    x0, y0, x1, y1 = box
    crop = crop_of(drawn, drawn.inverse_depth, other)
    left, top, right, bottom = box_of(drawn, other)
    for y in range(max(y0, top), min(y1, bottom)):
        for x in range(max(x0, left), min(x1, right)):
            # Where the other is not drawn, 1/0 is infinitely far and hides nothing.
            if np.float32(1) / crop[y - top, x - left] + MARGIN < depth[y - y0, x - x0]:
                cost[y - y0, x - x0] = 0


@helper
def count_claimed(cost):
    """Pixels of the own mask in which the person is not hidden."""
    claimed = 0
    for row in range(cost.shape[0]):
        for column in range(cost.shape[1]):
            claimed += cost[row, column] < 0
    return claimed
