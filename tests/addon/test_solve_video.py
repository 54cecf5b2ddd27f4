"""Solving from Blender: a stand-in for the solver plays every part; what is asked, told, stopped and kept."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from core_solver.errors import UserError
from core_solver.take import write_take

from .conftest import MODULE
from .take_factory import TakeSpec, make_take

# Takes the solver's place: says what it was asked, makes progress and does what the environment tells it.
STAND_IN = """
import json, os, shutil, subprocess, sys, time
if "--version" in sys.argv:
    print("scene-aware-mocap 9.8.7")
    sys.exit(0)
part = os.environ["PART"]
print("asked", json.dumps(sys.argv[1:], ensure_ascii=False), flush=True)
output = sys.argv[sys.argv.index("--output") + 1]
for percent in (0, 50, 100):
    print(f"\\ropen-body: {percent:3d}%|####      | 1.0M/45.5M [00:01<00:02]", end="", file=sys.stderr, flush=True)
print(file=sys.stderr)
for done in (0, 5, 10, 10):
    print(json.dumps({"stage": "people", "done": done, "total": 10}), file=sys.stderr, flush=True)
print(json.dumps({"note": "a remark"}), file=sys.stderr, flush=True)
if part == "refuses":
    print("error: the video shows nobody: film people", file=sys.stderr)
    sys.exit(2)
if part == "dies":
    os._exit(3)
if part == "hangs":
    open(os.path.join(os.path.dirname(output), "." + os.path.basename(output) + ".x.part"), "w").close()
    child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    print("child", child.pid, flush=True)
    while True:
        try:
            time.sleep(600)
        except KeyboardInterrupt:
            if "STUBBORN" not in os.environ:
                sys.exit(130)
