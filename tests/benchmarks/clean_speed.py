"""How long cleaning a large take needs in Blender: `python -m tests.benchmarks.clean_speed`.

Needs a Python with bpy and this project. Every operation reads everybody from the scene and writes new actions.
"""

import argparse
import os
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from core_solver.take import Person, Take, write_take
from tests.addon.take_factory import TakeSpec, make_take

from .import_speed import timed, timed_import

_STEP = 30  # frames of a step; each foot stands for a little more than half of it
_STANDS = 16


def main() -> None:
    """Make a take, import it, clean it with every operation and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--points", type=int, default=1_000_000)
    arguments = parser.parse_args()
    take = make_take(TakeSpec(people=arguments.people, frames=arguments.frames, points=arguments.points, swing=0.15))
    take = replace(take, people=tuple(stepping(person) for person in take.people))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.npz"
        write_take(path, take)
        timed_import(take, path)
    print(f"{arguments.people} people x {arguments.frames} frames x {arguments.points} points")
    for label, seconds in timed_operations(take):
        print(f"| {label:16} | {seconds:6.2f} s |")


def stepping(person: Person) -> Person:
    """Somebody whose feet stand in turns and who does not turn round."""
    theta = person.theta.copy()
    theta[:, 0] = theta[0, 0]
    phase = np.arange(len(theta)) % _STEP
    contacts = 0.9 * np.stack([phase < _STANDS, phase >= _STEP - _STANDS], axis=1).astype(np.float32)
    gamma = person.gamma[0] + np.float32(0.3) * (person.gamma - person.gamma[0])
    return replace(person, theta=theta, contacts=contacts.astype(np.float32), gamma=gamma)


def timed_operations(take: Take) -> list[tuple[str, float]]:
    """Seconds of each operation on all people of an imported take."""
    import bpy

    from blender_addon.clean.key_reduction import Bound
    from blender_addon.rig import cleaning

    people = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    assert len(people) == len(take.people)
    steps = {
        "fill gaps": cleaning.gap_filling("INBETWEEN", 0.0),
        "remove drift": cleaning.drift_removal("CLOUD"),
        "smooth": cleaning.smoothing(6.0),
        "snap to ground": cleaning.ground_snap("CLOUD", 0.1),
        "lock feet": cleaning.foot_lock(0.1),
        "bake": cleaning.baking(),
    }
    rows = []
    for label, step in steps.items():
        work = cleaning.clean(bpy.context, people, [step], "ACTION")
        rows.append((label, timed(lambda work=work: cleaning.finish(work))[0]))
    few = cleaning.reduce(bpy.context, people, Bound(), "ACTION")
    return [*rows, ("reduce keys", timed(lambda: cleaning.finish(few))[0])]


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender as a module may hang while Python takes it apart.
    os._exit(0)
