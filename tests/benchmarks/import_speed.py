"""How long a large take needs to come into Blender: `python -m tests.benchmarks.import_speed`.

Needs a Python with bpy and this project. The table's last row is all of it, from the file to the scene.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from core_solver.take import Take, read_take, write_take
from tests.addon.take_factory import TakeSpec, make_take

Result = TypeVar("Result")


def main() -> None:
    """Make a take, import it and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=5)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--vertices", type=int, default=1229)
    arguments = parser.parse_args()
    spec = TakeSpec(
        people=arguments.people, frames=arguments.frames, points=arguments.points, vertices=arguments.vertices
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "large.npz"
        write_take(path, make_take(spec))
        reading, take = timed(lambda: read_take(path))
        building = timed_import(take, path)
    size = f"{spec.people} people x {spec.frames} frames x {spec.points} points"
    print(f"Blender {blender_version()}: {size}, {spec.vertices} vertices a person")
    print(f"| read and check | {reading:6.2f} s |")
    print(f"| build in Blender | {building:6.2f} s |")
    print(f"| all | {reading + building:6.2f} s |")


def timed_import(take: Take, path: Path) -> float:
    """Seconds to build a take in an empty scene and evaluate the scene once."""
    import bpy

    from blender_addon.scene_import.take_import import ImportOptions, import_take

    bpy.ops.wm.read_homefile(use_empty=True)

    def build() -> None:
        import_take(bpy.context, take, path, ImportOptions())
        bpy.context.view_layer.update()

    return timed(build)[0]


def blender_version() -> str:
    """Of the bpy that runs."""
    import bpy

    return bpy.app.version_string


def timed(work: Callable[[], Result]) -> tuple[float, Result]:
    """Seconds that something takes, and what it gives."""
    start = time.perf_counter()
    result = work()
    return time.perf_counter() - start, result


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender as a module may hang while Python takes it apart.
    os._exit(0)
