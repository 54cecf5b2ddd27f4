# SPDX-License-Identifier: GPL-3.0-or-later
"""Fewer keys within a stated error: keys stay only where smooth curves between them would leave the motion.

Between two keys a curve is a cubic with the motion's own slope at both ends. In Blender's terms that is a Bezier curve
whose handles reach a third of the way to the neighbouring keys, so it is known exactly what Blender will show.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..retarget.rotation_modes import QUATERNION, channels_from_matrices, matrices_from_channels
from ..retarget.skeleton import Motion, Skeleton, channels_of, pose

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# What a bound loses to Blender's single precision.
_SAFE = 0.98
# A bone's own error may be this part of the bound at first: errors of a chain of bones add up, some against each other.
_OWN = 1.0
_TIGHTER = 0.6


@dataclass(frozen=True)
class Bound:
    """How far the motion with fewer keys may be off, at every whole frame.

    Attributes:
        distance: of every bone's head and tail, metres.
        angle: of every bone's direction and roll in the world, radians.
    """

    distance: float = 0.001
    angle: float = float(np.radians(0.1))


@dataclass(frozen=True)
class FewKeys:
    """A motion's channels and the frames that are to be keyed.

    Attributes:
        modes: rotation mode of each bone.
        keyed: (T, B) which frames of a bone have keys.
        rotations: (T, B, 4) channels in the bone's rotation mode; Euler angles leave the last one 0.
        rotation_slopes: (T, B, 4) their change per frame.
        locations: (T, B, 3) as in `Channels`.
        location_slopes: (T, B, 3) their change per frame.
    """

    modes: tuple[str, ...]
    keyed: Flags
    rotations: Array
    rotation_slopes: Array
    locations: Array
    location_slopes: Array

    def motion(self, skeleton: Skeleton, times: Array) -> Motion:
        """What Blender shows at the frames."""
        return pose(skeleton, times, *_shown(self))


def reduce_keys(skeleton: Skeleton, motion: Motion, modes: tuple[str, ...], bound: Bound) -> FewKeys:
    """Choose the keys that keep a motion within a bound.

    Args:
        skeleton: at rest.
        motion: with a key on each frame.
        modes: rotation mode of each bone.
        bound: not to be exceeded.
    """
    channels = channels_of(skeleton, motion)
    turns = matrices_from_channels(channels.quaternions, QUATERNION)
    rotations = _in_modes(turns, modes)
    keyed = np.zeros(turns.shape[:2], bool)
    keyed[[0, -1]] = True
    slopes = [_slopes(values) for values in (rotations, channels.locations)]
    few = FewKeys(modes, keyed, rotations, slopes[0], channels.locations, slopes[1])
    may_turn, may_shift = _own_bounds(skeleton, bound, len(turns))
    above = _ancestors(skeleton)
    # Each round adds keys or asks for more of some bones; with a key on each frame the motion is exact.
    while True:
        shown = _shown(few)
        own = np.maximum(
            _angles(shown[0], turns) / may_turn,
            skeleton.to_world.scale * np.linalg.norm(shown[1] - channels.locations, axis=-1) / may_shift,
        )
        if _key_worst(keyed, own):
            continue
        wrong = _exceeding(skeleton, motion, pose(skeleton, motion.times, *shown), bound)
        if not wrong.any():
            return few
        # Whoever is above a bone that is off may be the cause.
        causes = wrong @ above
        may_turn[causes] *= _TIGHTER
        may_shift[causes] *= _TIGHTER


def _slopes(values: Array) -> Array:
    """(T, ...) change per frame of the smoothest curve through all values: the natural cubic spline.

    Neighbouring slopes m fulfil m[i-1] + 4 m[i] + m[i+1] = 3 (y[i+1] - y[i-1]), solved from both ends to the middle.
    """
    if len(values) < 2:
        return np.zeros_like(values)
    right = 3 * np.concatenate([values[1:2] - values[:1], values[2:] - values[:-2], values[-1:] - values[-2:-1]])
    diagonal = np.full(len(values), 4.0)
    diagonal[[0, -1]] = 2.0
    for frame in range(1, len(values)):
        diagonal[frame] -= 1 / diagonal[frame - 1]
        right[frame] -= right[frame - 1] / diagonal[frame - 1]
    for frame in range(len(values) - 1, -1, -1):
        after = right[frame + 1] if frame + 1 < len(values) else 0.0
        right[frame] = (right[frame] - after) / diagonal[frame]
    return right


def _in_modes(turns: Array, modes: tuple[str, ...]) -> Array:
    """(T, B, 4) channels."""
    values = np.zeros((*turns.shape[:2], 4))
    for mode, bones in _bones_of_modes(modes):
        channels = channels_from_matrices(turns[:, bones], mode)
        values[:, bones, : channels.shape[-1]] = channels
    return values


def _bones_of_modes(modes: tuple[str, ...]) -> list[tuple[str, list[int]]]:
    return [(mode, [bone for bone, own in enumerate(modes) if own == mode]) for mode in sorted(set(modes))]


def channel_count(mode: str) -> int:
    """How many numbers a rotation mode has."""
    return 4 if mode in ("QUATERNION", "AXIS_ANGLE") else 3


def _shown(few: FewKeys) -> tuple[Array, Array]:
    """(T, B, 3, 3) turns and (T, B, 3) locations of the curves through the keys."""
    before, after = _neighbours(few.keyed)
    rotations = _cubic(few.rotations, few.rotation_slopes, before, after)
    turns = np.empty((*rotations.shape[:2], 3, 3))
    for mode, bones in _bones_of_modes(few.modes):
        turns[:, bones] = matrices_from_channels(rotations[:, bones, : channel_count(mode)], mode)
    return turns, _cubic(few.locations, few.location_slopes, before, after)


def _neighbours(keyed: Flags) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """(T, B) the last key at or before each frame, and the first key after it; at the end the last one."""
    count = len(keyed)
    frames = np.arange(count)[:, None]
    before = np.maximum.accumulate(np.where(keyed, frames, 0), axis=0)
    coming = np.minimum.accumulate(np.where(keyed, frames, count - 1)[::-1], axis=0)[::-1]
    return before, np.concatenate([coming[1:], coming[-1:]])


def _cubic(values: Array, slopes: Array, before: NDArray[np.int64], after: NDArray[np.int64]) -> Array:
    """(T, B, C) cubics between keys, with given slopes at both ends."""
    bones = np.arange(values.shape[1])
    width = np.maximum(after - before, 1)[..., None].astype(float)
    s = (np.arange(len(values))[:, None] - before)[..., None] / width
    start, end = values[before, bones], values[after, bones]
    leave, arrive = width * slopes[before, bones], width * slopes[after, bones]
    t = 1.0 - s
    return t * t * ((1 + 2 * s) * start + s * leave) + s * s * ((1 + 2 * t) * end - t * arrive)


def _own_bounds(skeleton: Skeleton, bound: Bound, count: int) -> tuple[Array, Array]:
    """(T, B) radians and metres by which each bone's own channels may be off."""
    reach = np.maximum(_reach(skeleton), 1e-9)
    turn = _OWN * np.minimum(bound.angle, bound.distance / reach)
    shift = np.full(len(reach), _OWN * bound.distance)
    return np.tile(turn, (count, 1)), np.tile(shift, (count, 1))


