"""The command line: exit codes, one clear line, and a file that is whole."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from core_solver.take import write_take

from .blender_truth import armature_of
from .take_factory import TakeSpec, make_take
from .test_extension import HIDE_SOLVER


@pytest.fixture
def take_file(tmp_path: Path) -> Path:
    write_take(tmp_path / "match.npz", make_take(TakeSpec(people=2, frames=5, points=20)))
    return tmp_path / "match.npz"


def batch(repo_root: Path, *words: object) -> subprocess.CompletedProcess[str]:
    """As under plain Python with the solver installed."""
    environment = {**os.environ, "PYTHONPATH": str(repo_root)}
    script = repo_root / "blender_addon" / "batch.py"
    command = [sys.executable, str(script), *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=environment)


@pytest.mark.parametrize("ending", [".glb", ".fbx", ".GLB"])
def test_writes_all_people(ending: str, repo_root: Path, take_file: Path) -> None:
    target = take_file.with_name("new folder") / f"scene{ending}"
    done = batch(repo_root, "--", "--take", take_file, "--out", target)
    assert done.returncode == 0, done.stderr
    assert f"wrote {target}: 2 people, 5 frames" in done.stdout
    assert target.stat().st_size > 10_000
    assert [p.name for p in target.parent.iterdir()] == [target.name]


def test_written_glb_holds_both_people(repo_root: Path, take_file: Path, bpy: Any) -> None:
    target = take_file.with_suffix(".glb")
    assert batch(repo_root, "--take", take_file, "--out", target).returncode == 0
    bpy.ops.import_scene.gltf(filepath=str(target))
    for person in make_take(TakeSpec(people=2, frames=5, points=20)).people:
        assert armature_of(bpy, person).animation_data.action is not None


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--take", "TAKE", "--out", "scene.obj"], "must end in .glb or .fbx"),
        (["--take", "TAKE"], "--out"),
        ([], "--take"),
        (["--take", "missing.npz", "--out", "scene.glb"], "missing.npz: no such file"),
        (["--take", "FOREIGN", "--out", "scene.glb"], "foreign.npz: not a readable .npz archive"),
    ],
)
def test_a_bad_call_or_take_is_code_2_and_writes_nothing(
    words: list[str], reason: str, repo_root: Path, take_file: Path, tmp_path: Path
) -> None:
    foreign = tmp_path / "foreign.npz"
    foreign.write_text("something else")
    places = {"TAKE": str(take_file), "FOREIGN": str(foreign), "scene.glb": str(tmp_path / "scene.glb")}
    done = batch(repo_root, *(places.get(word, word) for word in words))
    assert done.returncode == 2
    assert reason in done.stderr.splitlines()[-1]
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "scene.glb").exists()


def test_a_place_that_cannot_be_written_is_code_1(repo_root: Path, take_file: Path) -> None:
    blocked = take_file.with_name("a file")
    blocked.write_text("in the way")
    done = batch(repo_root, "--take", take_file, "--out", blocked / "scene.glb")
    assert done.returncode == 1
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("batch.py:")]
    assert "cannot write" in line


@pytest.mark.parametrize("installed", [True, False])
def test_without_a_solver_it_comes_from_the_installed_extension(
    installed: bool, repo_root: Path, take_file: Path, extension_zip: Path
) -> None:
    user, target = take_file.with_name("user"), take_file.with_suffix(".glb")
    isolated = f"{HIDE_SOLVER}\nos.environ['BLENDER_USER_RESOURCES'] = {str(user)!r}\n"
    if installed:
        install = f"""{isolated}
import bpy
bpy.ops.extensions.package_install_files(filepath={str(extension_zip)!r}, repo="user_default", enable_on_install=False)
sys.stdout.flush()
os._exit(0)
"""
        subprocess.run([sys.executable, "-c", install], cwd=take_file.parent, check=True)
    script = repo_root / "blender_addon" / "batch.py"
    code = f"""{isolated}
import runpy
sys.argv = ["blender", "-b", "--python", "batch.py", "--", "--take", {str(take_file)!r}, "--out", {str(target)!r}]
runpy.run_path({str(script)!r}, run_name="__main__")
"""
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=take_file.parent, capture_output=True, text=True, check=False
    )
    assert done.returncode == (0 if installed else 1), done.stdout + done.stderr
    assert target.exists() == installed
    if not installed:
        assert "core_solver is missing: install the Scene-Aware Mocap extension" in done.stderr
        assert "Traceback" not in done.stderr


def test_the_script_brings_takes_onto_a_character(repo_root: Path, take_file: Path) -> None:
    rig = repo_root / "blender_addon" / "samples" / "sample_rig.glb"
    folder = take_file.with_name("out")
    done = batch(repo_root, "--", "--take", take_file, "--rig", rig, "--export", folder, "--engine", "unity")
    assert done.returncode == 0, done.stderr
    names = {f"match_Person {number}.fbx" for number in (1, 2)}
    assert {path.name for path in folder.iterdir()} == names
    assert {line for line in done.stdout.splitlines() if line.startswith("wrote")} == {
        f"wrote {folder / name}: 1 people, 5 frames" for name in names
    }
