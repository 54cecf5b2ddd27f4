"""Many takes at once: what is written, what is reported, and that one bad take does not cost the others."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import JOINT_NAMES, write_take
from tests.addon.export.test_profiles import heads, read_back
from tests.addon.take_factory import TakeSpec, make_take

Run = Any


@pytest.fixture
def run(bpy: Any, addon: Any, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs a command line; gives the exit code and the lines on stderr."""

    def call(*words: object) -> tuple[int, list[str]]:
        code = addon("batching.command").main([str(word) for word in words])
        return code, [line for line in capsys.readouterr().err.splitlines() if line.startswith("batch.py:")]

    return call


@pytest.fixture
def takes(tmp_path: Path) -> list[Path]:
    paths = [tmp_path / "first take.npz", tmp_path / "второй.npz"]
    for seed, path in enumerate(paths):
        write_take(path, make_take(TakeSpec(people=2, frames=6, points=8, swing=0.3, seed=seed)))
    return paths


@pytest.fixture
def sample_rig(repo_root: Path) -> Path:
    return repo_root / "blender_addon" / "samples" / "sample_rig.glb"


def strict_json(path: Path) -> dict[str, Any]:
    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse)


def test_a_bad_take_does_not_cost_the_others(run: Run, takes: list[Path], tmp_path: Path) -> None:
    bad = tmp_path / "bad.npz"
    bad.write_text("text")
    out = tmp_path / "new" / "out"
    report = tmp_path / "reports" / "r.json"
    code, lines = run("--take", takes[0], bad, "--take", takes[1], "--export", out, "--report", report)
    assert code == 1
    assert len(lines) == 1
    assert "bad.npz: not a readable .npz archive" in lines[0]
    assert {path.name for path in out.iterdir()} == {"first take.glb", "второй.glb"}
    document = strict_json(report)
    assert not document["passed"]
    first, second, third = document["takes"]
    assert [entry["passed"] for entry in (first, second, third)] == [True, False, True]
    assert second["error"] in lines[0]
    assert (second["files"], second["people"]) == ([], [])
    assert first["files"] == [str(out / "first take.glb")]
    assert [(p["id"], p["name"], p["character"]) for p in first["people"]] == [(1, "Person 1", ""), (4, "Person 2", "")]
    assert first["frames"] == 6
    assert first["measures"] == {"before": None, "after": None}
    assert first["warnings"] == ["The depth is made up."]
    assert 0 < first["seconds"] < 60
    assert all(check["passed"] and check["joint_error_m"] < 1e-3 for check in first["verification"])
    assert [path.name for path in report.parent.iterdir()] == ["r.json"]