def _reach(skeleton: Skeleton) -> Array:
    """(B,) metres from each bone's head to the farthest point that hangs on it, at rest."""
    reach = np.zeros(len(skeleton.names))
    for bone in range(len(skeleton.names)):
        below = skeleton.below(bone)
        ends = np.concatenate([skeleton.heads[below], skeleton.tails[below]])
        reach[bone] = np.linalg.norm(ends - skeleton.heads[bone], axis=1).max()
    return reach


def _ancestors(skeleton: Skeleton) -> Flags:
    """(B, B) in each row the bones above one, itself included."""
    return np.stack([skeleton.below(bone) for bone in range(len(skeleton.names))], axis=1)


def _angles(first: Array, second: Array) -> Array:
    """(T, B) radians between rotations."""
    # |A - B| = 2 sqrt(2) sin(angle / 2) in the Frobenius norm.
    apart = np.linalg.norm(first - second, axis=(-2, -1)) / (2 * np.sqrt(2))
    return 2 * np.arcsin(np.minimum(apart, 1.0))


def _key_worst(keyed: Flags, error: Array) -> bool:
    """Key the worst frame between every two keys where an error exceeds 1; tells whether there was one."""
    flat_keys, flat_error = keyed.T.ravel(), error.T.ravel()
    starts = np.flatnonzero(flat_keys)
    worst = np.maximum.reduceat(flat_error, starts)
    there = np.repeat(worst, np.diff(np.append(starts, len(flat_keys))))
    new = (flat_error == there) & (flat_error > 1.0) & ~flat_keys
    keyed |= new.reshape(keyed.T.shape).T
    return bool(new.any())


def _exceeding(skeleton: Skeleton, motion: Motion, shown: Motion, bound: Bound) -> Flags:
    """(T, B) bones that are off by more than the bound."""
    heads = np.linalg.norm(shown.heads - motion.heads, axis=-1)
    along = skeleton.lengths[:, None]
    tails = shown.heads - motion.heads + along * (shown.rotations[..., 1] - motion.rotations[..., 1])
    off = np.maximum(heads, np.linalg.norm(tails, axis=-1)) > _SAFE * bound.distance
    return off | (_angles(shown.rotations, motion.rotations) > _SAFE * bound.angle)
