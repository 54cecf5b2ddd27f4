"""What is set once per computer."""

from pathlib import Path
from typing import Any

import pytest

from .conftest import MODULE


@pytest.fixture
def preferences(bpy: Any) -> Any:
    preferences = bpy.context.preferences.addons[MODULE].preferences
    yield preferences
    preferences.export_directory = preferences.solver_python = ""


def test_exports_go_to_the_folder_of_the_preferences_unless_another_is_chosen(
    bpy: Any, preferences: Any, tmp_path: Path
) -> None:
    bpy.ops.scene_aware_mocap.load_sample_take()
    with pytest.raises(RuntimeError, match="no folder to export to"):
        bpy.ops.scene_aware_mocap.export(contents="MOTION")
    preferences.export_directory = str(tmp_path / "usual")
    bpy.ops.scene_aware_mocap.export(file_name="one", contents="MOTION")
    bpy.ops.scene_aware_mocap.export(directory=str(tmp_path / "other"), file_name="two", contents="MOTION")
    assert [path.name for path in (tmp_path / "usual").iterdir()] == ["one.glb"]
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["two.glb"]


def test_choosing_another_python_forgets_what_was_found(bpy: Any, preferences: Any, tmp_path: Path) -> None:
    preferences.solver_found = "Solver 1.2.3 found"
    preferences.solver_python = str(tmp_path)
    assert preferences.solver_found == ""
    with pytest.raises(RuntimeError, match="there is no Python at"):
        bpy.ops.scene_aware_mocap.check_solver()
    assert "there is no Python at" in preferences.solver_found
