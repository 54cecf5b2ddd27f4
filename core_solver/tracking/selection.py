"""Who is solved: people with enough evidence over time, named in a stable order."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from core_solver.tracking.tracklets import Tracklet
from core_solver.tracking.tracks import UNCLAIMED, DroppedTrack

MIN_FRAMES = 8
MIN_SHARE = 0.10

_MIN_SCORE = 0.15
_MIN_CONFIDENCE = 0.15
_STATIC_MOTION = (
    0.03  # sizes: a poster or a coat on a stand moves less over the clip, the noise of its reading included
)
_STATIC_SCORE = 0.35
_REPORTED_FRAMES = 3  # shorter sights are flicker of the detector, not somebody left out


@dataclass(frozen=True)
class Selection:
    """The people to solve, in the order of their ids, and those left out."""

    people: tuple[Tracklet, ...]
    dropped: tuple[DroppedTrack, ...]


def required_frames(frame_count: int) -> int:
    """Sights a person needs to be solved: 10 % of the clip and 8 frames, or all frames of a clip shorter than that."""
    return max(math.ceil(MIN_SHARE * frame_count), min(MIN_FRAMES, frame_count))


def select_people(tracklets: Sequence[Tracklet], frame_count: int, people: int | None) -> Selection:
    """Choose the people to solve.

    Args:
        tracklets: one a candidate.
        frame_count: T.
        people: at most this many, the best seen ones; None for everybody.
    """
    candidates = [t for t in tracklets if _is_person(t)]
    long_enough = [t for t in candidates if len(t.sights) >= required_frames(frame_count)]
    limit = min(UNCLAIMED - 1, people if people is not None else UNCLAIMED - 1)
    best = sorted(long_enough, key=_prominence, reverse=True)[:limit]
    left_out = [t for t in candidates if t not in best and len(t.sights) >= min(_REPORTED_FRAMES, frame_count)]
    return Selection(tuple(sorted(best, key=_appearance_order)), tuple(map(_dropped, left_out)))


def mean_score(tracklet: Tracklet) -> float:
    """Mean detection score over the sights."""
    return float(np.mean([s.detection.score for s in tracklet.sights]))


def _is_person(tracklet: Tracklet) -> bool:
    score = mean_score(tracklet)
    confidence = float(np.mean([s.detection.confidence for s in tracklet.sights]))
    if score < _MIN_SCORE or confidence < _MIN_CONFIDENCE:
        return False
    return score >= _STATIC_SCORE or len(tracklet.sights) < MIN_FRAMES or _motion(tracklet) > _STATIC_MOTION


def _motion(tracklet: Tracklet) -> float:
    """Robust spread of the place over the sights, in sizes."""
    centres = np.stack([s.centre for s in tracklet.sights])
    spread = np.percentile(centres, 90, axis=0) - np.percentile(centres, 10, axis=0)
    return float(np.linalg.norm(spread)) / tracklet.last.size


def _prominence(tracklet: Tracklet) -> float:
    """Length times score times size: whom a viewer would call the main person."""
    size = float(np.mean([s.size for s in tracklet.sights]))
    return len(tracklet.sights) * mean_score(tracklet) * size


def _appearance_order(tracklet: Tracklet) -> tuple[float, ...]:
    """First who is seen first, then from left to right."""
    first = tracklet.sights[0]
    return (first.row, *map(float, first.centre))


def _dropped(tracklet: Tracklet) -> DroppedTrack:
    boxes = np.stack([s.detection.box for s in tracklet.sights]).astype(float)
    u, v = (boxes[:, :2] + boxes[:, 2:]).mean(axis=0) / 2
    return DroppedTrack(tracklet.sights[0].row, len(tracklet.sights), (float(u), float(v)))


def describe_left_out(dropped: Sequence[DroppedTrack], frame_count: int) -> list[str]:
    """A sentence for each person left out: who, and why. Frames are those of the take, counted from 0."""
    needed = required_frames(frame_count)
    return [_sentence(person, needed) for person in dropped]


def _sentence(person: DroppedTrack, needed: int) -> str:
    u, v = person.position
    who = f"Somebody near pixel ({u:.0f}, {v:.0f}), first seen in frame {person.first_frame}, was left out:"
    if person.frame_count < needed:
        return f"{who} seen in {person.frame_count} frames, {needed} are needed."
    return f"{who} others were seen better."
