"""What can only be seen in a window: sections that draw, people that play, a solve that leaves Blender its own."""

import os
import sys
from pathlib import Path

import pytest

from .conftest import Window

# In the solver's place: works for a few seconds, then hands over a finished take.
SLOW_STAND_IN = """
import json, shutil, sys, time
output = sys.argv[sys.argv.index("--output") + 1]
for done in range(81):
    print(json.dumps({"stage": "people", "done": done, "total": 80}), flush=True)
    time.sleep(0.1)
print("all is well", flush=True)
shutil.copy(SAMPLE, output)
"""


@pytest.fixture
def solver(tmp_path: Path, repo_root: Path) -> dict[str, str]:
    package = tmp_path / "stand-in" / "core_solver"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    sample = repo_root / "blender_addon" / "samples" / "sample_take.npz"
    copy = tmp_path / "sample.npz"
    copy.write_bytes(sample.read_bytes())
    (package / "cli.py").write_text(SLOW_STAND_IN.replace("SAMPLE", repr(str(copy))))
    video = tmp_path / "clip.mp4"
    video.write_bytes((sample.with_name("sample_take.mp4")).read_bytes())
    python = os.environ.get("WINDOW_PYTHON", sys.executable)
    return {"PYTHONPATH": str(package.parent), "VIDEO": str(video), "SOLVER_PYTHON": python}


def test_the_sections_draw(window: Window) -> None:
    window.run("sections")
    assert (window.shots / "sections.png").stat().st_size > 20_000


def test_the_sample_take_plays_and_can_be_undone(window: Window) -> None:
    window.run("sample")


def test_the_tutorial_leads_to_a_glb(window: Window, tmp_path: Path) -> None:
    window.run("tutorial", FOLDER=str(tmp_path))
    assert (tmp_path / "handshake.glb").stat().st_size > 100_000


def test_cleaning_can_be_stopped_and_writes_new_actions(window: Window) -> None:
    window.run("clean")


def test_it_speaks_german_when_blender_does(window: Window) -> None:
    window.run("german")


def test_blender_stays_responsive_while_a_video_is_solved(window: Window, solver: dict[str, str]) -> None:
    said = window.run("solve", **solver)
    assert "longest wait" in said
    assert Path(solver["VIDEO"]).with_suffix(".npz").is_file()


def test_a_solve_can_be_cancelled(window: Window, solver: dict[str, str]) -> None:
    window.run("cancel", **solver)
    assert not Path(solver["VIDEO"]).with_suffix(".npz").exists()


def test_blender_quits_while_a_video_is_solved(window: Window, solver: dict[str, str]) -> None:
    window.run("quit_while_solving", **solver)
    assert not Path(solver["VIDEO"]).with_suffix(".npz").exists()
