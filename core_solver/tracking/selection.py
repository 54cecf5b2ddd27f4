"""Who is solved: people with enough evidence over time, named in a stable order."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.evidence import MIN_FRAMES, mean_score, real_people
from core_solver.tracking.tracklets import Tracklet
from core_solver.tracking.tracks import UNCLAIMED, DroppedTrack

Array = NDArray[np.float64]

MIN_SHARE = 0.10
MIN_SECONDS = 1.5
TALL = 60.0  # pixels

_REPORTED_FRAMES = 3  # shorter sights are flicker of the detector, not somebody left out


@dataclass(frozen=True)
class Selection:
    """The people to solve, in the order of their ids, and those left out, in the order of their first sight."""

    people: tuple[Tracklet, ...]
    left_out: tuple[Tracklet, ...]


def required_frames(tracklet: Tracklet, times: Array) -> int:
    """Sights a person needs to be solved.

    10 % of the clip, or 1.5 s for somebody who is at least 60 pixels tall that long, if that is less (of 2 s in the
    picture a detector misses some); never under 8 frames, except in a shorter clip.

    Args:
        tracklet: the person.
        times: (T,) seconds.
    """
    count = len(times)
    share = math.ceil(MIN_SHARE * count)
    step = float(np.median(np.diff(times))) if count > 1 else 1.0
    brief = max(math.ceil(MIN_SECONDS / max(step, 1e-6) - 1e-6), MIN_FRAMES)
    is_tall = sum(s.size >= TALL for s in tracklet.sights) >= brief
    return min(max(min(share, brief) if is_tall else share, MIN_FRAMES), count)


def select_people(tracklets: Sequence[Tracklet], times: Array, people: int | None) -> Selection:
    """Choose the people to solve.

    Args:
        tracklets: one a candidate.
        times: (T,) seconds.
        people: at most this many, the best seen ones; None for everybody.
    """
    candidates = real_people(tracklets)
    long_enough = [t for t in candidates if len(t.sights) >= required_frames(t, times)]
    limit = min(UNCLAIMED - 1, people if people is not None else UNCLAIMED - 1)
    best = sorted(long_enough, key=_prominence, reverse=True)[:limit]
    left_out = [t for t in candidates if t not in best and len(t.sights) >= min(_REPORTED_FRAMES, len(times))]
    return Selection(tuple(sorted(best, key=_appearance_order)), tuple(sorted(left_out, key=_appearance_order)))


def _prominence(tracklet: Tracklet) -> float:
    """Length times score times size: whom a viewer would call the main person."""
    size = float(np.mean([s.size for s in tracklet.sights]))
    return len(tracklet.sights) * mean_score(tracklet) * size


def _appearance_order(tracklet: Tracklet) -> tuple[float, ...]:
    """First who is seen first, then from left to right."""
    first = tracklet.sights[0]
    return (first.row, *map(float, first.centre))


def describe_dropped(tracklet: Tracklet, times: Array) -> DroppedTrack:
    """Somebody who is left out, in numbers for the summary."""
    boxes = np.stack([s.detection.box for s in tracklet.sights]).astype(float)
    u, v = (boxes[:, :2] + boxes[:, 2:]).mean(axis=0) / 2
    needed = required_frames(tracklet, times)
    return DroppedTrack(tracklet.sights[0].row, len(tracklet.sights), (float(u), float(v)), needed)


def describe_left_out(dropped: Sequence[DroppedTrack]) -> list[str]:
    """A sentence for each person left out: who, and why. Frames are those of the take, counted from 0."""
    return [_sentence(person) for person in dropped]


def _sentence(person: DroppedTrack) -> str:
    u, v = person.position
    who = f"Somebody near pixel ({u:.0f}, {v:.0f}), first seen in frame {person.first_frame}, was left out:"
    if person.frame_count < person.needed:
        return f"{who} seen in {person.frame_count} frames, {person.needed} are needed."
    return f"{who} others were seen better."
