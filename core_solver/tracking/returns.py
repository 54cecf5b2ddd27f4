"""Over long absences: somebody leaves the picture and comes back in the same clothes.

Motion says nothing after many seconds, so looks must say all: the clothes of both must be the same as closely as one
person's are from second to second, and nobody else may come into question. In doubt they are two people: the user can
merge them.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.association import FORBIDDEN
from core_solver.tracking.gaps import chain
from core_solver.tracking.sights import Sight
from core_solver.tracking.tracklets import Tracklet

Array = NDArray[np.float64]

_LONGEST_S = 30.0
_BORDER = 0.04  # of the picture's sides: who vanishes this near to one has left through it
_LOOKED_AT = 40  # sights nearest to the absence
_LEAST_SIGHTS = 8
# One person's clothes, averaged over that many sights, agree to 0.005; those of two people dressed alike to 0.03.
_SAME_CLOTHES = 0.010
_RIVAL = 3.0  # times as unlike anybody else must be, and more than `_SAME_CLOTHES`
_IN_DOUBT = _SAME_CLOTHES  # no longer a pair, still a rival of others
_SIZE_RATIO = 1.8


def link_returns(tracklets: Sequence[Tracklet], image_size: tuple[int, int]) -> list[Tracklet]:
    """Join tracklets of people who left the picture and came back through the same side.

    Args:
        tracklets: one a person and stay.
        image_size: (width, height) pixels.

    Returns:
        Tracklets in order of their first sight.
    """
    if len(tracklets) < 2:
        return list(tracklets)
    costs = np.array([[_cost(a, b, image_size) for b in tracklets] for a in tracklets])
    spans = np.array([(t.sights[0].row, t.sights[-1].row) for t in tracklets])
    successor = _sure_pairs(_without_detours(costs), spans)
    follows = set(successor.values())
    return [chain(tracklets, start, successor) for start in range(len(tracklets)) if start not in follows]


def _without_detours(costs: Array) -> Array:
    """The costs without pairs between which the same person was in the picture once more."""
    alike = (costs < _SAME_CLOTHES).astype(int)
    return np.where(alike @ alike > 0, FORBIDDEN, costs)


def _sure_pairs(costs: Array, spans: Array) -> dict[int, int]:
    """{leaver: comer}, the likest first, as long as nobody who is left comes into question for either.

    Only somebody who is there at the same time is another person: a later stay may well be the comer's own.

    Args:
        costs: (n, n) from leavers to comers.
        spans: (n, 2) first and last row.
    """
    together = (spans[:, None, 0] <= spans[None, :, 1]) & (spans[None, :, 0] <= spans[:, None, 1])
    np.fill_diagonal(together, val=False)
    costs, pairs = costs.copy(), {}
    while costs.size and costs.min() < _SAME_CLOTHES:
        leaver, comer = (int(i) for i in np.unravel_index(np.argmin(costs), costs.shape))
        rivals = np.concatenate([costs[together[leaver], comer], costs[leaver, together[comer]]])
        if np.all(rivals > max(_RIVAL * costs[leaver, comer], _SAME_CLOTHES)):
            pairs[leaver] = comer
            costs[leaver], costs[:, comer] = FORBIDDEN, FORBIDDEN
        else:
            costs[leaver, comer] = _IN_DOUBT
    return pairs


def _cost(leaver: Tracklet, comer: Tracklet, image_size: tuple[int, int]) -> float:
    """How unlike the clothes are; FORBIDDEN where it cannot be one person."""
    before, after = leaver.sights[-1], comer.sights[0]
    if not 0 < after.time - before.time <= _LONGEST_S or after.row <= before.row:
        return FORBIDDEN
    if not _sides(before, image_size) & _sides(after, image_size):
        return FORBIDDEN
    if abs(float(np.log(comer.first.size / leaver.last.size))) > np.log(_SIZE_RATIO):
        return FORBIDDEN
    last, first = _looks(leaver.sights[::-1]), _looks(comer.sights)
    return FORBIDDEN if last is None or first is None else max(float(1 - last @ first), 1e-6)


def _sides(sight: Sight, image_size: tuple[int, int]) -> set[str]:
    """The sides of the picture at which somebody is."""
    left, top, right, bottom = sight.detection.box / np.tile(image_size, 2)
    near = {"left": left, "top": top, "right": 1 - right, "bottom": 1 - bottom}
    return {side for side, distance in near.items() if distance < _BORDER}


def _looks(sights: Sequence[Sight]) -> Array | None:
    """(D,) unit vector: the clothes in the first trusted sights; None where there are too few."""
    trusted = [s.detection.appearance for s in sights if s.looks == 1][:_LOOKED_AT]
    if len(trusted) < _LEAST_SIGHTS:
        return None
    total = np.sum(trusted, axis=0, dtype=float)
    return total / max(float(np.linalg.norm(total)), 1e-9)