def test_a_fault_in_one_take_is_reported_and_the_others_follow(
    run: Run, takes: list[Path], addon: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    running = addon("batching.running")
    real = running.import_take

    def fail_once(context: Any, take: Any, path: Path, options: Any) -> Any:
        if path == takes[0]:
            raise ZeroDivisionError("a fault of ours")
        return real(context, take, path, options)

    monkeypatch.setattr(running, "import_take", fail_once)
    code, (line,) = run("--take", *takes, "--export", tmp_path / "out")
    assert code == 1
    assert "unexpected ZeroDivisionError" in line
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["второй.glb"]


def test_a_file_that_does_not_hold_what_it_should_fails(
    run: Run, takes: list[Path], addon: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(addon("export.verification"), "TOLERANCE_M", 1e-12)
    code, lines = run("--take", takes[0], "--export", tmp_path / "out", "--report", tmp_path / "r.json")
    assert code == 1
    assert all("joints" in line for line in lines)
    assert not strict_json(tmp_path / "r.json")["takes"][0]["passed"]
    assert (tmp_path / "out" / "first take.glb").exists()


def test_everybody_gets_a_copy_of_the_character(
    run: Run, takes: list[Path], sample_rig: Path, bpy: Any, tmp_path: Path
) -> None:
    code, lines = run(
        "--take", takes[0], "--rig", sample_rig, "--clean", "footlock, smooth", "--engine", "unreal",
        "--export", tmp_path / "out", "--report", tmp_path / "r.json",
    )  # fmt: skip
    assert (code, lines) == (0, [])
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "first take_Person 1.fbx",
        "first take_Person 2.fbx",
    }
    (entry,) = strict_json(tmp_path / "r.json")["takes"]
    assert [person["character"] for person in entry["people"]] == ["Person 1", "Person 2"]
    assert entry["measures"]["after"]["spacing_mm"] < 20
    assert any("bones of sample_rig.glb found by" in note for note in entry["warnings"])
    places = []
    for name in ("Person 1", "Person 2"):
        read_back(bpy, tmp_path / "out" / f"first take_{name}.fbx")
        (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
        assert set(JOINT_NAMES).isdisjoint(bone.name for bone in armature.data.bones)
        assert [obj for obj in bpy.data.objects if obj.type == "MESH" and obj.vertex_groups]
        root = next(bone.name for bone in armature.data.bones if bone.parent is None)
        places.append(heads(bpy, armature, [root], [1])[0, 0, :2])
    # The factory's people stand two metres from each other, in each other's depth and width.
    assert 1.5 < np.linalg.norm(places[0] - places[1]) < 3.0


def test_only_the_people_wanted_and_motion_alone(run: Run, takes: list[Path], bpy: Any, tmp_path: Path) -> None:
    code, _ = run(
        "--take", takes[0], "--person", "person 2", "--motion-only", "--frame-rate", 60, "--format", "fbx",
        "--export", tmp_path / "out",
    )  # fmt: skip
    assert code == 0
    read_back(bpy, tmp_path / "out" / "first take.fbx")
    (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    assert armature["person_id"] == 4
    assert not [obj for obj in bpy.data.objects if obj.type == "MESH" and obj.vertex_groups]
    assert bpy.context.scene.render.fps == 60


def test_somebody_who_is_not_there_fails_the_take(run: Run, takes: list[Path], tmp_path: Path) -> None:
    code, (line,) = run("--take", takes[0], "--person", "Anna", "--export", tmp_path / "out")
    assert code == 1
    assert "nobody is called anna" in line
    assert not (tmp_path / "out").exists()


def test_cleaning_changes_the_motion(run: Run, takes: list[Path], bpy: Any, tmp_path: Path) -> None:
    found = []
    for name, words in (("plain", ()), ("smooth", ("--clean", "smooth"))):
        assert run("--take", takes[0], "--export", tmp_path / name, *words)[0] == 0
        read_back(bpy, tmp_path / name / "first take.glb")
        armature = next(obj for obj in bpy.data.objects if obj.get("person_id") == 1)
        found.append(heads(bpy, armature, ["left_wrist"], [1.0, 2.0, 3.0, 4.0]))
    assert 1e-4 < np.abs(found[0] - found[1]).max() < 0.5


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--export", "OUT"], "--take"),
        (["--take", "TAKE"], "either --out FILE for one take or --export DIR"),
        (["--take", "TAKE", "--out", "a.glb", "--export", "OUT"], "either --out FILE"),
        (["--take", "TAKE", "TAKE", "--out", "a.glb"], "--out takes one take"),
        (["--take", "TAKE", "--export", "OUT", "--clean", "polish"], "no step 'polish': choose of gaps, smooth"),
        (["--take", "TAKE", "--export", "OUT", "--map", "Martian"], "no bone map 'Martian': choose auto or one of"),
        (["--take", "TAKE", "--export", "OUT", "--rig", "there/is/none.glb"], "is not there: check the path"),
        (["--take", "TAKE", "--export", "OUT", "--rig", "hero.obj"], "must end in .glb, .gltf, .vrm, .fbx, .blend"),
        (["--take", "TAKE", "--export", "OUT", "--rig", f"{'n' * 300}.glb"], "is not there: check the path"),
        (["--take", "TAKE", "--export", "OUT", "--engine", "quake"], "choose from"),
        (["--take", "TAKE", "--export", "OUT", "--frame-rate", "-5"], "'-5' is no frame rate"),
        (["--take", "TAKE", "--export", "OUT", "--frame-rate", "0"], "'0' is no frame rate"),
        (["--take", "TAKE", "--export", "OUT", "--frame-rate", "nan"], "'nan' is no frame rate"),
        (["--take", "TAKE", "--export", "OUT", "--frame-rate", "fast"], "'fast' is no frame rate"),
        (["--take", "TAKE", "other/First Take.npz", "--export", "OUT"], "would be written to the same files"),
    ],
)
def test_bad_calls_are_code_2(words: list[str], reason: str, run: Run, takes: list[Path], tmp_path: Path) -> None:
    places = {"TAKE": str(takes[0]), "OUT": str(tmp_path / "out"), "a.glb": str(tmp_path / "a.glb")}
    code, lines = run(*(places.get(word, word) for word in words))
    assert code == 2
    assert reason in lines[-1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["first take.npz", "второй.npz"]


def test_a_report_that_cannot_be_written_is_said(run: Run, takes: list[Path], tmp_path: Path) -> None:
    blocked = tmp_path / "a file"
    blocked.write_text("in the way")
    code, lines = run("--take", takes[0], "--export", tmp_path / "out", "--report", blocked / "r.json")
    assert code == 1
    assert "cannot write the report" in lines[-1]


def test_a_report_is_readable_by_whom_the_system_lets_read(run: Run, takes: list[Path], tmp_path: Path) -> None:
    report, other = tmp_path / "r.json", tmp_path / "other.txt"
    other.write_text("any new file")
    assert run("--take", takes[0], "--motion-only", "--export", tmp_path / "out", "--report", report)[0] == 0
    assert report.stat().st_mode == other.stat().st_mode


def test_a_take_that_cannot_be_reached_is_said_in_one_line(run: Run, takes: list[Path], tmp_path: Path) -> None:
    code, (line,) = run(
        "--take", tmp_path / f"{'n' * 300}.npz", takes[0], "--motion-only", "--export", tmp_path / "out"
    )
    assert code == 1
    assert "File name too long; choose another file" in line
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["first take.glb"]


def test_blender_knows_the_command(addon: Any, takes: list[Path], tmp_path: Path, bpy: Any) -> None:
    registration = addon("batching.registration")
    assert registration.NAME.isidentifier()
    assert registration.run_command(["--take", str(takes[0]), "--export", str(tmp_path / "out")]) == 0
    assert registration.run_command(["--take", str(takes[0])]) == 2
