"""The add-on as users get it: built into a zip and installed into Blender as an extension."""

import importlib
import importlib.util
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

MODULE = "bl_ext.user_default.scene_aware_mocap"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.blender)


@pytest.fixture(scope="session")
def extension_zip(repo_root: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    spec = importlib.util.spec_from_file_location("project_build", repo_root / "build.py")
    assert spec is not None
    assert spec.loader is not None
    build = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = build
    spec.loader.exec_module(build)
    return build.stage_extension(tmp_path_factory.mktemp("dist"))


@pytest.fixture(scope="session")
def bpy_installed(extension_zip: Path) -> Iterator[Any]:
    """bpy with the extension enabled and the user's own settings out of the way."""
    with tempfile.TemporaryDirectory(prefix="blender-user-", ignore_cleanup_errors=True) as folder:
        # Blender reads this once, when it is loaded; later it would install into the user's own settings.
        assert "bpy" not in sys.modules
        os.environ["BLENDER_USER_RESOURCES"] = folder
        bpy = pytest.importorskip("bpy")
        bpy.ops.extensions.package_install_files(
            filepath=str(extension_zip), repo="user_default", enable_on_install=True
        )
        yield bpy


@pytest.fixture
def bpy(bpy_installed: Any) -> Any:
    """bpy with the extension and an empty scene."""
    bpy_installed.ops.wm.read_homefile(use_empty=True)
    return bpy_installed


@pytest.fixture(scope="session")
def addon(bpy_installed: Any) -> Any:
    """Gives a module of the installed extension by its dotted name inside it."""

    def module(name: str) -> ModuleType:
        return importlib.import_module(f"{MODULE}.{name}")

    return module
