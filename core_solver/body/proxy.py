"""Which vertices stand for the whole body in terms that need positions but no surface."""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import joint_index

Array = NDArray[np.float64]

_COUNT = 500
_SOLE_COUNT = 24
_HAND_COUNT = 16


def choose_proxy(template: Array, weights: Array, count: int = _COUNT) -> NDArray[np.int32]:
    """About `count` vertices: the lowest of each foot, some of each hand, then ever the one farthest from all others.

    Args:
        template: (V, 3) rest vertices, y up, metres.
        weights: (V, 24) skinning weights.
        count: how many vertices are wanted.

    Returns:
        (P,) ascending vertex indices; all vertices if there are no more than `count`.
    """
    if len(template) <= count:
        return np.arange(len(template), dtype=np.int32)
    chosen: list[int] = []
    for side in ("left", "right"):
        foot = _carried_by(weights, f"{side}_ankle", f"{side}_foot")
        chosen += foot[np.argsort(template[foot, 1], kind="stable")[:_SOLE_COUNT]].tolist()
        hand = _carried_by(weights, f"{side}_wrist", f"{side}_hand")
        chosen += hand[
            farthest_points(template[hand], [int(np.argmax(np.abs(template[hand, 0])))], _HAND_COUNT)
        ].tolist()
    return np.sort(farthest_points(template, chosen, count)).astype(np.int32)


def _carried_by(weights: Array, *joints: str) -> NDArray[np.int64]:
    share = weights[:, [joint_index(name) for name in joints]].sum(axis=1)
    return np.flatnonzero(share > 0.5)


def farthest_points(points: Array, chosen: list[int], count: int) -> NDArray[np.int64]:
    """Extend `chosen` to `count` indices, each new one the farthest from those before."""
    indices = list(chosen)
    distance = np.min([np.sum((points - points[i]) ** 2, axis=1) for i in indices], axis=0)
    while len(indices) < min(count, len(points)):
        farthest = int(np.argmax(distance))
        indices.append(farthest)
        distance = np.minimum(distance, np.sum((points - points[farthest]) ** 2, axis=1))
    return np.array(indices)
