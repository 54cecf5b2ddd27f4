"""Boxes (n, 4) left, top, right, bottom."""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]


def corners_from_centres(boxes: Floats) -> Floats:
    """From (n, 4) centre x, centre y, width, height."""
    half = boxes[:, 2:] / 2
    return np.concatenate([boxes[:, :2] - half, boxes[:, :2] + half], axis=1).astype(np.float32)


def overlaps(box: Floats, others: Floats) -> Floats:
    """Intersection over union of a box (4,) with others (n, 4)."""
    sides = np.minimum(box[2:], others[:, 2:]) - np.maximum(box[:2], others[:, :2])
    common = np.maximum(sides, 0).prod(axis=1)
    area = np.maximum(others[:, 2:] - others[:, :2], 0).prod(axis=1)
    own = np.maximum(box[2:] - box[:2], 0).prod()
    return common / np.maximum(own + area - common, 1e-9)


def suppress(boxes: Floats, scores: Floats, overlap: float) -> NDArray[np.int_]:
    """Non-maximum suppression.

    Args:
        boxes: (n, 4).
        scores: (n,).
        overlap: above which the box of lower score is dropped.

    Returns:
        numbers of the kept boxes, surest first.
    """
    order = np.argsort(-scores, kind="stable")
    kept = []
    while len(order):
        best, order = order[0], order[1:]
        kept.append(best)
        order = order[overlaps(boxes[best], boxes[order]) <= overlap]
    return np.array(kept, int)
