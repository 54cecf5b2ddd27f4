# SPDX-License-Identifier: GPL-3.0-or-later
"""Which bone carries a character through the world: nothing that is seen changes, save in place."""

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec, quaternion_from_matrix

from .bone_map import BoneMap
from .landmarks import floor_at_rest
from .options import RootPolicy
from .roles import ROOT
from .skeleton import Motion, Skeleton, carried_axes

Array = NDArray[np.float64]

_UP = np.array([0.0, 0.0, 1.0])


def root_of(skeleton: Skeleton, bone_map: BoneMap) -> int | None:
    """The bone on the ground that carries the hips; None for rigs whose hips hang on nothing."""
    above = _ancestors(skeleton, skeleton.index(bone_map.needed("hips")))
    named = bone_map.bone(ROOT)
    if named is not None and skeleton.index(named) in above:
        return skeleton.index(named)
    return above[-1] if above else None


def with_policy(skeleton: Skeleton, bone_map: BoneMap, motion: Motion, policy: RootPolicy, level: Array) -> Motion:
    """A motion whose hips carry everything, as the policy wants it.

    Args:
        skeleton: of the rig.
        bone_map: its roles.
        motion: hips and all below them in their places, bones above at rest.
        policy: see `Options.root`.
        level: (T,) height of the floor that the character stands on or jumps from, metres.
    """
    if policy == "in_place":
        return _in_place(skeleton, bone_map, motion)
    root = root_of(skeleton, bone_map)
    return motion if policy == "hips" or root is None else _carried_by_root(skeleton, bone_map, motion, root, level)


def _in_place(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Motion:
    """Hips stay above where they are at rest; all the rest moves as before."""
    hips = skeleton.index(bone_map.needed("hips"))
    heads = motion.heads.copy()
    way = skeleton.heads[hips, :2] - motion.heads[:, hips, :2]
    heads[:, skeleton.below(hips), :2] += way[:, None]
    return Motion(motion.times, motion.rotations, heads)


def _carried_by_root(skeleton: Skeleton, bone_map: BoneMap, motion: Motion, root: int, level: Array) -> Motion:
    """The root stays below the hips as it is at rest, turns with their heading and follows the floor."""
    hips = skeleton.index(bone_map.needed("hips"))
    rotations, heads = motion.rotations.copy(), motion.heads.copy()
    turn = _headings(motion.rotations[:, hips] @ skeleton.axes[hips].T)
    rotations[:, root] = turn @ skeleton.axes[root]
    heads[:, root] = motion.heads[:, hips] + turn @ (skeleton.heads[root] - skeleton.heads[hips])
    heads[:, root, 2] = level + skeleton.heads[root, 2] - floor_at_rest(skeleton, bone_map)
    for bone in np.flatnonzero(skeleton.below(root) & ~skeleton.below(hips)):
        parent = skeleton.parents[bone]
        if bone != root:
            rotations[:, bone] = carried_axes(skeleton, rotations, bone)
            offset = skeleton.axes[parent].T @ (skeleton.heads[bone] - skeleton.heads[parent])
            heads[:, bone] = heads[:, parent] + rotations[:, parent] @ offset
    return Motion(motion.times, rotations, heads)


def _headings(turns: Array) -> Array:
    """(T, 3, 3) the parts of turns about the vertical; lying down keeps a heading, only upside down has none."""
    quaternions = quaternion_from_matrix(turns)
    angle = 2 * np.arctan2(quaternions[:, 3], quaternions[:, 0])
    return matrix_from_rotvec(angle[:, None] * _UP)


def _ancestors(skeleton: Skeleton, bone: int) -> list[int]:
    """From the parent upwards."""
    above = []
    while skeleton.parents[bone] >= 0:
        bone = skeleton.parents[bone]
        above.append(bone)
    return above
