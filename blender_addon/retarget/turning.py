# SPDX-License-Identifier: GPL-3.0-or-later
"""How the parts of a body turn, free of the rig they were seen on: read from a person, shown by a rig.

A part's turn is its frame in the world (see `rest`): the identity turned as the part turned out of the shared pose.
Limbs keep their directions so, whatever pose either rig rests in.
"""

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix

from .bone_map import BoneMap
from .rest import rest_frames
from .roles import SPINE
from .skeleton import Motion, Skeleton, carried_axes

Array = NDArray[np.float64]

# Spine bones are at least so far apart, in parts of the spine: some rigs begin the spine where the hips begin.
_APART = 1e-3


def turns_of(skeleton: Skeleton, bone_map: BoneMap, motion: Motion) -> Array:
    """(T, B, 3, 3) the frames of all parts of a body that moves, world."""
    return motion.rotations @ (np.swapaxes(skeleton.axes, -1, -2) @ rest_frames(skeleton, bone_map))


def shown_turns(source: Skeleton, source_map: BoneMap, turns: Array, target: Skeleton, target_map: BoneMap) -> Array:
    """(T, B, 3, 3) the axes in the world of a rig's bones that turn as a person does.

    Bones without a role keep their rest pose on their parent, or turn on it as the person's bone of the same name does:
    fingers of rigs of one kind. Those above the hips stay at rest.

    Args:
        source: the person.
        source_map: its roles.
        turns: (T, B, 3, 3) of the person, by `turns_of`.
        target: the rig.
        target_map: its roles.
    """
    frames = rest_frames(target, target_map)
    to_axes = np.swapaxes(frames, -1, -2) @ target.axes
    wanted = _wanted_turns(source, source_map, turns, target, target_map)
    rotations = np.empty((len(turns), len(target.names), 3, 3))
    for bone, parent in enumerate(target.parents):
        namesake = _namesake(source, source_map, target, target_map, bone)
        if bone in wanted:
            rotations[:, bone] = wanted[bone] @ to_axes[bone]
        elif namesake is not None:
            on_parent = np.swapaxes(turns[:, source.parents[namesake]], -1, -2) @ turns[:, namesake]
            parents_turn = rotations[:, parent] @ (target.axes[parent].T @ frames[parent])
            rotations[:, bone] = parents_turn @ on_parent @ to_axes[bone]
        else:
            rotations[:, bone] = carried_axes(target, rotations, bone)
    return rotations


def _namesake(source: Skeleton, source_map: BoneMap, target: Skeleton, target_map: BoneMap, bone: int) -> int | None:
    """The person's bone that is called as one of the rig's, where neither has a role and they hang on the same."""
    name, parent = target.names[bone], target.parents[bone]
    if parent < 0 or name not in source.names or target_map.role_of(name) or source_map.role_of(name):
        return None
    found = source.index(name)
    above = source.parents[found]
    return found if above >= 0 and source.names[above] == target.names[parent] else None


def _wanted_turns(
    source: Skeleton, source_map: BoneMap, turns: Array, target: Skeleton, target_map: BoneMap
) -> dict[int, Array]:
    """Target bones by index, and how the part turns that they play."""
    wanted = dict(
        zip(
            _trunk(target, target_map),
            _resampled(
                turns[:, _trunk(source, source_map)],
                _spine_places(source, source_map),
                _spine_places(target, target_map),
            ),
            strict=True,
        )
    )
    for role, name in target_map.bones:
        playing = source_map.bone(role)
        if role not in ("root", "hips", SPINE) and playing is not None:
            wanted[target.index(name)] = turns[:, source.index(playing)]
    neck, head = target_map.bone("neck"), source_map.bone("head")
    if neck is not None and head is not None and source_map.bone("neck") is None:
        chest = turns[:, _trunk(source, source_map)[-1]]
        wanted[target.index(neck)] = _between(chest, turns[:, source.index(head)], 0.5)
    return wanted


def _trunk(skeleton: Skeleton, bone_map: BoneMap) -> list[int]:
    """Hips and spine, upwards."""
    hips = bone_map.bone("hips")
    return [skeleton.index(name) for name in (hips, *bone_map.spine) if name is not None]


def _spine_places(skeleton: Skeleton, bone_map: BoneMap) -> Array:
    """(S,) where hips and spine bones begin along the way from the first to the last: 0 to 1."""
    heads = skeleton.heads[_trunk(skeleton, bone_map)]
    steps = np.linalg.norm(np.diff(heads, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps + _APART * max(float(steps.sum()), 1e-6))])
    return way / max(float(way[-1]), 1e-12)


def _resampled(turns: Array, places: Array, wanted: Array) -> list[Array]:
    """Turns at other places along a spine: of the hips at 0, of the chest at 1.

    Args:
        turns: (T, S, 3, 3).
        places: (S,) ascending.
        wanted: (N,) places.

    Returns:
        N times (T, 3, 3).
    """
    found = []
    for place in wanted:
        above = int(np.clip(np.searchsorted(places, place - 1e-9), 0, len(places) - 1))
        below = max(above - 1, 0)
        gap = places[above] - places[below]
        share = (place - places[below]) / gap if gap > 0 else 1.0
        found.append(_between(turns[:, below], turns[:, above], share))
    return found


def _between(first: Array, second: Array, share: float) -> Array:
    """(T, 3, 3) on the shortest way from one turn to another; exactly either end at 0 and 1."""
    if share >= 1.0 - 1e-9:
        return second
    if share <= 1e-9:
        return first
    return first @ matrix_from_rotvec(share * rotvec_from_matrix(np.swapaxes(first, -1, -2) @ second))
