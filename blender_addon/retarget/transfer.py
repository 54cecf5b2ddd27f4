# SPDX-License-Identifier: GPL-3.0-or-later
"""One person's motion on one rig: limbs in the same directions, hips over the same place, feet where they stood.

Over the ground nothing is scaled by the character, so that several of them stay at the distances they had. In height
hips stand over the ground in the proportion of the legs.
"""

import numpy as np
from numpy.typing import NDArray

from .actor import Actor
from .bone_map import BoneMap
from .feet import Stage, level_under, planted
from .ground import Ground
from .landmarks import soles
from .options import Options
from .roles import SIDES
from .skeleton import Motion, Skeleton, place
from .turning import shown_turns, turns_of

Array = NDArray[np.float64]


def transfer(actor: Actor, options: Options, ground: Ground) -> Motion:
    """Where a rig's bones are when it moves as a person does; its hips carry it, its root rests.

    Args:
        actor: the person and the rig; both maps with all needed roles.
        options: scale and feet are of concern here.
        ground: under the person, in the person's own scale.
    """
    stage = Stage(ground, options.scale)
    turns = turns_of(actor.source, actor.source_map, actor.motion)
    rotations = shown_turns(actor.source, actor.source_map, turns, actor.target, actor.target_map)
    motion = _over_the_person(actor, rotations, stage)
    return planted(actor, motion, stage) if options.feet else motion


def leg_length(skeleton: Skeleton, bone_map: BoneMap) -> float:
    """From the hip joint over knee and ankle to the sole, metres; the mean of both legs."""
    lengths = []
    for side, sole in zip(SIDES, soles(skeleton, bone_map), strict=True):
        bones = [skeleton.index(bone_map.needed(f"{side}_{limb}")) for limb in ("thigh", "shin", "foot")]
        ways = np.diff(skeleton.heads[bones], axis=0)
        lengths.append(float(np.linalg.norm(ways, axis=1).sum()) + sole.ankle_height)
    return sum(lengths) / len(lengths)


def _over_the_person(actor: Actor, rotations: Array, stage: Stage) -> Motion:
    """Put turned bones such that the middle between the hip joints is over that of the person."""
    target = actor.target
    motion = place(target, actor.motion.times, rotations, np.zeros(rotations.shape[:3]))
    hips = target.below(target.index(actor.target_map.needed("hips")))
    person = stage.scale * _between_hips(actor.motion.heads, actor.source, actor.source_map)
    legs = leg_length(target, actor.target_map) / leg_length(actor.source, actor.source_map)
    level = level_under(actor, stage)
    wanted = np.column_stack([person[:, :2], level + legs / stage.scale * (person[:, 2] - level)])
    shift = wanted - _between_hips(motion.heads, target, actor.target_map)
    motion.heads[:, hips] += shift[:, None]
    return motion


def _between_hips(heads: Array, skeleton: Skeleton, bone_map: BoneMap) -> Array:
    """(T, 3) the middle between the hip joints, out of (T, B, 3) heads.

    Hips bones lie elsewhere in every rig, hip joints do not.
    """
    joints = [skeleton.index(bone_map.needed(f"{side}_thigh")) for side in SIDES]
    return heads[:, joints].mean(axis=1)
