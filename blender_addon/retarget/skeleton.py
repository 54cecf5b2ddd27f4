# SPDX-License-Identifier: GPL-3.0-or-later
"""Skeletons and their motion as arrays, in Blender's terms: heads, axes with y along the bone, pose channels.

Everything is in the world (z up, metres). A bone's axes are the columns of a rotation matrix.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import Similarity, quaternion_from_matrix

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Skeleton:
    """An armature at rest, standing where its object stands.

    Attributes:
        names: of the bones; a parent comes before its children.
        parents: index of each bone's parent, -1 for roots.
        heads: (B, 3) where the bones begin, world, metres.
        axes: (B, 3, 3) columns are the bones' x, y, z axes in the world.
        lengths: (B,) metres.
        to_world: from the armature's own space and units to the world.
        turns_with_parent: (B,) whether a bone inherits its parent's rotation.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    heads: Array
    axes: Array
    lengths: Array
    to_world: Similarity
    turns_with_parent: NDArray[np.bool_]

    @property
    def tails(self) -> Array:
        """(B, 3) where the bones end."""
        return self.heads + self.lengths[:, None] * self.axes[:, :, 1]

    def index(self, name: str) -> int:
        """Place of a bone; raises ValueError for an unknown one."""
        return self.names.index(name)

    def end(self, bone: int) -> Array:
        """(3,) where a limb goes on at rest: the middle of the bones that hang on its end, else its tail.

        Tails in files from elsewhere often say nothing: they may all point up.
        """
        ways = self.heads[[child for child, parent in enumerate(self.parents) if parent == bone]] - self.heads[bone]
        far = np.linalg.norm(ways, axis=1) > 0.5 * np.linalg.norm(ways, axis=1).max(initial=self.lengths[bone])
        return self.heads[bone] + ways[far].mean(axis=0) if far.any() else self.tails[bone]

    def below(self, bone: int) -> NDArray[np.bool_]:
        """(B,) which bones hang on one, itself included."""
        found = np.arange(len(self.names)) == bone
        for child, parent in enumerate(self.parents):
            found[child] |= parent >= 0 and found[parent]
        return found


@dataclass(frozen=True)
class Motion:
    """Where every bone of a skeleton is.

    Attributes:
        times: (T,) seconds.
        rotations: (T, B, 3, 3) columns are the bones' axes in the world.
        heads: (T, B, 3) world, metres.
    """

    times: Array
    rotations: Array
    heads: Array

    def at(self, frames: NDArray[np.int64]) -> "Motion":
        """The motion in some of its frames."""
        return Motion(self.times[frames], self.rotations[frames], self.heads[frames])


@dataclass(frozen=True)
class Channels:
    """A motion as Blender keys it on pose bones.

    Attributes:
        quaternions: (T, B, 4) (w, x, y, z) in the bone's rest axes; neighbours in time never flip sign.
        locations: (T, B, 3) in the bone's rest axes and the armature's own units.
    """

    quaternions: Array
    locations: Array


def place(skeleton: Skeleton, times: Array, rotations: Array, shifts: Array) -> Motion:
    """Put bones that turn as given where their parents carry them.

    Args:
        skeleton: at rest.
        times: (T,) seconds.
        rotations: (T, B, 3, 3) axes in the world.
        shifts: (T, B, 3) metres in the world by which a head leaves the place where its parent carries it (a root:
            its place at rest); zeros for bones that only turn.
    """
    heads = np.empty((*rotations.shape[:2], 3))
    for bone, parent in enumerate(skeleton.parents):
        heads[:, bone] = _carried_head(skeleton, rotations, heads, bone, parent) + shifts[:, bone]
    return Motion(times, rotations, heads)


def channels_of(skeleton: Skeleton, motion: Motion) -> Channels:
    """The pose channels that show a motion."""
    turns = np.empty_like(motion.rotations)
    locations = np.empty_like(motion.heads)
    for bone, parent in enumerate(skeleton.parents):
        axes = carried_axes(skeleton, motion.rotations, bone)
        turns[:, bone] = np.swapaxes(axes, -1, -2) @ motion.rotations[:, bone]
        shift = motion.heads[:, bone] - _carried_head(skeleton, motion.rotations, motion.heads, bone, parent)
        place_axes = carried_axes(skeleton, motion.rotations, bone, always=True)
        locations[:, bone] = np.einsum("tab,ta->tb", place_axes, shift) / skeleton.to_world.scale
    return Channels(without_flips(quaternion_from_matrix(turns)), locations)


def pose(skeleton: Skeleton, times: Array, turns: Array, locations: Array) -> Motion:
    """Where pose channels put the bones: the inverse of `channels_of`.

    Args:
        skeleton: at rest.
        times: (T,) seconds.
        turns: (T, B, 3, 3) rotations in the bones' rest axes.
        locations: (T, B, 3) as in `Channels`.
    """
    rotations = np.empty_like(turns)
    heads = np.empty_like(locations)
    for bone, parent in enumerate(skeleton.parents):
        rotations[:, bone] = carried_axes(skeleton, rotations, bone) @ turns[:, bone]
        shift = skeleton.to_world.scale * np.einsum(
            "tab,tb->ta", carried_axes(skeleton, rotations, bone, always=True), locations[:, bone]
        )
        heads[:, bone] = _carried_head(skeleton, rotations, heads, bone, parent) + shift
    return Motion(times, rotations, heads)


def carried_axes(skeleton: Skeleton, rotations: Array, bone: int, *, always: bool = False) -> Array:
    """(T or 1, 3, 3) a bone's rest axes as its parent carries them: what its channels are measured in.

    Args:
        skeleton: at rest.
        rotations: (T, B, 3, 3) world axes; the parent's must be filled in.
        bone: index.
        always: also for bones that do not turn with their parent, whose locations follow it nevertheless.
    """
    parent = skeleton.parents[bone]
    if parent < 0 or not (always or skeleton.turns_with_parent[bone]):
        return skeleton.axes[None, bone]
    return rotations[:, parent] @ (skeleton.axes[parent].T @ skeleton.axes[bone])


def _carried_head(skeleton: Skeleton, rotations: Array, heads: Array, bone: int, parent: int) -> Array:
    if parent < 0:
        return skeleton.heads[None, bone]
    offset = skeleton.axes[parent].T @ (skeleton.heads[bone] - skeleton.heads[parent])
    return heads[:, parent] + rotations[:, parent] @ offset


def without_flips(quaternions: Array) -> Array:
    """(T, ..., 4) quaternions of the same rotations, each in the half space of the one before.

    q and -q are one rotation, but curves drawn from one to the other pass through others.
    """
    agreement = np.sum(quaternions[1:] * quaternions[:-1], axis=-1, keepdims=True)
    signs = np.cumprod(np.where(agreement < 0, -1.0, 1.0), axis=0)
    return np.concatenate([quaternions[:1], quaternions[1:] * signs])
