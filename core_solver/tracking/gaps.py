"""Over gaps: a tracklet that ends and one that begins are one person if motion and looks agree from both sides."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.association import FORBIDDEN, UNLIKE, assign
from core_solver.tracking.tracklets import End, Tracklet

Array = NDArray[np.float64]

# Seconds. Short gaps first: what they join gives better motion for the long ones.
_REACHES = (0.5, 1.0, 2.5)
_GATE = 0.30  # sizes
_GATE_GROWTH = 0.5  # sizes a second of gap
_SIZE_RATIO = 1.8
_STRANGEST = 1.2  # miss in gates plus unlikeness: two tracks of one person do less harm than one of two people
_STOP_PENALTY = 0.5  # gates: people stop and turn while they are hidden, but seldom
_SIZE_WEIGHT = 0.5


def link_gaps(tracklets: Sequence[Tracklet]) -> list[Tracklet]:
    """Join tracklets over gaps, in order of their first sight."""
    linked = list(tracklets)
    for reach in _REACHES:
        linked = _link_once(linked, reach)
    return linked


def _link_once(tracklets: list[Tracklet], reach: float) -> list[Tracklet]:
    if len(tracklets) < 2:
        return tracklets
    costs = np.array([[_cost(a.last, b.first, reach) for b in tracklets] for a in tracklets])
    successor = dict(assign(costs))
    follows = set(successor.values())
    return [chain(tracklets, start, successor) for start in range(len(tracklets)) if start not in follows]


def chain(tracklets: Sequence[Tracklet], start: int, successor: Mapping[int, int]) -> Tracklet:
    """One person from a tracklet and those that follow it."""
    sights = tracklets[start].sights
    while start in successor:
        start = successor[start]
        sights += tracklets[start].sights
    return Tracklet(sights)


def _cost(before: End, after: End, reach: float) -> float:
    """Cost of one person leaving sight as `before` and coming back as `after`."""
    gap = after.sight.time - before.sight.time
    if after.sight.row <= before.sight.row or gap > reach:
        return FORBIDDEN
    size = np.sqrt(before.size * after.size)
    gate = size * (_GATE + _GATE_GROWTH * gap)
    forwards = np.linalg.norm(before.centre_at(after.sight.time) - after.sight.centre)
    backwards = np.linalg.norm(after.centre_at(before.sight.time) - before.sight.centre)
    moved = np.linalg.norm(after.sight.centre - before.sight.centre)
    miss = min(float(forwards + backwards) / 2 / gate, float(moved) / gate + _STOP_PENALTY)
    growth = abs(float(np.log(after.size / before.size)))
    trust = before.looks * after.looks
    strangeness = miss + trust * (1 - float(before.appearance @ after.appearance)) / UNLIKE
    if miss > 1 or growth > np.log(_SIZE_RATIO) or strangeness > _STRANGEST:
        return FORBIDDEN
    return strangeness + _SIZE_WEIGHT * growth
