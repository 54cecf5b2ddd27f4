"""Reading instance masks: RTMDet-Ins, YOLO-seg and Mask2Former's kind. A mask covers the network's whole input."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.perception.networks.boxes import corners_from_centres, suppress

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Instances:
    """People's masks.

    Attributes:
        scores: (n,).
        masks: (n, h, w) probabilities on a grid laid over the network's input.
    """

    scores: Floats
    masks: Floats


def read_rtmdet(dets: Floats, labels: Floats, masks: Floats, score: float, person_class: int) -> Instances:
    """RTMDet-Ins: boxes with scores (1, n, 5), classes (1, n) and masks (1, n, h, w), each 0 or 1 or between."""
    scores = dets[0, :, 4]
    people = (scores >= score) & (np.round(labels[0]) == person_class)
    return Instances(scores[people], np.clip(masks[0, people], 0, 1))


def read_yolo_seg(
    predictions: Floats, protos: Floats, size: tuple[int, int], score: float, person_class: int, overlap: float
) -> Instances:
    """YOLO-seg: a mask is a sum of prototypes, inside its box.

    Args:
        predictions: (1, 4 + C + M, n): centre and size in input pixels, C class scores, M coefficients.
        protos: (1, M, h, w).
        size: (width, height) of the input.
        score: least score.
        person_class: among the C.
        overlap: of boxes, above which the weaker is dropped.

    Raises:
        ValueError: there is no class of that number.
    """
    count, height, width = protos.shape[1:]
    rows = predictions[0].T
    classes = rows[:, 4 : rows.shape[1] - count]
    if classes.shape[1] <= person_class:
        raise ValueError(f"{predictions.shape} and {protos.shape} leave no class {person_class}")
    sure = (classes.argmax(axis=1) == person_class) & (classes[:, person_class] >= score)
    rows, scores = rows[sure], classes[sure, person_class]
    boxes = corners_from_centres(rows[:, :4])
    kept = suppress(boxes, scores, overlap)
    logits = np.tensordot(rows[kept, rows.shape[1] - count :], protos[0], axes=1)
    cells = boxes[kept].reshape(-1, 2, 2) * (width / size[0], height / size[1])
    return Instances(scores[kept], _sigmoid(logits) * _inside(cells, height, width))


def read_mask2former(classes: Floats, masks: Floats, score: float, person_class: int) -> Instances:
    """Mask2Former's kind: class logits (1, q, C + 1), the last for "nothing", and mask logits (1, q, h, w).

    Raises:
        ValueError: there is no class of that number.
    """
    if classes.shape[2] - 1 <= person_class:
        raise ValueError(f"{classes.shape} leaves no class {person_class}")
    odds = np.exp(classes[0] - classes[0].max(axis=1, keepdims=True))
    chances = odds / odds.sum(axis=1, keepdims=True)
    people = (chances.argmax(axis=1) == person_class) & (chances[:, person_class] >= score)
    return Instances(chances[people, person_class], _sigmoid(masks[0, people]))


def _inside(boxes: Floats, height: int, width: int) -> NDArray[np.bool_]:
    """(n, height, width) whether a cell's centre lies in the box (n, 2, 2)."""
    x, y = np.arange(width) + 0.5, np.arange(height) + 0.5
    low, high = boxes[:, 0, :, None], boxes[:, 1, :, None]
    across = (x >= low[:, 0]) & (x <= high[:, 0])
    down = (y >= low[:, 1]) & (y <= high[:, 1])
    return down[:, :, None] & across[:, None, :]


def _sigmoid(logits: Floats) -> Floats:
    return (1 / (1 + np.exp(-np.clip(logits, -60, 60)))).astype(np.float32)
