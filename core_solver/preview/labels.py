"""Names over a picture, none over another: who finds their place taken moves aside, and a thin line leads back."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.preview.text import draw_text, text_size

Array = NDArray[np.float64]

_ABOVE = 0.4  # of a label's height, between it and what it names
_LINE_FROM = 1.0  # of a label's height: what is no farther away needs no line
_DOWNWARDS = 2.0  # times as far as upwards: below a head there are bodies


@dataclass(frozen=True)
class Label:
    """Words for a place in the picture.

    Attributes:
        text: in the letters OpenCV can draw.
        anchor: (u, v) pixels of what is named; the words stand above it where there is room.
        colour: blue, green, red, 0-255, of the line that leads there where there is none.
    """

    text: str
    anchor: tuple[float, float]
    colour: tuple[int, int, int]


def draw_labels(picture: NDArray[np.uint8], labels: Sequence[Label], size: float, taken: Sequence[Array] = ()) -> None:
    """Draw labels so that all can be read.

    Args:
        picture: (h, w, 3) BGR.
        labels: those that come first stay nearest to their anchors.
        size: of the letters.
        taken: boxes (left, top, right, bottom) in pixels where other words stand.
    """
    sizes = np.array([text_size(label.text, size) for label in labels], float).reshape(-1, 2)
    anchors = np.array([label.anchor for label in labels], float).reshape(-1, 2)
    boxes = place_boxes(sizes, anchors, (picture.shape[1], picture.shape[0]), taken)
    for label, box, anchor in zip(labels, boxes, anchors, strict=True):
        _draw_line(picture, box, anchor, label.colour, max(1, round(2 * size)))
    for label, box in zip(labels, boxes, strict=True):
        draw_text(picture, label.text, (box[0], box[3]), size)


def place_boxes(sizes: Array, anchors: Array, picture: tuple[int, int], taken: Sequence[Array] = ()) -> Array:
    """Boxes (N, 4) as left, top, right, bottom: inside the picture and free of each other, each near its anchor.

    One after the other in the given order, not in one by place: two people who walk abreast would swap their labels
    in every step. A box that cannot stand right above its anchor takes the nearest free place that touches others.

    Args:
        sizes: (N, 2) width and height, pixels.
        anchors: (N, 2) pixels.
        picture: (width, height).
        taken: boxes (4,) to keep free of, besides.
    """
    placed = [np.asarray(box, float) for box in taken]
    boxes = np.zeros((len(sizes), 4))
    for index, (size, anchor) in enumerate(zip(sizes, anchors, strict=True)):
        wanted = anchor - size * (0.5, 1 + _ABOVE)
        corner = _nearest_free(wanted, size, np.array(placed).reshape(-1, 4), np.array(picture, float))
        boxes[index] = *corner, *(corner + size)
        placed.append(boxes[index])
    return boxes


def _nearest_free(wanted: Array, size: Array, placed: Array, picture: Array) -> Array:
    """The upper left corner (2,); the wanted one, if need be moved into the picture, where nothing is free."""
    room = np.maximum(picture - size, 0)
    lefts = np.concatenate([[wanted[0]], placed[:, 0] - size[0], placed[:, 2]])
    tops = np.concatenate([[wanted[1]], placed[:, 1] - size[1], placed[:, 3]])
    corners = np.clip(np.stack(np.meshgrid(lefts, tops), axis=-1).reshape(-1, 2), 0, room)
    apart = (corners[:, None] >= placed[:, 2:]) | (corners[:, None] + size <= placed[:, :2])
    free = apart.any(axis=-1).all(axis=-1)
    move = corners - wanted
    distance = np.hypot(move[:, 0], np.where(move[:, 1] > 0, _DOWNWARDS, 1) * move[:, 1])
    return corners[int(np.argmin(np.where(free, distance, np.inf)))] if free.any() else np.clip(wanted, 0, room)


def _draw_line(
    picture: NDArray[np.uint8], box: Array, anchor: Array, colour: tuple[int, int, int], thickness: int
) -> None:
    """From the nearest point of the box to what it names, where they are far apart."""
    end = np.clip(anchor, box[:2], box[2:])
    if np.hypot(*(anchor - end)) > _LINE_FROM * (box[3] - box[1]):
        start, stop = ((round(u), round(v)) for u, v in (end.tolist(), anchor.tolist()))
        cv2.line(picture, start, stop, colour, thickness, cv2.LINE_AA)
