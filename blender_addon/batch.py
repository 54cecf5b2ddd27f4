# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes in, files for a game engine out, without a window.

    blender -b --python blender_addon/batch.py -- --take A.npz B.npz --rig HERO.glb --clean smooth,footlock \\
        --export DIR --engine unreal --report R.json
    blender -b --python blender_addon/batch.py -- --take TAKE.npz --out SCENE.glb
    python blender_addon/batch.py --take TAKE.npz --out SCENE.fbx        (a Python that has bpy and the solver)
    blender -c scene_aware_mocap --take TAKE.npz --export DIR            (the installed extension, without this script)

`--help` tells all options. The script loads the add-on's modules that lie beside it. They need `core_solver`: a Python
environment has it installed; Blender has it once the Scene-Aware Mocap extension is installed, whose wheel carries it.
The script enables an installed extension that is switched off, for this run only.

Exit codes: 0 all done, 1 some takes failed and the others are done, 2 bad call; a failure says why in one line on
stderr.
"""

import importlib
import importlib.util
import os
import sys
import traceback
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

_PACKAGE = "scene_aware_mocap_batch"
_EXTENSION = "scene_aware_mocap"
_FAILED = 1


class BatchError(Exception):
    """The run cannot go on; the message is one line for the user."""


def main(words: Sequence[str]) -> int:
    """Run with command-line words and give the exit code."""
    try:
        _load_solver()
        _load_package()
    except BatchError as error:
        sys.stderr.write(f"batch.py: {error}\n")
        return _FAILED
    return importlib.import_module(f"{_PACKAGE}.batching.command").main(words)


def _load_solver() -> None:
    """Make sure that bpy and core_solver can be imported, by the installed extension where needed.

    Raises:
        BatchError: one of them is missing.
    """
    if importlib.util.find_spec("bpy") is None:
        raise BatchError("this Python has no bpy: pip install bpy, or run the script with blender -b")
    if importlib.util.find_spec("core_solver") is None:
        _enable_extension()
    if importlib.util.find_spec("core_solver") is None:
        raise BatchError("core_solver is missing: install the Scene-Aware Mocap extension in this Blender")


def _enable_extension() -> None:
    # Where Blender is a module of Python, it brings addon_utils along.
    importlib.import_module("bpy")
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
        raise BatchError(f"the add-on's files are missing in {folder}")
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
    except Exception:  # noqa: BLE001 - whatever happened, Blender must not go on
        traceback.print_exc()
        return _FAILED


if __name__ == "__main__":
    exit_code = _run()
    sys.stdout.flush()
    sys.stderr.flush()
    # Blender as a module may crash or hang while Python takes it apart; Blender itself would go on without a window.
    os._exit(exit_code)
