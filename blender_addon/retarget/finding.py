# SPDX-License-Identifier: GPL-3.0-or-later
"""Find a rig's bone map: what the file itself says, else well-known names, else the rig's shape."""

from collections.abc import Iterable
from dataclasses import replace

from .bone_map import BoneMap
from .presets import Preset, coverage, matched
from .roles import NEEDED
from .skeleton import Skeleton
from .structure import NotHumanoidError, find_by_structure
from .validation import is_sound

# How sure a map by names is when the rig's shape says the same, or says nothing.
_CONFIRMED, _UNCONFIRMED = 1.0, 0.9
# With fewer of the needed roles known by name, the rest is no humanoid's.
_MOSTLY = 0.6


def find_map(skeleton: Skeleton, presets: Iterable[Preset], own_map: BoneMap | None = None) -> BoneMap:
    """The most credible map of a rig, with its confidence.

    A preset is believed when the rig has all needed bones and they make a body; when none does, the shape decides.
    A map that lacks needed roles is given only if the names leave no doubt that the rig is a humanoid's.

    Args:
        skeleton: of the rig.
        presets: known skeletons.
        own_map: of the rig's own file.

    Raises:
        NotHumanoidError: neither names nor shape are a humanoid's.
    """
    if own_map is not None and coverage(own_map) == 1 and is_sound(skeleton, own_map):
        return own_map
    candidates = _by_names(skeleton, presets)
    complete = next((m for m in candidates if coverage(m) == 1 and is_sound(skeleton, m)), None)
    try:
        by_structure = find_by_structure(skeleton)
    except NotHumanoidError:
        if complete:
            return replace(complete, confidence=_UNCONFIRMED)
        if candidates and coverage(candidates[0]) >= _MOSTLY:
            return replace(candidates[0], confidence=0.5 * coverage(candidates[0]))
        raise
    if complete is None:
        return by_structure
    agreed = _agree(skeleton, complete, by_structure)
    return replace(complete, confidence=_CONFIRMED if agreed else _UNCONFIRMED)


def map_by_preset(skeleton: Skeleton, preset: Preset) -> BoneMap:
    """The map of one preset, chosen by a user: complete or not."""
    bone_map = matched(preset, skeleton)
    return replace(bone_map, confidence=coverage(bone_map))


def _by_names(skeleton: Skeleton, presets: Iterable[Preset]) -> list[BoneMap]:
    """What the presets make of a rig, the best first; one that knows fewer other bones is the better of two."""
    known = [(matched(preset, skeleton), preset) for preset in presets]
    known.sort(
        key=lambda pair: (
            -coverage(pair[0]),
            -pair[1].priority,
            -len(pair[0].bones),
            sum(map(len, pair[1].roles.values())),
        )
    )
    return [bone_map for bone_map, _ in known]


def _agree(skeleton: Skeleton, one: BoneMap, other: BoneMap) -> bool:
    """Whether two maps name joints in the same places."""
    size = float((skeleton.heads.max(axis=0) - skeleton.heads.min(axis=0)).max())
    places = [[skeleton.heads[skeleton.index(m.bone(role) or "")] for m in (one, other)] for role in NEEDED[2:]]
    return all(abs(a - b).max() < 0.01 * size for a, b in places)
