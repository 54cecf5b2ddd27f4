# SPDX-License-Identifier: GPL-3.0-or-later
"""A body as capsules: the lines between its joints, with a girth."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bone_map import BoneMap
from .roles import SIDES
from .skeleton import Motion, Skeleton

Array = NDArray[np.float64]

# Radius of each part of a body in heights of the body: an adult's girth, clothes left out.
_LIMBS = {
    "upper_arm": ("forearm", 0.027),
    "forearm": ("hand", 0.022),
    "thigh": ("shin", 0.045),
    "shin": ("foot", 0.03),
}
_TRUNK_RADIUS, _HEAD_RADIUS = 0.07, 0.055
# From the ankle to the joint below the skull, in heights of the body.
_ANKLE_TO_HEAD = 0.84


@dataclass(frozen=True)
class Segment:
    """One capsule.

    Attributes:
        role: part of the body: "trunk", "head", "left_forearm", ...
        start, end: bones at whose heads the line begins and ends; the same one for a line that ends at `tip`.
        radius: metres.
        tip: (3,) from the head of a bone on which nothing follows to the line's end, in the bone's axes, metres.
    """

    role: str
    start: int
    end: int
    radius: float
    tip: Array


def height(skeleton: Skeleton, bone_map: BoneMap) -> float:
    """A body's height, told from its joints at rest: hardly depends on how a rig's last bones are drawn; metres."""
    feet = [skeleton.heads[skeleton.index(bone_map.needed(f"{side}_foot")), 2] for side in SIDES]
    top = skeleton.heads[skeleton.index(bone_map.needed("head")), 2]
    return float(top - np.mean(feet)) / _ANKLE_TO_HEAD


def segments(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Segment, ...]:
    """The capsules of a body."""
    tall = height(skeleton, bone_map)
    found = [
        _segment(skeleton, bone_map, "trunk", "hips", "head", _TRUNK_RADIUS * tall),
        _segment(skeleton, bone_map, "head", "head", None, _HEAD_RADIUS * tall),
    ]
    for side in SIDES:
        for limb, (next_limb, radius) in _LIMBS.items():
            role = f"{side}_{limb}"
            found.append(_segment(skeleton, bone_map, role, role, f"{side}_{next_limb}", radius * tall))
    return tuple(found)


def _segment(skeleton: Skeleton, bone_map: BoneMap, role: str, start: str, end: str | None, radius: float) -> Segment:
    first = skeleton.index(bone_map.needed(start))
    following = bone_map.bone(end) if end else None
    last = skeleton.index(following) if following else first
    # Nothing follows on the head: skulls are round, their bones are drawn as anybody likes.
    way = 2 * radius * np.array([0.0, 0.0, 1.0]) if role == "head" else skeleton.end(first) - skeleton.heads[first]
    return Segment(role, first, last, radius, skeleton.axes[first].T @ way)


def ends(motion: Motion, segment: Segment) -> tuple[Array, Array]:
    """(T, 3), (T, 3) where a capsule's line begins and ends in each frame."""
    start = motion.heads[:, segment.start]
    if segment.end != segment.start:
        return start, motion.heads[:, segment.end]
    return start, start + motion.rotations[:, segment.start] @ segment.tip


def closest_on_line(start: Array, end: Array, points: Array) -> Array:
    """(T,) where on the lines (T, 3) from start to end the points (T, 3) are nearest: 0 at the start, 1 at the end."""
    along = end - start
    squared = np.maximum(np.sum(along * along, axis=-1), 1e-12)
    return np.clip(np.sum((points - start) * along, axis=-1) / squared, 0.0, 1.0)


def closest_between(start: Array, end: Array, other_start: Array, other_end: Array) -> tuple[Array, Array]:
    """(T,), (T,) where two pieces of lines are nearest, on each from 0 at its start to 1 at its end.

    Where the unbounded lines meet best is bounded to the first piece; then each piece in turn takes what is nearest
    to the other's point. Two turns are exact: the distance is convex in both parameters, and only ends bound them.
    """
    u, v, w = end - start, other_end - other_start, start - other_start
    uu, uv, vv = (np.sum(a * b, axis=-1) for a, b in ((u, u), (u, v), (v, v)))
    uw, vw = np.sum(u * w, axis=-1), np.sum(v * w, axis=-1)
    denominator = uu * vv - uv * uv
    parallel = denominator < 1e-9 * np.maximum(uu * vv, 1e-12)
    s = np.where(parallel, 0.5, np.clip((uv * vw - vv * uw) / np.where(parallel, 1.0, denominator), 0.0, 1.0))
    t = closest_on_line(other_start, other_end, start + s[:, None] * u)
    s = closest_on_line(start, end, other_start + t[:, None] * v)
    return s, closest_on_line(other_start, other_end, start + s[:, None] * u)


def box_gap(first: Array, second: Array) -> Array:
    """(T,) metres along an axis between the boxes around two sets of points (T, N, 3); not positive where they meet.

    Quick to find, it spares the closer look at what is far apart.
    """
    lower = np.maximum(first.min(axis=1) - second.max(axis=1), second.min(axis=1) - first.max(axis=1))
    return lower.max(axis=-1)
