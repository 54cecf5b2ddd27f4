# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigs whose limbs do not hang together: feet that are bones of their own, legs that do not hang on the hips.

Reckoning wants a body of one piece: all hangs on the hips, a hand on its forearm, a foot on its shin. Where the bones
are keyed, in their own rig, they then leave their parents.
"""

from collections.abc import Sequence
from dataclasses import replace

from .bone_map import BoneMap
from .roles import SIDES, SPINE
from .skeleton import Motion, Skeleton

_HANGS_ON = {
    "upper_arm": "clavicle", "forearm": "upper_arm", "hand": "forearm",
    "shin": "thigh", "foot": "shin", "toe": "foot",
}  # fmt: skip


def joined(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Skeleton, BoneMap]:
    """A skeleton of one piece with the same bones in the same places, and its map.

    What carries hips and legs becomes the hips; a hips bone that carries the trunk alone becomes part of the spine.

    Args:
        skeleton: any.
        bone_map: with all needed roles.
    """
    bone_map = _with_carrying_hips(skeleton, bone_map)
    parents = list(skeleton.parents)
    for side in SIDES:
        for limb in ("thigh", *_HANGS_ON):
            name = bone_map.bone(f"{side}_{limb}")
            if name is not None:
                bone, above = skeleton.index(name), skeleton.index(_above(bone_map, side, limb))
                if not skeleton.below(above)[bone]:
                    parents[bone] = above
    return (skeleton if parents == list(skeleton.parents) else rehung(skeleton, parents)), bone_map


def _above(bone_map: BoneMap, side: str, limb: str) -> str:
    """The bone that a limb hangs on in a body of one piece."""
    hips = bone_map.needed("hips")
    if limb == "thigh":
        return hips
    return bone_map.bone(f"{side}_{_HANGS_ON[limb]}") or (hips, *bone_map.spine)[-1]


def reordered(motion: Motion, skeleton: Skeleton, other: Skeleton) -> Motion:
    """The motion of one skeleton's bones in the order of another one, which has the same bones or some of them."""
    order = [skeleton.index(name) for name in other.names]
    return Motion(motion.times, motion.rotations[:, order], motion.heads[:, order])


def _with_carrying_hips(skeleton: Skeleton, bone_map: BoneMap) -> BoneMap:
    hips = skeleton.index(bone_map.needed("hips"))
    thighs = [skeleton.index(bone_map.needed(f"{side}_thigh")) for side in SIDES]
    carrier = hips
    while carrier >= 0 and not skeleton.below(carrier)[thighs].all():
        carrier = skeleton.parents[carrier]
    if carrier in (hips, -1) or bone_map.role_of(skeleton.names[carrier]) is not None:
        return bone_map
    trunk = (("hips", skeleton.names[carrier]), (SPINE, skeleton.names[hips]))
    return replace(bone_map, bones=(*trunk, *(pair for pair in bone_map.bones if pair[0] != "hips")))


def only(skeleton: Skeleton, names: Sequence[str]) -> Skeleton:
    """Some bones of a skeleton, each hanging on the nearest of them above it."""
    kept = [bone for bone, name in enumerate(skeleton.names) if name in names]
    place = {bone: number for number, bone in enumerate(kept)} | {-1: -1}
    parents = []
    for bone in kept:
        parent = skeleton.parents[bone]
        while parent not in place:
            parent = skeleton.parents[parent]
        parents.append(place[parent])
    return _picked(skeleton, kept, parents)


def rehung(skeleton: Skeleton, parents: Sequence[int]) -> Skeleton:
    """The skeleton with other parents, sorted such that they come first again.

    Raises:
        ValueError: bones hang on each other.
    """
    order: list[int] = []
    while len(order) < len(parents):
        ready = [b for b, parent in enumerate(parents) if b not in order and (parent < 0 or parent in order)]
        if not ready:
            raise ValueError("bones of the map hang on each other")
        order += ready
    place = {bone: number for number, bone in enumerate(order)} | {-1: -1}
    return _picked(skeleton, order, [place[parents[bone]] for bone in order])


def _picked(skeleton: Skeleton, bones: Sequence[int], parents: Sequence[int]) -> Skeleton:
    chosen = list(bones)
    return Skeleton(
        names=tuple(skeleton.names[bone] for bone in chosen),
        parents=tuple(parents),
        heads=skeleton.heads[chosen],
        axes=skeleton.axes[chosen],
        lengths=skeleton.lengths[chosen],
        to_world=skeleton.to_world,
        turns_with_parent=skeleton.turns_with_parent[chosen],
    )
