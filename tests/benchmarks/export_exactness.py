"""How exact files for each engine are, and how long they take: `python -m tests.benchmarks.export_exactness`.

Needs a Python with bpy and this project. Every file is read back by Blender's importers and compared with the scene;
the table shows the largest error of any joint at the frames looked at.
"""

import argparse
import contextlib
import dataclasses
import io
import os
import sys
import tempfile
from pathlib import Path

from tests.addon.take_factory import TakeSpec, make_take
from tests.benchmarks.import_speed import blender_version, timed


def main() -> None:
    """Export the same people for every engine in both formats, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--people", type=int, default=3)
    parser.add_argument("--frames", type=int, default=1000)
    arguments = parser.parse_args()
    import bpy

    from blender_addon.export.exporting import export_characters
    from blender_addon.export.performance import characters_among
    from blender_addon.export.profiles import load_profile, profile_ids
    from blender_addon.scene_import.take_import import ImportOptions, import_take

    bpy.ops.wm.read_homefile(use_empty=True)
    spec = TakeSpec(people=arguments.people, frames=arguments.frames, points=8, vertices=1229)
    imported = import_take(bpy.context, make_take(spec), Path("people.npz"), ImportOptions())
    characters = characters_among(bpy.context, imported.armatures)
    print(f"Blender {blender_version()}: {spec.people} people x {spec.frames} frames")
    print("| engine | format | files | seconds | largest joint error, mm | verified |")
    print("|---|---|---|---|---|---|")
    for engine in profile_ids():
        for file_format in ("glb", "fbx"):
            profile = dataclasses.replace(load_profile(engine), format=file_format)
            with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
                seconds, done = timed(
                    lambda p=profile, f=folder: export_characters(bpy.context, characters, p, Path(f), "people")
                )
            worst = 1000 * max(check.joint_error_m for check in done.checks)
            verified = "yes" if done.passed else "NO"
            print(f"| {engine} | {file_format} | {len(done.files)} | {seconds:.1f} | {worst:.3f} | {verified} |")


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    # Blender as a module may hang while Python takes it apart.
    os._exit(0)
