# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is who: two that are one person, one that is two, and two that were taken for each other."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..retarget.bone_map import BoneMap
from ..retarget.skeleton import Motion, Skeleton, place
from .feet import legs_of, shifted, sole_points
from .gaps import fill
from .performance import Evidence, Performance

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

_SEAM = 0.1  # seconds on both sides of a cut in which one motion goes over to the other


def swapped(first: Performance, second: Performance, cut: int) -> tuple[Performance, Performance]:
    """Give each of two people the other's motion from a frame on.

    Args:
        first, second: at the same times, with bones of the same names.
        cut: first frame that is the other's.

    Raises:
        UserError: the two have different bones, somebody is never there, or nothing lies before or after the cut.
    """
    _check_there(first, second)
    _check_cut(cut, len(first.motion.times))
    return _joined(first, second, cut), _joined(second, first, cut)


def merged(earlier: Performance, later: Performance, cut: int | None = None) -> Performance:
    """Make one person of two: the body of the first, which goes on with the motion of the second.

    What nobody saw between the two is filled.

    Args:
        earlier: who is there first.
        later: who the same person is afterwards, at the same times, with bones of the same names.
        cut: first frame that is the second's; by default where the second is first seen, or in the middle of the
            frames in which both are seen.

    Raises:
        UserError: the two have different bones, somebody is never there, or the first is seen after the second is
            gone.
    """
    _check_there(earlier, later)
    if cut is None:
        cut = _meeting(earlier, later)
    _check_cut(cut, len(earlier.motion.times))
    return _joined(earlier, later, cut)


def split(performance: Performance, cut: int) -> tuple[Performance, Performance]:
    """Make two people of one: the first is gone from a frame on, the second comes in it.

    Args:
        performance: somebody who is two.
        cut: first frame of the second one.

    Raises:
        UserError: nothing lies before or after the cut.
    """
    count = len(performance.motion.times)
    _check_cut(cut, count)
    before = np.arange(count) < cut
    return _only(performance, before), _only(performance, ~before)


def onto(performance: Performance, skeleton: Skeleton, bone_map: BoneMap) -> Motion:
    """A person's motion on another body: the same directions, hips over the same place, soles as high.

    Args:
        performance: whose motion.
        skeleton: the other body, in the same pose at rest, with bones of the same names.
        bone_map: its roles.

    Raises:
        UserError: the bones differ.
    """
    own, motion = performance.skeleton, performance.motion
    if set(own.names) != set(skeleton.names):
        raise UserError(f"'{performance.name}' has other bones than the other person: choose two people of takes")
    order = [own.index(name) for name in skeleton.names]
    turns = motion.rotations[:, order] @ np.swapaxes(own.axes[order], -1, -2)
    still = np.zeros((len(turns), len(order), 3))
    moved = place(skeleton, motion.times, turns @ skeleton.axes, still)
    way = _hips(performance.skeleton, performance.bone_map, motion) - _hips(skeleton, bone_map, moved)
    way[:, 2] = _lowest(own, performance.bone_map, motion) - _lowest(skeleton, bone_map, moved)
    return shifted(moved, way)


def _joined(first: Performance, second: Performance, cut: int) -> Performance:
    """The first person, who from a frame on moves like the second."""
    other = onto(second, first.skeleton, first.bone_map)
    count = len(other.times)
    late = np.arange(count) >= cut
    motion = Motion(
        first.motion.times,
        np.where(late[:, None, None, None], other.rotations, first.motion.rotations),
        np.where(late[:, None, None], other.heads, first.motion.heads),
    )
    joined = replace(first, motion=motion, evidence=_chosen(first.evidence, second.evidence, late))
    return replace(joined, motion=fill(joined, [_seam(joined, cut)]))


def _chosen(first: Evidence, second: Evidence, late: Flags) -> Evidence:
    present = np.where(late, second.present, first.present)
    there = np.flatnonzero(present)
    # Between the last frame of the one and the first of the other the person is there, though nobody saw it. A swap
    # that puts a split right leaves one of the two nowhere.
    if len(there):
        present[there[0] : there[-1] + 1] = True
    return Evidence(
        contacts=np.where(late[:, None], second.contacts, first.contacts),
        seen=np.where(late, second.seen & second.present, first.seen & first.present),
        present=present,
        confidence=np.where(late, second.confidence, first.confidence),
    )


def _seam(joined: Performance, cut: int) -> tuple[int, int]:
    """The frames around a cut that are to be filled: those not seen, and a little on both sides."""
    seen = joined.evidence.seen
    width = max(round(_SEAM * joined.rate), 1)
    last = np.flatnonzero(seen[:cut])
    first = np.flatnonzero(seen[cut:])
    start = min(int(last[-1]) + 1 if len(last) else cut, cut - width)
    end = max(cut + int(first[0]) if len(first) else cut, cut + width)
    return max(start, 1), min(end, len(seen) - 1)


def _meeting(earlier: Performance, later: Performance) -> int:
    ends = int(np.flatnonzero(earlier.evidence.seen)[-1]) if earlier.evidence.seen.any() else 0
    begins = int(np.flatnonzero(later.evidence.seen)[0]) if later.evidence.seen.any() else 0
    if ends < begins:
        return begins
    if not later.evidence.seen[ends:].any():
        raise UserError(
            f"'{later.name}' is not seen after '{earlier.name}': choose who is there first as the active person"
        )
    return (ends + begins) // 2 + 1


def _check_there(*people: Performance) -> None:
    gone = [person.name for person in people if not person.evidence.present.any()]
    if gone:
        raise UserError(f"'{gone[0]}' is never there, as after being merged: choose two people who are")


def _check_cut(cut: int, count: int) -> None:
    if not 0 < cut < count:
        raise UserError("nothing lies before or after that frame: choose one inside the take")


def _only(performance: Performance, kept: Flags) -> Performance:
    """A person who is there in some frames only, and stands still before and after them."""
    frames = np.clip(np.arange(len(kept)), *np.flatnonzero(kept)[[0, -1]])
    motion, evidence = performance.motion, performance.evidence
    return replace(
        performance,
        motion=Motion(motion.times, motion.rotations[frames], motion.heads[frames]),
        evidence=Evidence(
            evidence.contacts * kept[:, None],
            evidence.seen & kept,
            evidence.present & kept,
            evidence.confidence * kept,
        ),
    )


def _hips(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Array:
    return motion.heads[:, skeleton.index(bone_map.bone("hips") or "")]


def _lowest(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Array:
    """(T,) height of the lower sole, metres."""
    soles = [sole_points(leg, motion)[..., 2].min(axis=1) for leg in legs_of(skeleton, bone_map)]
    return np.minimum(*soles)
