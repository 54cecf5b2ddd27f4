"""GLB files against Khronos' own validator, where node and its package `gltf-validator` are installed."""

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.addon.take_factory import TakeSpec, make_take

from .test_profiles import export, import_people

VALIDATE = """
const validator = require('gltf-validator');
const bytes = require('fs').readFileSync(process.argv[1]);
validator.validateBytes(new Uint8Array(bytes)).then(report => console.log(JSON.stringify(report.issues)));
"""


def node(code: str, *words: str) -> str | None:
    """What node prints, with the packages that NODE_PATH names; None when it or the package is missing."""
    program = shutil.which("node")
    if program is None:
        return None
    done = subprocess.run([program, "-e", code, *words], capture_output=True, text=True, check=False)
    return done.stdout if done.returncode == 0 else None


@pytest.mark.parametrize("engine", ["generic", "unreal", "unity", "godot"])
@pytest.mark.parametrize("meshes", [True, False])
def test_no_errors(engine: str, meshes: bool, bpy: Any, addon: Any, tmp_path: Path) -> None:
    if node("require('gltf-validator')") is None:
        pytest.skip("needs node and its package gltf-validator, found through NODE_PATH")
    take = make_take(TakeSpec(people=3, frames=5, points=8))
    armatures = list(import_people(bpy, addon("scene_import.take_import"), take).armatures)
    done = export(bpy, addon, armatures, tmp_path, engine, format="glb", meshes=meshes)
    for path in done.files:
        issues = json.loads(node(VALIDATE, str(path)) or "{}")
        assert issues["numErrors"] == 0, issues["messages"]
