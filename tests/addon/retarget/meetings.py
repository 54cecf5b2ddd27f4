"""Two people of the default build who shake hands, and rigs of other sizes that copy their turns: without refinement
the hands of such rigs do not meet."""

from typing import Any

import numpy as np

from core_solver.geometry import align_vectors, matrix_from_rotvec

from .skeletons import Build, Rig, make_rig

FPS = 30.0
FRAMES = 90
REACHING = slice(36, 55)
"""Frames in which the hands are together."""
_ARM = 0.27 + 0.25 + 0.32 * 0.25


def handshake(addon: Any, sizes: tuple[float, float], between: float = 0.0) -> list[Any]:
    """Actors for both people.

    Args:
        addon: gives the product's modules.
        sizes: of the two rigs against the people.
        between: metres of free space between the palms at the handshake.
    """
    return [_actor(addon, index, size, between) for index, size in enumerate(sizes)]


def copied(addon: Any, actor: Any) -> Any:
    """The rig with the person's turns, hips as much higher or lower as it is tall: one character by itself."""
    target, source = actor.target, actor.source
    ratio = target.heads[target.index("hips"), 2] / source.heads[source.index("hips"), 2]
    rotations = np.stack([actor.motion.rotations[:, source.index(name)] for name in target.names], axis=1)
    shifts = np.zeros((FRAMES, len(target.names), 3))
    hips = actor.motion.heads[:, source.index("hips")] * [1.0, 1.0, ratio]
    shifts[:, target.index("hips")] = hips - target.heads[target.index("hips")]
    return addon("retarget.skeleton").place(target, actor.motion.times, rotations, shifts)


def _actor(addon: Any, index: int, size: float, between: float) -> Any:
    person, rig = make_rig(addon, Build()), make_rig(addon, Build(size=size))
    motion = _shake(addon, person, index, between)
    actor = addon("retarget.actor").Actor
    return actor(
        f"person {index}", person.skeleton, person.bone_map, motion, np.ones((FRAMES, 2)), rig.skeleton, rig.bone_map
    )


def _shake(addon: Any, person: Rig, index: int, between: float) -> Any:
    """Arms hang, the right one is raised to the middle between the two and lowered again; all else stands still."""
    skeleton = person.skeleton
    heading = np.pi / 2 if index == 0 else -np.pi / 2
    turn = matrix_from_rotvec([0.0, 0.0, heading])
    shoulder = skeleton.heads[skeleton.index("right_upper_arm")] * [1, 1, 0] @ turn.T
    # The straight arm ends in the palm; the middle of the world is where both palms come to.
    reach = np.sqrt(_ARM**2 - 0.17**2)
    ahead = turn @ [0.0, -1.0, 0.0]
    hips = -(reach + between / 2) * ahead - (shoulder @ ahead) * ahead + [0.0, 0.0, 0.95]
    turns = np.tile(turn, (FRAMES, len(skeleton.names), 1, 1))
    raised = np.clip((np.minimum(np.arange(FRAMES), 90 - np.arange(FRAMES)) - 15) / 20.0, 0, 1)
    raised = raised * raised * (3 - 2 * raised)
    down = np.array([0.0, 0.0, -1.0])
    at_middle = reach * ahead - (shoulder - (shoulder @ ahead) * ahead)
    for side, amount in (("left", 0 * raised), ("right", raised)):
        arm = skeleton.heads[skeleton.index(f"{side}_hand")] - skeleton.heads[skeleton.index(f"{side}_upper_arm")]
        way = amount[:, None] * at_middle / _ARM + (1 - amount)[:, None] * down
        aimed = align_vectors(np.broadcast_to(turn @ arm, way.shape), way) @ turn
        for limb in ("upper_arm", "forearm", "hand"):
            turns[:, skeleton.index(f"{side}_{limb}")] = aimed
    shifts = np.zeros((FRAMES, len(skeleton.names), 3))
    shifts[:, skeleton.index("hips")] = hips - skeleton.heads[skeleton.index("hips")]
    return addon("retarget.skeleton").place(skeleton, np.arange(FRAMES) / FPS, turns @ skeleton.axes, shifts)
