# SPDX-License-Identifier: GPL-3.0-or-later
"""A take in, one GLB or FBX out with all people and the camera, without a window.

    blender -b --python blender_addon/batch.py -- --take TAKE.npz --out SCENE.glb
    python blender_addon/batch.py --take TAKE.npz --out SCENE.fbx        (a Python that has bpy and the solver)

The script loads the add-on's modules that lie beside it. They need `core_solver`: a Python environment has it
installed; Blender has it once the Scene-Aware Mocap extension is installed, whose wheel carries it. The script enables
an installed extension that is switched off, for this run only.

Exit codes: 0 written, 1 failed, 2 bad call or bad take; a failure says why in one line on stderr.
"""

import argparse
import contextlib
import importlib
import importlib.util
import io
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

_PACKAGE = "scene_aware_mocap_batch"
_EXTENSION = "scene_aware_mocap"
_WRITTEN, _FAILED, _BAD_CALL = 0, 1, 2


class BatchError(Exception):
    """The run cannot go on; the message is one line for the user."""

    def __init__(self, message: str, code: int) -> None:
        super().__init__(message)
        self.code = code


def main(words: Sequence[str]) -> int:
    """Run with command-line words and give the exit code."""
    arguments = _parser().parse_args(words)
    try:
        _load_solver()
        people, frames = _convert(arguments.take, arguments.out)
    except BatchError as error:
        sys.stderr.write(f"batch.py: {error}\n")
        return error.code
    sys.stdout.write(f"wrote {arguments.out}: {people} people, {frames} frames\n")
    return _WRITTEN


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="batch.py", description="Write a take's people to one GLB or FBX file.")
    parser.add_argument("--take", type=Path, required=True, help="take file (.npz)")
    parser.add_argument("--out", type=_output_path, required=True, help="file to write, .glb or .fbx")
    return parser


def _output_path(word: str) -> Path:
    if Path(word).suffix.lower() not in {".glb", ".fbx"}:
        raise argparse.ArgumentTypeError(f"{word!r} must end in .glb or .fbx")
    return Path(word)


def _convert(take_path: Path, out: Path) -> tuple[int, int]:
    """Import and export; gives the numbers of people and frames.

    Raises:
        BatchError: with the reason and the exit code.
    """
    import bpy

    from core_solver.errors import TakeError, UserError
    from core_solver.take import read_take

    _load_package()
    take_import = importlib.import_module(f"{_PACKAGE}.scene_import.take_import")
    exporting = importlib.import_module(f"{_PACKAGE}.export.exporting")
    try:
        take = read_take(take_path)
        bpy.ops.wm.read_homefile(use_empty=True)
        options = take_import.ImportOptions(cloud=False)
        imported = take_import.import_take(bpy.context, take, take_path, options)
        objects = [*imported.armatures, *imported.bodies, imported.camera]
        # The exporters talk about their progress.
        with contextlib.redirect_stdout(io.StringIO()):
            exporting.export_objects(bpy.context, objects, out)
    except TakeError as error:
        raise BatchError(str(error), _BAD_CALL) from error
    except UserError as error:
        raise BatchError(str(error), _FAILED) from error
    return len(take.people), take.frame_count


def _load_solver() -> None:
    """Make sure that bpy and core_solver can be imported, by the installed extension where needed.

    Raises:
        BatchError: one of them is missing.
    """
    if importlib.util.find_spec("bpy") is None:
        raise BatchError("this Python has no bpy: pip install bpy, or run the script with blender -b", _FAILED)
    if importlib.util.find_spec("core_solver") is None:
        _enable_extension()
    if importlib.util.find_spec("core_solver") is None:
        raise BatchError("core_solver is missing: install the Scene-Aware Mocap extension in this Blender", _FAILED)


def _enable_extension() -> None:
    import addon_utils

    names = [module.__name__ for module in addon_utils.modules()]
    for name in names:
        if name.rpartition(".")[2] == _EXTENSION:
            addon_utils.enable(name)
            importlib.invalidate_caches()


def _load_package() -> ModuleType:
    """Load the add-on from this script's folder as a package of its own; nothing is registered in Blender."""
    folder = Path(__file__).resolve().parent
    spec = importlib.util.spec_from_file_location(
        _PACKAGE, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    if spec is None or spec.loader is None:
        raise BatchError(f"the add-on's files are missing in {folder}", _FAILED)
    package = importlib.util.module_from_spec(spec)
    sys.modules[_PACKAGE] = package
    spec.loader.exec_module(package)
    return package


def _own_words(words: Sequence[str]) -> Sequence[str]:
    """What follows `--`: Blender keeps the words before it for itself; plain Python may leave it out."""
    return words[words.index("--") + 1 :] if "--" in words else words[1:]


def _run() -> int:
    try:
        return main(_own_words(sys.argv))
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else _BAD_CALL
    except Exception:  # noqa: BLE001 - whatever happened, Blender must not go on
        traceback.print_exc()
        return _FAILED


if __name__ == "__main__":
    exit_code = _run()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender as a module may crash or hang while Python takes it apart; Blender itself would go on without a window.
    os._exit(exit_code)
