"""Over gaps: a tracklet that ends and one that begins are one person if motion and looks agree from both sides."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.association import FORBIDDEN, MOMENT, MOST_UNLIKE, UNLIKE, assign
from core_solver.tracking.tracklets import APPEARANCE_SIGHTS, End, Tracklet

Array = NDArray[np.float64]

# Seconds. Short gaps first: what they join gives better motion for the long ones.
_REACHES = (0.5, 1.0, 2.5, 6.0)
_WALKING_REACH = 2.5  # beyond, only who stood behind something is believed to be still there
_STANDING_GATE = 0.5  # sizes
_GATE = 0.30  # sizes
_GATE_GROWTH = 0.5  # sizes a second of gap
_SIZE_RATIO = 1.8
_STRANGEST = 1.2  # miss in gates plus unlikeness: two tracks of one person do less harm than one of two people
_STOP_PENALTY = 0.5  # gates: people stop and turn while they are hidden, but seldom
_SIZE_WEIGHT = 0.5
_CHANGED = 0.03  # half of `UNLIKE`: one person's looks seldom change so much within two seconds


def link_gaps(tracklets: Sequence[Tracklet]) -> list[Tracklet]:
    """Join tracklets over gaps, in order of their first sight.

    When two people meet, a tracklet may go over from one to the other: then looks change at once and for good. There
    it is cut first, and looks and motion decide together which parts belong to each other.
    """
    linked = sorted((part for t in tracklets for part in cut_where_looks_change(t)), key=_start)
    for reach in _REACHES:
        linked = _link_once(linked, reach)
    return linked


def cut_where_looks_change(tracklet: Tracklet) -> list[Tracklet]:
    """The parts of a tracklet between sudden lasting changes of its looks: mostly the tracklet itself."""
    sights = tracklet.sights
    trusted = [i for i, s in enumerate(sights) if s.looks == 1]
    if len(trusted) < 2 * APPEARANCE_SIGHTS:
        return [tracklet]
    seen = np.stack([sights[i].detection.appearance for i in trusted]).astype(float)
    sums = np.concatenate([np.zeros((1, seen.shape[1])), np.cumsum(seen, axis=0)])
    windows = sums[APPEARANCE_SIGHTS:] - sums[:-APPEARANCE_SIGHTS]
    windows /= np.maximum(np.linalg.norm(windows, axis=1, keepdims=True), 1e-9)
    change = 1 - np.sum(windows[:-APPEARANCE_SIGHTS] * windows[APPEARANCE_SIGHTS:], axis=1)
    worst = int(np.argmax(change))
    if change[worst] < _CHANGED:
        return [tracklet]
    cut = trusted[worst + APPEARANCE_SIGHTS]
    return [part for side in (sights[:cut], sights[cut:]) for part in cut_where_looks_change(Tracklet(side))]


def _start(tracklet: Tracklet) -> int:
    return tracklet.sights[0].row


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
    if gap <= _WALKING_REACH:
        miss = min(float(forwards + backwards) / 2 / gate, float(moved) / gate + _STOP_PENALTY)
    else:
        miss = float(moved) / (size * _STANDING_GATE)
    growth = abs(float(np.log(after.size / before.size)))
    unlike = before.looks * after.looks * (1 - float(before.appearance @ after.appearance)) / UNLIKE
    strangeness = miss + (min(unlike, MOST_UNLIKE) if gap < MOMENT else unlike)
    if miss > 1 or growth > np.log(_SIZE_RATIO) or strangeness > _STRANGEST:
        return FORBIDDEN
    return strangeness + _SIZE_WEIGHT * growth
