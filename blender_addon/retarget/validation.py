# SPDX-License-Identifier: GPL-3.0-or-later
"""What is wrong with a bone map, in plain words, and how to mend it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bone_map import BoneMap
from .roles import NEEDED, ROLES, SIDES, SPINE, mirrored
from .skeleton import Skeleton
from .structure import NotHumanoidError, find_by_structure

Array = NDArray[np.float64]

# Pairs of roles of which the second hangs on the first.
_LIMB_STEPS = (("clavicle", "upper_arm"), ("upper_arm", "forearm"), ("forearm", "hand"),
               ("thigh", "shin"), ("shin", "foot"), ("foot", "toe"))  # fmt: skip
_STEPS = (
    ("hips", "head"),
    ("neck", "head"),
    *((f"{side}_{above}", f"{side}_{below}") for side in SIDES for above, below in _LIMB_STEPS),
)
_PAIRS = ("upper_arm", "forearm", "thigh", "shin")


@dataclass(frozen=True)
class Mend:
    """A change to a map that would solve a problem.

    Attributes:
        label: what it does, short enough for a button.
        bones: the map's pairs afterwards.
    """

    label: str
    bones: tuple[tuple[str, str], ...]


@dataclass(frozen=True)
class Problem:
    """Something wrong with a map.

    Attributes:
        message: one line: what, and what to do.
        blocks: whether retargeting cannot work so.
        roles: which are concerned.
        mend: if one is known.
    """

    message: str
    blocks: bool
    roles: tuple[str, ...]
    mend: Mend | None = None


def find_problems(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Problem, ...]:
    """All that is wrong with a map, the worst first."""
    try:
        shape = find_by_structure(skeleton)
    except NotHumanoidError:
        shape = None
    problems = [
        *_unknown(skeleton, bone_map),
        *_missing(skeleton, bone_map, shape),
        *_twice(bone_map, shape),
        *_upside_down(skeleton, bone_map),
        *_spine_order(skeleton, bone_map),
        *(_swapped(skeleton, bone_map, shape) if shape else ()),
        *_not_carried(skeleton, bone_map),
    ]
    return tuple(sorted(problems, key=lambda problem: not problem.blocks))


def is_sound(skeleton: Skeleton, bone_map: BoneMap) -> bool:
    """Whether a complete map makes a body."""
    return not any(problem.blocks for problem in find_problems(skeleton, bone_map))


def in_words(role: str) -> str:
    """A role as people say it: "left upper arm"."""
    return role.replace("_", " ")


def with_bone(bone_map: BoneMap, role: str, bone: str) -> tuple[tuple[str, str], ...]:
    """A map's pairs with another bone for a role; the spine gets it as its last."""
    kept = [pair for pair in bone_map.bones if pair[1] != bone and (pair[0] != role or role == SPINE)]
    return _sorted([*kept, (role, bone)])


def _sorted(pairs: Sequence[tuple[str, str]]) -> tuple[tuple[str, str], ...]:
    return tuple(sorted(pairs, key=lambda pair: ROLES.index(pair[0])))


# --- one check each -------------------------------------------------------------------------------------------------


def _unknown(skeleton: Skeleton, bone_map: BoneMap) -> Iterator[Problem]:
    for role, bone in bone_map.bones:
        if bone not in skeleton.names:
            kept = tuple(pair for pair in bone_map.bones if pair != (role, bone))
            yield Problem(
                f"This rig has no bone '{bone}' (for the {in_words(role)}): choose another one",
                True,
                (role,),
                Mend(f"Forget '{bone}'", kept),
            )


def _missing(skeleton: Skeleton, bone_map: BoneMap, shape: BoneMap | None) -> Iterator[Problem]:
    missing = [role for role in NEEDED if bone_map.bone(role) is None]
    if not missing:
        return
    suggested = _suggestions(skeleton, bone_map, shape)
    for role in missing:
        bone = suggested.get(role)
        where = _between(bone_map, role)
        message = f"No bone for the {in_words(role)}: choose {where}"
        if bone is None:
            yield Problem(message, True, (role,))
        else:
            mend = Mend(f"Use '{bone}'", with_bone(bone_map, role, bone))
            yield Problem(f"{message}; '{bone}' looks right", True, (role,), mend)


def _between(bone_map: BoneMap, role: str) -> str:
    """Where to look for a role's bone."""
    above = next((a for a, b in _STEPS if b == role and bone_map.bone(a)), None)
    below = next((b for a, b in _STEPS if a == role and bone_map.bone(b)), None)
    if above and below:
        return f"the bone between {in_words(above)} and {in_words(below)}"
    if above:
        return f"a bone below the {in_words(above)}"
    if below:
        return f"a bone above the {in_words(below)}"
    return "it in the list"


def _suggestions(skeleton: Skeleton, bone_map: BoneMap, shape: BoneMap | None) -> dict[str, str]:
    """Free bones for roles: by the rig's shape, else those in between."""
    taken = {bone for _, bone in bone_map.bones}
    found = {r: b for r, b in (shape.bones if shape else ()) if r != SPINE and b not in taken}
    for role in set(NEEDED) - set(found):
        between = _only_between(skeleton, bone_map, role)
        if between and between not in taken:
            found[role] = between
    return found


