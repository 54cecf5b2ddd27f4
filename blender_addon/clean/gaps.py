# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in which a person was not seen: hold the last pose, or go smoothly from the last one to the next."""

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix

from ..retarget.rotation_modes import QUATERNION, matrices_from_channels
from ..retarget.skeleton import Motion, channels_of, pose
from .performance import Evidence, Performance
from .signals import ramp, spans

Array = NDArray[np.float64]
Filling = Literal["HOLD", "INBETWEEN"]

_COASTING = 0.2  # seconds in which a motion that is lost from sight comes to rest
_RESUMING = 0.25  # seconds before a person is seen again in which a held pose goes over to the next
_TREND = 0.1  # seconds at the edge of a gap from which its speed is told


def hidden_spans(evidence: Evidence, confidence: float = 0.0) -> list[tuple[int, int]]:
    """Frames between two in which the person was seen: (first, one after last).

    Args:
        evidence: of one person.
        confidence: frames below count as hidden too.
    """
    hidden = ~evidence.seen | (evidence.confidence < confidence)
    return [(start, end) for start, end in spans(hidden & evidence.present) if start > 0 and end < len(hidden)]


def fill(performance: Performance, gaps: list[tuple[int, int]], filling: Filling = "INBETWEEN") -> Motion:
    """Replace the motion of some spans of frames.

    Args:
        performance: a person's.
        gaps: spans with a good frame on both sides.
        filling: "INBETWEEN" coasts out of the last pose, into the next one, and goes over between the two; "HOLD"
            stays in the last pose until shortly before the next.
    """
    skeleton, motion = performance.skeleton, performance.motion
    channels = channels_of(skeleton, motion)
    turns = matrices_from_channels(channels.quaternions, QUATERNION)
    locations = channels.locations.copy()
    for start, end in gaps:
        since = np.arange(1, end - start + 1) / performance.rate
        until = since[::-1]
        if filling == "HOLD":
            first, last = _still(turns, locations, start - 1), _still(turns, locations, end)
            share = ramp(1.0 - until / min(_RESUMING, since[-1] + since[0]))
        else:
            trend = max(round(_TREND * performance.rate), 1)
            first = _coasted(turns, locations, start - 1, max(start - 1 - trend, 0), _slowing(since) * performance.rate)
            last = _coasted(turns, locations, end, min(end + trend, len(turns) - 1), _slowing(until) * performance.rate)
            share = ramp(since / (since[-1] + since[0]))
        turns[start:end] = _mixed(first[0], last[0], share[:, None, None])
        locations[start:end] = first[1] + share[:, None, None] * (last[1] - first[1])
    return pose(skeleton, motion.times, turns, locations)


def _slowing(seconds: Array) -> Array:
    """Time that passes ever more slowly, and stops: what moves in it comes to rest."""
    return _COASTING * -np.expm1(-seconds / _COASTING)


def _still(turns: Array, locations: Array, frame: int) -> tuple[Array, Array]:
    return turns[frame, None], locations[frame, None]


def _coasted(turns: Array, locations: Array, edge: int, other: int, frames: Array) -> tuple[Array, Array]:
    """Go on from frame `edge` with the speed that led there from frame `other`, coming to rest.

    Args:
        turns: (T, B, 3, 3).
        locations: (T, B, 3).
        edge: where to start, on either side of a gap.
        other: a frame further away from the gap.
        frames: (N,) how far away from the edge, into the gap.

    Returns:
        (N, B, 3, 3) and (N, B, 3).
    """
    if edge == other:
        return _still(turns, locations, edge)
    way = frames[:, None, None] / abs(edge - other)
    turn = rotvec_from_matrix(np.swapaxes(turns[other], -1, -2) @ turns[edge])
    return turns[edge] @ matrix_from_rotvec(way * turn), locations[edge] + way * (locations[edge] - locations[other])


def _mixed(first: Array, last: Array, share: Array) -> Array:
    """(N, B, 3, 3) rotations on the shortest way from the first to the last."""
    between = rotvec_from_matrix(np.swapaxes(first, -1, -2) @ last)
    return first @ matrix_from_rotvec(share * between)
