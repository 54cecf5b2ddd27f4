"""People who move in known ways, for cleaning: walkers, and what is wrong with them."""

from dataclasses import replace
from typing import Any

import numpy as np

from core_solver.geometry import matrix_from_rotvec
from tests.addon.retarget.skeletons import make_person, walk


def walker(addon: Any, frames: int = 120, step: float = 0.55, heading: float = 0.0) -> Any:
    """Somebody who walks to -y on z = 0 and whose standing feet are perfectly still; 30 frames a second."""
    rig = make_person(addon)
    motion, contacts = walk(addon, rig, frames, step, heading)
    return performance(addon, rig, motion, contacts)


def stander(addon: Any, frames: int = 150) -> Any:
    """Somebody who stands and sways a little above still feet."""
    rig = make_person(addon)
    motion, _ = walk(addon, rig, 1)
    still = type(motion)(
        np.arange(frames) / 30.0, np.repeat(motion.rotations, frames, 0), np.repeat(motion.heads, frames, 0)
    )
    return performance(addon, rig, still, np.ones((frames, 2)))


def performance(addon: Any, rig: Any, motion: Any, contacts: np.ndarray) -> Any:
    module = addon("clean.performance")
    always = np.ones(len(contacts), bool)
    evidence = module.Evidence(contacts, always, always.copy(), np.ones(len(contacts)))
    return module.Performance("Somebody", rig.skeleton, rig.bone_map, motion, evidence)


def moved(performance: Any, way: np.ndarray) -> Any:
    """Carried through the world by (T, 3) metres."""
    motion = performance.motion
    return replace(performance, motion=type(motion)(motion.times, motion.rotations, motion.heads + way[:, None]))


def trembling(addon: Any, performance: Any, angle: float, way: float, seed: int) -> Any:
    """With noise on all rotations (radians) and on the path (metres)."""
    rng = np.random.default_rng(seed)
    skeletons = addon("retarget.skeleton")
    modes = addon("retarget.rotation_modes")
    channels = skeletons.channels_of(performance.skeleton, performance.motion)
    turns = modes.matrices_from_channels(channels.quaternions, "QUATERNION")
    turns = turns @ matrix_from_rotvec(angle * rng.normal(size=(*turns.shape[:2], 3)))
    noisy = skeletons.pose(performance.skeleton, performance.motion.times, turns, channels.locations)
    return moved(replace(performance, motion=noisy), way * rng.normal(size=(len(turns), 3)))


def sole_ends(addon: Any, performance: Any, motion: Any) -> np.ndarray:
    """(2, T, 2, 3) heel and ball of the left and the right foot."""
    soles = addon("retarget.landmarks").soles(performance.skeleton, performance.bone_map)
    return np.array([[end.positions(motion) for end in (sole.heel, sole.ball)] for sole in soles]).swapaxes(1, 2)


def skate(addon: Any, performance: Any, motion: Any) -> np.ndarray:
    """Metres by which standing feet slide in each frame: the end of the sole that moves less counts."""
    steps = np.linalg.norm(np.diff(sole_ends(addon, performance, motion), axis=1), axis=-1).min(axis=-1)
    stands = performance.evidence.contacts.T >= 0.5
    return steps[stands[:, 1:] & stands[:, :-1]]


def bone_lengths(skeleton: Any, motion: Any) -> np.ndarray:
    """(T, B) metres from each bone's head to its parent's; zero for roots."""
    parents = [max(parent, 0) for parent in skeleton.parents]
    lengths = np.linalg.norm(motion.heads - motion.heads[:, parents], axis=-1)
    return np.where([parent < 0 for parent in skeleton.parents], 0.0, lengths)