def _only_between(skeleton: Skeleton, bone_map: BoneMap, role: str) -> str | None:
    """The middle bone on the way between the neighbours that a role's bone must connect."""
    above = next((bone_map.bone(a) for a, b in _STEPS if b == role), None)
    below = next((bone_map.bone(b) for a, b in _STEPS if a == role), None)
    if above is None or below is None or above not in skeleton.names or below not in skeleton.names:
        return None
    line = _line(skeleton, below)[1:]
    if above not in line:
        return None
    way = line[: line.index(above)]
    return way[len(way) // 2] if way else None


def _twice(bone_map: BoneMap, shape: BoneMap | None) -> Iterator[Problem]:
    roles: dict[str, list[str]] = {}
    for role, bone in bone_map.bones:
        roles.setdefault(bone, []).append(role)
    for bone, played in roles.items():
        if len(played) > 1:
            by_shape = shape.role_of(bone) if shape else None
            right = by_shape if by_shape in played else played[0]
            kept = tuple(pair for pair in bone_map.bones if pair[1] != bone or pair[0] == right)
            yield Problem(
                f"'{bone}' is chosen for {' and '.join(f'the {in_words(r)}' for r in played)}: a bone can be only one",
                True,
                tuple(played),
                Mend(f"Keep it as the {in_words(right)}", kept),
            )


def _upside_down(skeleton: Skeleton, bone_map: BoneMap) -> Iterator[Problem]:
    """A hand above its forearm; not every rig's forearm carries the hand, so that being apart is no fault."""
    for upper, lower in _STEPS:
        above, below = bone_map.bone(upper), bone_map.bone(lower)
        if above in skeleton.names and below in _line(skeleton, above)[1:]:
            swapped = [pair for pair in bone_map.bones if pair[0] not in (upper, lower)]
            swapped += [(upper, below), (lower, above)]
            yield Problem(
                f"'{below}' is chosen for the {in_words(lower)}, but the {in_words(upper)} '{above}' hangs on it: "
                f"exchange the two or choose another bone",
                True,
                (upper, lower),
                Mend("Exchange the two", _sorted(swapped)),
            )


def _spine_order(skeleton: Skeleton, bone_map: BoneMap) -> Iterator[Problem]:
    spine = [bone for bone in bone_map.spine if bone in skeleton.names]
    depths = [len(_line(skeleton, bone)) for bone in spine]
    if depths != sorted(depths):
        ordered = [bone for _, bone in sorted(zip(depths, spine, strict=True))]
        others = [pair for pair in bone_map.bones if pair[0] != SPINE]
        yield Problem(
            "The spine's bones are not in order from the hips upwards: sort them",
            True,
            (SPINE,),
            Mend("Sort the spine", _sorted([*others, *((SPINE, bone) for bone in ordered)])),
        )


def _swapped(skeleton: Skeleton, bone_map: BoneMap, shape: BoneMap) -> Iterator[Problem]:
    """Limbs on the other side than the rig's front says, or both on one."""
    left_ward = _towards_left(skeleton, shape)
    middle = _place(skeleton, shape, "hips")
    wrong = []
    for limb in _PAIRS:
        for side, sign in zip(SIDES, (1.0, -1.0), strict=True):
            role = f"{side}_{limb}"
            if bone_map.bone(role) in skeleton.names:
                offset = sign * float((_place(skeleton, bone_map, role) - middle) @ left_ward)
                if offset < -0.02 * _height(skeleton):
                    wrong.append(role)
    if not wrong:
        return
    mend = Mend("Exchange left and right", _sorted([(mirrored(r), b) for r, b in bone_map.bones]))
    trust = min(shape.confidence, *(shape.doubts.get(role, 1.0) for role in wrong))
    if len(wrong) == sum(bone_map.bone(f"{s}_{limb}") is not None for s in SIDES for limb in _PAIRS):
        yield Problem(
            "Left and right seem exchanged: the rig's feet point the other way. Exchange them, or turn the rig",
            trust > 0.75,
            tuple(wrong),
            mend,
        )
    else:
        parts = ", ".join(in_words(role) for role in wrong)
        yield Problem(
            f"On the other side of the body than its name says: {parts}. Choose other bones", True, tuple(wrong)
        )


def _towards_left(skeleton: Skeleton, shape: BoneMap) -> Array:
    left, right = (sum(_place(skeleton, shape, f"{side}_{limb}") for limb in _PAIRS) for side in SIDES)
    across = np.asarray(left - right, float)
    return across / np.linalg.norm(across)


def _not_carried(skeleton: Skeleton, bone_map: BoneMap) -> Iterator[Problem]:
    """Hips beside the legs instead of above them: the body would leave its legs behind."""
    hips = bone_map.bone("hips")
    if hips not in skeleton.names:
        return
    line = _line(skeleton, hips)
    for side in SIDES:
        thigh = bone_map.bone(f"{side}_thigh")
        if thigh in skeleton.names and hips not in _line(skeleton, thigh):
            shared = [bone for bone in line[1:] if bone in _line(skeleton, thigh)]
            if shared:
                yield Problem(
                    f"The hips '{hips}' do not carry the {side} thigh '{thigh}': choose '{shared[0]}' as the hips",
                    True,
                    ("hips", f"{side}_thigh"),
                    Mend(f"Use '{shared[0]}' as the hips", with_bone(bone_map, "hips", shared[0])),
                )
                return


def _line(skeleton: Skeleton, bone: str) -> list[str]:
    """A bone and all above it."""
    line, index = [], skeleton.index(bone)
    while index >= 0:
        line.append(skeleton.names[index])
        index = skeleton.parents[index]
    return line


def _place(skeleton: Skeleton, bone_map: BoneMap, role: str) -> Array:
    return skeleton.heads[skeleton.index(bone_map.bone(role) or "")]


def _height(skeleton: Skeleton) -> float:
    return float(np.ptp(skeleton.heads, axis=0).max())
