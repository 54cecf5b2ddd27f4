"""How long retargeting needs, apart from reading and keying: `python -m tests.benchmarks.addon_speed`.

Needs a Python with bpy and this project. Walkers of different sizes go onto rigs of different builds, all in one scene;
then people who shake hands again and again, in every frame of whose scene the refinement has something to do.
"""

import argparse
import importlib
import time
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np

from tests.addon.retarget.meetings import FPS, FRAMES, handshake
from tests.addon.retarget.skeletons import RIGS, make_person, make_rig, walk

_SIZES = (1.0, 0.8, 1.15, 0.9, 1.1)
_KINDS = ("mixamo", "tall", "unreal", "short", "a pose")


def main() -> None:
    """Retarget a scene without and with its refinement, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=3)
    parser.add_argument("--frames", type=int, default=1000)
    arguments = parser.parse_args()
    walkers = [_walker(number, arguments.frames) for number in range(arguments.people)]
    shaking = [_shaking(number, arguments.frames) for number in range(arguments.people)]
    print(f"{arguments.people} people x {arguments.frames} frames")
    for scene, actors in (("walking", walkers), ("shaking hands", shaking)):
        for label, refine in (("retarget", False), ("retarget and refine", True)):
            seconds, outcome = _timed(actors, refine=refine)
            rigs = outcome.rigs
            miss = "nobody touches" if np.isnan(rigs.touch_mm) else f"hands miss by {rigs.touch_mm:.0f} mm"
            print(
                f"| {scene:13} | {label:19} | {seconds:6.2f} s | feet slide {rigs.skate_mm:3.1f} mm per frame | "
                f"stand {100 * rigs.contact_recall:3.0f} % | distances off by {rigs.spacing_mm:2.0f} mm | "
                f"{miss} |"
            )


def addon(name: str) -> ModuleType:
    """A module of the add-on."""
    return importlib.import_module(f"blender_addon.{name}")


def _walker(number: int, frames: int) -> Any:
    person = make_person(addon, _SIZES[number % len(_SIZES)])
    rig = make_rig(addon, RIGS[_KINDS[number % len(_KINDS)]])
    motion, contacts = walk(addon, person, frames, heading=0.1, start=(1.5 * number, 0.0, 0.0))
    return addon("retarget.actor").Actor(
        f"walker {number + 1}", person.skeleton, person.bone_map, motion, contacts, rig.skeleton, rig.bone_map
    )


def _shaking(number: int, frames: int) -> Any:
    """Pairs who face each other, on rigs 0.7 and 1.4 times as tall in turns; a last one shakes nobody's hand."""
    actor = handshake(addon, (0.7, 1.4))[number % 2]
    there_and_back = np.concatenate([np.arange(FRAMES), np.arange(FRAMES)[::-1]])
    motion = actor.motion.at(np.resize(there_and_back, frames))
    heads = motion.heads + np.array([0.0, 1.5 * (number // 2), 0.0])
    moved = addon("retarget.skeleton").Motion(np.arange(frames) / FPS, motion.rotations, heads)
    return replace(actor, name=f"person {number + 1}", motion=moved, contacts=np.ones((frames, 2)))


def _timed(actors: list[Any], *, refine: bool) -> tuple[float, Any]:
    options = addon("retarget.options").Options(refine=refine)
    ground = addon("retarget.ground").Ground.flat()
    start = time.perf_counter()
    outcome = addon("retarget.scene").retarget_scene(actors, options, ground)
    return time.perf_counter() - start, outcome


if __name__ == "__main__":
    main()
