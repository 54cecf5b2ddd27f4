# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of a body that touch things: soles and palms, each carried by one bone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bone_map import BoneMap
from .rest import UP, body_frame
from .roles import SIDES
from .skeleton import Motion, Skeleton

Array = NDArray[np.float64]

# A palm's distance from the wrist, in lengths of the forearm: the same place on every body, however long the rig's
# hand bones are drawn.
_PALM = 0.32
# A rig stands on its object's origin when its lowest ankle or toe joint is not further above it than this part of the
# hips' height; otherwise on its lowest point.
_STANDS_ON_ORIGIN = 0.16


@dataclass(frozen=True)
class Landmark:
    """A point that moves with a bone.

    Attributes:
        bone: index in the skeleton.
        offset: (3,) from the bone's head in the bone's own axes, metres.
    """

    bone: int
    offset: Array

    def positions(self, motion: Motion) -> Array:
        """(T, 3) where the point is, world, metres."""
        return motion.heads[:, self.bone] + motion.rotations[:, self.bone] @ self.offset


@dataclass(frozen=True)
class Sole:
    """The places of one foot that carry weight.

    Attributes:
        heel: on the sole, below the ankle.
        ball: on the sole, below the toes' first joint or the end of the foot's bone.
        ankle_height: of the ankle joint above the sole at rest, metres.
    """

    heel: Landmark
    ball: Landmark
    ankle_height: float


def landmark(skeleton: Skeleton, bone: int, point: Array) -> Landmark:
    """The point of a bone that is at `point` (3,) of the world at rest."""
    return Landmark(bone, skeleton.axes[bone].T @ (point - skeleton.heads[bone]))


def floor_at_rest(skeleton: Skeleton, bone_map: BoneMap) -> float:
    """How high the floor is on which a skeleton stands at rest, metres, along the body's own upright direction."""
    up = body_frame(skeleton, bone_map)[:, UP]
    feet = _bones(skeleton, bone_map, "foot") + _bones(skeleton, bone_map, "toe")
    lowest = min(float(min(skeleton.heads[i] @ up, skeleton.tails[i] @ up)) for i in feet)
    origin = float(skeleton.to_world.translation @ up)
    tall = float(skeleton.heads[skeleton.index(bone_map.needed("hips"))] @ up) - lowest
    return origin if -0.02 * tall <= lowest - origin <= _STANDS_ON_ORIGIN * tall else lowest


def soles(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Sole, Sole]:
    """The left and the right sole.

    Args:
        skeleton: at rest, standing.
        bone_map: with both feet; toes are used where there are some.
    """
    up = body_frame(skeleton, bone_map)[:, UP]
    floor = floor_at_rest(skeleton, bone_map) * up
    left, right = (_sole(skeleton, bone_map, side, floor, up) for side in SIDES)
    return left, right


def palms(skeleton: Skeleton, bone_map: BoneMap) -> tuple[Landmark, Landmark]:
    """The left and the right palm, straight on from the forearm; on the forearm's own bone where there is no hand."""
    left, right = (_palm(skeleton, bone_map, side) for side in SIDES)
    return left, right


def _sole(skeleton: Skeleton, bone_map: BoneMap, side: str, floor: Array, up: Array) -> Sole:
    foot = skeleton.index(bone_map.needed(f"{side}_foot"))
    toe = bone_map.bone(f"{side}_toe")
    # The ball moves with the foot, not with the toes that bend in it.
    ball = skeleton.heads[skeleton.index(toe)] if toe else skeleton.end(foot)
    ankle = skeleton.heads[foot]
    above_ankle, above_ball = (float((point - floor) @ up) for point in (ankle, ball))
    return Sole(
        landmark(skeleton, foot, ankle - above_ankle * up),
        landmark(skeleton, foot, ball - above_ball * up),
        above_ankle,
    )


def _palm(skeleton: Skeleton, bone_map: BoneMap, side: str) -> Landmark:
    forearm = skeleton.index(bone_map.needed(f"{side}_forearm"))
    hand = bone_map.bone(f"{side}_hand")
    bone = skeleton.index(hand) if hand else forearm
    wrist = skeleton.heads[bone] if hand else skeleton.end(forearm)
    return landmark(skeleton, bone, wrist + _PALM * (wrist - skeleton.heads[forearm]))


def _bones(skeleton: Skeleton, bone_map: BoneMap, limb: str) -> list[int]:
    names = [bone_map.bone(f"{side}_{limb}") for side in SIDES]
    return [skeleton.index(name) for name in names if name]
