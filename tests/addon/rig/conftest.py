"""A rig that Rigify makes."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

# Rigify leaves Blender in a state in which some versions crash or hang at the end, so it works in a process of its own.
_GENERATE = """
import os, sys
import bpy
bpy.ops.preferences.addon_enable(module="rigify")
for obj in list(bpy.data.objects):
    bpy.data.objects.remove(obj)
bpy.ops.object.armature_human_metarig_add()
bpy.context.object.name = "Metarig"
bpy.ops.pose.rigify_generate()
next(o for o in bpy.data.objects if o.type == "ARMATURE" and o.name != "Metarig").name = "Generated"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="session")
def rigify_file(bpy_installed: Any, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A Blender file with the human metarig and the rig that Rigify makes of it."""
    path = tmp_path_factory.mktemp("rigify") / "rigify.blend"
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(path.parent)}
    command = [sys.executable, "-c", _GENERATE, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, env=environment, check=False)
    assert path.exists(), done.stdout + done.stderr
    return path
