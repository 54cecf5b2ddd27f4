"""The built zip: accepted by Blender's own checks and by stricter ones, and at home without the source tree."""

import ast
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import pytest

import core_solver

ALLOWED_SOLVER_ROOMS = {"core_solver.take", "core_solver.geometry", "core_solver.errors"}
BLENDER_MODULES = {"bpy", "bpy_extras", "mathutils", "addon_utils"}
KNOWN_TAGS = {
    "3D View", "Add Curve", "Add Mesh", "Animation", "Bake", "Camera", "Compositing", "Development", "Game Engine",
    "Geometry Nodes", "Grease Pencil", "Import-Export", "Lighting", "Material", "Mesh", "Modeling", "Node", "Object",
    "Paint", "Physics", "Pipeline", "Render", "Rigging", "Scene", "Sculpt", "Sequencer", "System", "Text Editor",
    "Tracking", "UV", "User Interface",
}  # fmt: skip

BLOCK_HEAVY_IMPORTS = """
import sys
HEAVY = {"torch", "cv2", "onnxruntime", "onnx", "scipy", "trimesh", "tqdm", "platformdirs", "bpy"}
class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in HEAVY:
            raise ImportError(f"{name} must not be needed here")
sys.meta_path.insert(0, Blocker())
"""

# Hides every core_solver of this environment, so that only the extension's wheel is left.
HIDE_SOLVER = """
import os, sys
from pathlib import Path
sys.meta_path[:] = [finder for finder in sys.meta_path if "editable" not in repr(finder).lower()]
sys.path[:] = [place for place in sys.path if not (Path(place or ".") / "core_solver").exists()]
"""


@pytest.fixture(scope="module")
def manifest(extension_zip: Path) -> dict[str, Any]:
    with zipfile.ZipFile(extension_zip) as archive:
        return tomllib.loads(archive.read("blender_manifest.toml").decode())


def run_python(code: str, *, cwd: Path) -> str:
    done = subprocess.run([sys.executable, "-c", code], cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_blenders_own_validation_passes(extension_zip: Path, bpy_installed: Any) -> None:
    scripts = Path(bpy_installed.utils.system_resource("SCRIPTS"))
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    done = subprocess.run(
        [sys.executable, tool, "validate", extension_zip], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_manifest_says_what_the_platform_wants(manifest: dict[str, Any], extension_zip: Path) -> None:
    assert manifest["schema_version"] == "1.0.0"
    assert manifest["id"] == "scene_aware_mocap"
    assert manifest["type"] == "add-on"
    assert manifest["version"] == core_solver.__version__
    assert manifest["blender_version_min"] == "4.2.0"
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]
    assert 0 < len(manifest["tagline"]) <= 64
    assert not manifest["tagline"].endswith(".")
    assert "blender" not in manifest["name"].lower()
    assert set(manifest["tags"]) <= KNOWN_TAGS
    for reason in manifest["permissions"].values():
        assert 0 < len(reason) <= 64
        assert not reason.endswith(".")
    names = zipfile.ZipFile(extension_zip).namelist()
    assert [wheel.removeprefix("./") in names for wheel in manifest["wheels"]] == [True]


def test_every_file_names_its_licence_and_imports_only_what_blender_has(extension_zip: Path) -> None:
    with zipfile.ZipFile(extension_zip) as archive:
        sources = {name: archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")}
    assert "operators/import_take.py" in sources
    for name, source in sources.items():
        assert source.startswith("# SPDX-License-Identifier: GPL-3.0-or-later\n"), name
        assert "sys.path" not in source, name
        for module in imported_modules(source):
            root = module.split(".")[0]
            assert root in BLENDER_MODULES | {"numpy", "core_solver"} | sys.stdlib_module_names, f"{name}: {module}"
            if root == "core_solver":
                assert module in ALLOWED_SOLVER_ROOMS, f"{name}: {module}"


def imported_modules(source: str) -> set[str]:
    """Absolute imports only; relative ones stay inside the add-on."""
    modules: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            modules |= {alias.name for alias in node.names}
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            modules.add(node.module)
    return modules


def test_take_and_geometry_need_numpy_alone(extension_zip: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(extension_zip) as archive:
        wheel = next(name for name in archive.namelist() if name.endswith(".whl"))
        archive.extract(wheel, tmp_path)
    code = f"""{BLOCK_HEAVY_IMPORTS}
sys.path.insert(0, {str(tmp_path / wheel)!r})
import core_solver.take, core_solver.geometry, core_solver.errors
print(core_solver.take.__file__)
"""
    assert ".whl" in run_python(code, cwd=tmp_path)


def test_extension_imports_a_take_with_its_own_wheel(extension_zip: Path, tmp_path: Path) -> None:
    from core_solver.take import write_take

    from .take_factory import TakeSpec, make_take

    write_take(tmp_path / "match.npz", make_take(TakeSpec(people=2, points=8)))
    user = tmp_path / "user"
    code = f"""{HIDE_SOLVER}
os.environ["BLENDER_USER_RESOURCES"] = {str(user)!r}
import bpy
bpy.ops.extensions.package_install_files(filepath={str(extension_zip)!r}, repo="user_default", enable_on_install=True)
import core_solver
print("solver from", core_solver.__file__)
print(bpy.ops.import_scene.scene_aware_mocap(filepath={str(tmp_path / "match.npz")!r}))
print("armatures", len(bpy.data.armatures))
bpy.ops.preferences.addon_disable(module="bl_ext.user_default.scene_aware_mocap")
print("left", hasattr(bpy.types, "IMPORT_SCENE_OT_scene_aware_mocap"))
sys.stdout.flush()
os._exit(0)
"""
    output = run_python(code, cwd=tmp_path)
    assert f"solver from {user}" in output
    assert "armatures 2" in output
    assert "left False" in output