shutil.copy(os.environ["RESULT"], output)
print("take:", output)
"""


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """A video, a finished take and a Python whose solver is the stand-in."""
    package = tmp_path / "stand-in" / "core_solver"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package / "cli.py").write_text(STAND_IN)
    folder = tmp_path / "Größe 動画"
    folder.mkdir()
    video = folder / "two people.mp4"
    video.write_bytes(b"not looked at")
    write_take(tmp_path / "result.npz", make_take(TakeSpec(people=2, frames=5, points=20)))
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.setenv("RESULT", str(tmp_path / "result.npz"))
    monkeypatch.setenv("PART", "solves")
    return SimpleNamespace(video=video, take=video.with_suffix(".npz"), python=Path(sys.executable))


@pytest.fixture
def preferences(bpy: Any, stage: SimpleNamespace) -> Any:
    preferences = bpy.context.preferences.addons[MODULE].preferences
    preferences.solver_python = str(stage.python)
    yield preferences
    preferences.solver_python = ""


def run_until(process: Any, done: Any, seconds: float = 20) -> None:
    end = time.monotonic() + seconds
    while not done():
        assert time.monotonic() < end, process.lines
        process.poll()
        time.sleep(0.02)


# --- what is asked ---


def test_the_words_are_the_command_lines(addon: Any, tmp_path: Path) -> None:
    from core_solver.cli import _parser

    request = addon("solving.request").SolveRequest
    plain = request(tmp_path / "a clip.mp4")
    options = _parser().parse_args(plain.words())
    assert (options.video, options.output) == (tmp_path / "a clip.mp4", tmp_path / "a clip.npz")
    assert (options.preset, options.progress, options.every) == ("fast", "json", 1)
    assert (options.rotate, options.device) == (0, "auto")
    assert [options.camera, options.fov_degrees, options.people, options.start_s, options.end_s] == [None] * 5
    full = request(
        tmp_path / "a.mp4", output=tmp_path / "b.npz", preset="exact", camera="C.qca.txt", camera_name="cam01",
        people=2, start_s=0.5, end_s=2.25, every=3, depth="net.onnx", rotate=90, device="cpu",
        resume=True, offline=True,
    )  # fmt: skip
    options = _parser().parse_args(full.words())
    assert (options.output, options.preset, options.camera) == (tmp_path / "b.npz", "exact", "C.qca.txt:cam01")
    assert (options.people, options.start_s, options.end_s, options.every) == (2, 0.5, 2.25, 3)
    assert (options.rotate, options.device) == (90, "cpu")
    assert (options.depth, options.resume, options.offline) == (Path("net.onnx"), True, True)
    assert _parser().parse_args(request(tmp_path / "a.mp4", fov_degrees=62.5).words()).fov_degrees == 62.5


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"video": "missing.mp4"}, "there is no video at"),
        ({"output": "take.txt"}, "must end in .npz"),
        ({"output": "clip.mp4/take.npz"}, "choose another place"),
        ({"camera": "c.json", "fov_degrees": 60.0}, "give one of them"),
        ({"start_s": 3.0, "end_s": 2.0}, "not after the start"),
    ],
)
def test_a_senseless_request_is_refused(change: dict[str, Any], reason: str, addon: Any, tmp_path: Path) -> None:
    (tmp_path / "clip.mp4").touch()
    paths = {key: tmp_path / value for key, value in change.items() if key in {"video", "output"}}
    request = addon("solving.request").SolveRequest(**{"video": tmp_path / "clip.mp4", **change, **paths})
    with pytest.raises(UserError, match=reason):
        request.check()


# --- the Python ---


def test_a_python_is_found_by_its_path_or_its_environment(addon: Any, tmp_path: Path) -> None:
    find = addon("solving.python").find_python
    for program in ("bin/python", "Scripts/python.exe"):
        place = tmp_path / program.partition("/")[0] / program
        place.parent.mkdir(parents=True)
        place.touch()
        assert find(str(place)) == place
        assert find(str(place.parents[1])) == place
    with pytest.raises(UserError, match="preferences"):
        find("")
    with pytest.raises(UserError, match="there is no Python at"):
        find(str(tmp_path / "nowhere"))
    with pytest.raises(UserError, match="environment's folder"):
        find(str(tmp_path))


def test_a_link_to_a_python_stays_a_link(addon: Any, tmp_path: Path) -> None:
    link = tmp_path / "python"
    link.symlink_to(sys.executable)
    assert addon("solving.python").find_python(str(link)) == link


def test_check_tells_the_version_or_how_to_install(
    bpy: Any, stage: SimpleNamespace, preferences: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    assert bpy.ops.scene_aware_mocap.check_solver() == {"FINISHED"}
    assert preferences.solver_found == "Solver 9.8.7 found"
    (tmp_path / "stand-in" / "core_solver" / "cli.py").unlink()
    with pytest.raises(RuntimeError, match=r"has no solver: install"):
        bpy.ops.scene_aware_mocap.check_solver()
    preferences.solver_python = str(stage.video)
    assert preferences.solver_found == ""
    with pytest.raises(RuntimeError, match="does not run"):
        bpy.ops.scene_aware_mocap.check_solver()


# --- the process ---


def test_progress_arrives_while_it_works_and_the_log_is_kept(addon: Any, stage: SimpleNamespace) -> None:
    process = addon("solving.process").SolverProcess(stage.python, addon("solving.request").SolveRequest(stage.video))
    process.wait()
    process.check()
    assert (process.stage.name, process.stage.done, process.stage.total) == ("people", 10, 10)
    assert process.stage.fraction == 1.0
    assert "two people.mp4" in process.lines[0]
    assert "a remark" in process.lines
    assert sum(line.startswith("people: 10 done in") for line in process.lines) == 1
    assert sum(line.startswith("open-body: 100 done in") for line in process.lines) == 1
    assert not any(line.startswith("{") or "%|" in line or not line for line in process.lines)
    assert process.request.log.read_text(encoding="utf-8").splitlines() == process.lines


def test_polling_never_waits(addon: Any, stage: SimpleNamespace, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PART", "hangs")
    process = addon("solving.process").SolverProcess(stage.python, addon("solving.request").SolveRequest(stage.video))
    longest, end = 0.0, time.monotonic() + 1
    while time.monotonic() < end:
        began = time.monotonic()
        assert process.poll()
        longest = max(longest, time.monotonic() - began)
        time.sleep(0.005)
    process.cancel()
    process.wait()
    assert longest < 0.1


@pytest.mark.parametrize("stubborn", [False, True])
def test_cancel_ends_the_whole_family_and_leaves_nothing_half_written(
    stubborn: bool, addon: Any, stage: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PART", "hangs")
    if stubborn:
        monkeypatch.setenv("STUBBORN", "1")
        monkeypatch.setattr(addon("solving.process"), "_GRACE_S", 0.5)
    process = addon("solving.process").SolverProcess(stage.python, addon("solving.request").SolveRequest(stage.video))
    run_until(process, lambda: any(line.startswith("child ") for line in process.lines))
    child = int(next(line for line in process.lines if line.startswith("child ")).split()[1])
    process.cancel()
    run_until(process, lambda: not process.poll())
    with pytest.raises(UserError, match="cancelled"):
        process.check()
    assert sorted(place.name for place in stage.video.parent.iterdir()) == ["two people.mp4", "two people.solve.log"]
    assert not is_alive(child)


def is_alive(pid: int) -> bool:
    for _ in range(50):
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return False
        state = subprocess.run(["ps", "-o", "stat=", "-p", str(pid)], capture_output=True, text=True, check=False)
        if state.stdout.strip().startswith("Z") or not state.stdout.strip():
            return False
        time.sleep(0.05)
    os.kill(pid, signal.SIGKILL)
    return True


@pytest.mark.parametrize(
    ("part", "reason"),
    [("refuses", "^the video shows nobody: film people$"), ("dies", "ended with code 3")],
)
def test_a_failure_is_told_in_the_solvers_words(
    part: str, reason: str, addon: Any, stage: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PART", part)
    process = addon("solving.process").SolverProcess(stage.python, addon("solving.request").SolveRequest(stage.video))
    process.wait()
    with pytest.raises(UserError, match=reason):
        process.check()


# --- beside a window ---


def test_one_solve_at_a_time_and_none_stays_behind(
    addon: Any, stage: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PART", "hangs")
    watch, request = addon("solving.watch"), addon("solving.request").SolveRequest(stage.video)
    watch.begin(stage.python, request, import_result=True)
    process = watch.current().process
    with pytest.raises(UserError, match="a video is being solved already"):
        watch.begin(stage.python, request, import_result=True)
    run_until(process, lambda: any(line.startswith("child ") for line in process.lines))
    watch.stop()  # what switching the extension off and closing Blender do
    assert watch.current() is None
    assert not process.poll()
    child = int(next(line for line in process.lines if line.startswith("child ")).split()[1])
    assert not is_alive(child)
    assert not stage.take.exists()
    watch.stop()


def test_another_file_does_not_get_the_people(
    bpy: Any, addon: Any, stage: SimpleNamespace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PART", "hangs")
    watch, request = addon("solving.watch"), addon("solving.request").SolveRequest(stage.video)
    watch.begin(stage.python, request, import_result=True)
    assert watch.current().same_file
    bpy.ops.wm.read_homefile(use_empty=True)
    assert not watch.current().same_file
    watch.stop()


# --- the operator ---


def test_without_a_window_it_waits_and_brings_the_people_in(bpy: Any, stage: SimpleNamespace, preferences: Any) -> None:
    assert bpy.ops.scene_aware_mocap.solve_video(video=str(stage.video)) == {"FINISHED"}
    assert stage.take.is_file()
    assert len(bpy.data.armatures) == 2
    assert "a remark" in bpy.data.texts["Solve Log"].as_string()


def test_the_import_can_be_left_out(bpy: Any, stage: SimpleNamespace, preferences: Any, tmp_path: Path) -> None:
    take = tmp_path / "elsewhere" / "take.npz"
    bpy.ops.scene_aware_mocap.solve_video(video=str(stage.video), output=str(take), import_result=False)
    assert take.is_file()
    assert not bpy.data.armatures


def test_a_failing_solve_changes_nothing(
    bpy: Any, stage: SimpleNamespace, preferences: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PART", "refuses")
    with pytest.raises(RuntimeError, match="the video shows nobody"):
        bpy.ops.scene_aware_mocap.solve_video(video=str(stage.video))
    assert not bpy.data.armatures
    assert not stage.take.exists()


@pytest.mark.parametrize("allowed", [False, True])
def test_nothing_is_fetched_unless_blender_may(
    allowed: bool, bpy: Any, stage: SimpleNamespace, preferences: Any
) -> None:
    system = bpy.context.preferences.system
    before, system.use_online_access = system.use_online_access, allowed
    bpy.ops.scene_aware_mocap.solve_video(video=str(stage.video), import_result=False)
    asked = bpy.data.texts["Solve Log"].lines[0].body
    system.use_online_access = before
    assert ("--offline" in asked) == (not allowed)


def test_without_a_video_it_says_so(bpy: Any, preferences: Any) -> None:
    with pytest.raises(RuntimeError, match="no video is chosen"):
        bpy.ops.scene_aware_mocap.solve_video()


def test_without_a_chosen_python_it_says_where_to_choose_it(bpy: Any, stage: SimpleNamespace) -> None:
    with pytest.raises(RuntimeError, match="set it in the preferences"):
        bpy.ops.scene_aware_mocap.solve_video(video=str(stage.video))


def test_settings_and_operator_have_the_same_choices(bpy: Any, addon: Any) -> None:
    settings = addon("settings.solve")
    scene = bpy.context.scene.mocap_solve
    scene.video, scene.people, scene.preset = "clip.mp4", 3, "exact"
    target = SimpleNamespace()
    settings.copy_inputs(scene, target)
    assert (target.video, target.people, target.preset) == ("clip.mp4", 3, "exact")
    operator = bpy.ops.scene_aware_mocap.solve_video.get_rna_type().properties
    assert set(settings.SolveInputs.__annotations__) <= set(operator.keys())
