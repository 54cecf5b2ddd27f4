"""The task runner: same sources give the same extension, and a finished environment is left alone."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import tomllib
import zipfile
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from pathlib import Path
    from types import ModuleType


@pytest.fixture(scope="module")
def build(repo_root: Path) -> ModuleType:
    """build.py as a module."""
    spec = importlib.util.spec_from_file_location("build_runner", repo_root / "build.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def extension(build: ModuleType, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built extension."""
    return build.stage_extension(tmp_path_factory.mktemp("dist"))


def test_extension_carries_the_solver_as_a_wheel(build: ModuleType, extension: Path) -> None:
    with zipfile.ZipFile(extension) as archive:
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
        names = archive.namelist()
        assert len(manifest["wheels"]) == 1
        wheel = manifest["wheels"][0].removeprefix("./")
        assert wheel in names
        with archive.open(wheel) as data, zipfile.ZipFile(data) as solver:
            inside = solver.namelist()
    assert wheel.endswith("-py3-none-any.whl")
    assert "core_solver/take/__init__.py" in inside
    assert "core_solver/perception/models.toml" in inside
    assert extension.name == f"scene_aware_mocap-{manifest['version']}.zip"
    assert {"__init__.py", "LICENSE"} <= set(names)
    assert not [name for name in names if "__pycache__" in name or name.endswith(".pyc")]


def test_extension_is_the_same_twice(build: ModuleType, extension: Path, tmp_path: Path) -> None:
    again = build.stage_extension(tmp_path)
    assert again.read_bytes() == extension.read_bytes()
    assert list(tmp_path.iterdir()) == [again], "nothing of the staging stays"


def test_versions_agree(build: ModuleType, repo_root: Path) -> None:
    project = tomllib.loads((repo_root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    manifest = tomllib.loads((repo_root / "blender_addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert project["version"] == manifest["version"]
    from core_solver import __version__

    assert __version__ == project["version"]


def test_manifest_without_the_line_is_refused(build: ModuleType, tmp_path: Path) -> None:
    manifest = tmp_path / "blender_manifest.toml"
    manifest.write_text('version = "1"\nwheels = ["./old.whl"]\n')
    with pytest.raises(build.BuildError, match=r"wheels = \[\]"):
        build.name_wheel(manifest, "new.whl")


def make(build: ModuleType, folder: Path, stamp: str, installs: list[Path]) -> Path:
    """An environment whose installation is only noted."""
    return build.make_environment(folder, sys.executable, stamp, installs.append)


def test_environment_is_made_once_per_fingerprint(build: ModuleType, tmp_path: Path) -> None:
    folder = tmp_path / "venv"
    installs: list[Path] = []
    python = make(build, folder, "one", installs)
    assert subprocess.run([python, "-c", "print(1)"], check=True, capture_output=True).stdout.strip() == b"1"
    assert make(build, folder, "one", installs) == python
    assert len(installs) == 1
    make(build, folder, "two", installs)
    assert len(installs) == 2


def test_interrupted_installation_is_not_taken_for_finished(build: ModuleType, tmp_path: Path) -> None:
    folder = tmp_path / "venv"

    def fail(_python: Path) -> None:
        raise build.BuildError("no network")

    with pytest.raises(build.BuildError):
        build.make_environment(folder, sys.executable, "one", fail)
    assert not build.is_ready(folder, "one")


def test_fingerprint_follows_the_constraints(
    build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = build.fingerprint("main")
    changed = tmp_path / "constraints.txt"
    changed.write_bytes(build.CONSTRAINTS.read_bytes() + b"x==1\n")
    monkeypatch.setattr(build, "CONSTRAINTS", changed)
    assert build.fingerprint("main") != before


def test_constraints_pin_exactly(build: ModuleType) -> None:
    lines = [line for line in build.CONSTRAINTS.read_text().splitlines() if line and not line.startswith("#")]
    assert all("==" in line for line in lines)
    pins = dict(line.split("==") for line in lines)
    assert pins["numpy"].startswith("1."), "bpy 5.0 needs numpy 1"
    assert "+" not in pins["torch"], "a local build is chosen by where it comes from, not by the pin"


def test_missing_libraries_name_the_command(build: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(build, "missing_system_libraries", lambda: ["libsm6", "libice6"])
    monkeypatch.setattr(build.shutil, "which", lambda _name: "/usr/bin/apt-get")
    monkeypatch.setattr(build.os, "geteuid", lambda: 1000)
    with pytest.raises(build.BuildError, match="sudo apt-get install -y --no-install-recommends libsm6 libice6"):
        build.install_system_libraries()


@pytest.fixture
def bare(build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of all programs of a machine on which we are root, at first empty."""
    monkeypatch.setenv("PATH", str(tmp_path))
    for name in ("CHROMIUM", "DEBIAN_FRONTEND"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(build.sys, "platform", "linux")
    monkeypatch.setattr(build.os, "geteuid", lambda: 0)
    return tmp_path


def program(path: Path, *lines: str) -> None:
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)


needs_sh = pytest.mark.skipif(sys.platform == "win32", reason="stands in for apt-get with a shell script")


@needs_sh
def test_a_browser_is_installed_where_there_is_none(
    build: ModuleType, bare: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program(
        bare / "apt-get",
        f'echo "$@ [$DEBIAN_FRONTEND]" >> "{bare}/asked"',
        f'if [ "$1" = install ]; then : > "{bare}/chromium"; /bin/chmod 755 "{bare}/chromium"; fi',
    )
    build.install_browser()
    assert (bare / "asked").read_text().splitlines() == [
        "update []", "install -y --no-install-recommends chromium [noninteractive]",
    ]  # fmt: skip
    assert build.find_browser() == str(bare / "chromium")
    assert "skipped" not in capsys.readouterr().out
    build.install_browser()
    assert len((bare / "asked").read_text().splitlines()) == 2, "nothing is installed twice"


@needs_sh
@pytest.mark.parametrize("script", ["exit 100", None])
def test_a_browser_that_cannot_be_installed_stops_nothing(
    build: ModuleType, bare: Path, capsys: pytest.CaptureFixture[str], script: str | None
) -> None:
    if script is not None:
        program(bare / "apt-get", script)
    build.install_browser()
    assert "will be skipped" in capsys.readouterr().out


@needs_sh
def test_only_root_installs_a_browser(
    build: ModuleType, bare: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    program(bare / "apt-get", f': > "{bare}/chromium"')
    monkeypatch.setattr(build.os, "geteuid", lambda: 1000)
    build.install_browser()
    assert not (bare / "chromium").exists()
    said = capsys.readouterr().out
    assert "sudo apt-get install -y --no-install-recommends chromium" in said
    assert "will be skipped" in said


@needs_sh
def test_a_named_browser_is_enough(build: ModuleType, bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program(bare / "apt-get", f': > "{bare}/chromium"')
    monkeypatch.setenv("CHROMIUM", "/opt/my/browser")
    build.install_browser()
    assert not (bare / "chromium").exists()


@needs_sh
def test_the_tests_look_for_the_same_browsers(build: ModuleType, bare: Path) -> None:
    from tests.solver.report.browser import find_chromium

    assert build.find_browser() is None
    assert find_chromium() is None
    for name in reversed(build.BROWSERS):
        program(bare / name)
        assert find_chromium() == build.find_browser() == str(bare / name)


def test_unknown_blender_is_refused(build: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert build.main(["test", "--blender", "1.0"]) == 2
    assert "choose one of 4.2" in capsys.readouterr().err


def test_blender_without_its_python_is_skipped(
    build: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(build, "find_python", lambda _version: None)
    assert build.main(["test", "--blender", "5.2"]) == 0
    assert "Blender 5.2: skipped" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["demo", "test", "extension", "clean"])
def test_commands_have_help(repo_root: Path, command: str) -> None:
    done = subprocess.run([sys.executable, repo_root / "build.py", command, "--help"], check=True, capture_output=True)
    assert command in done.stdout.decode()


def test_clean_removes_only_what_was_built(build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (".venv", ".venv-bpy-4.2", "out", "dist", "build", "core_solver"):
        (tmp_path / name).mkdir()
    monkeypatch.setattr(build, "ROOT", tmp_path)
    assert build.main(["clean"]) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["core_solver"]


@pytest.fixture
def fake_demo(build: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The demo in an empty root, with commands that only note their names and touch their results."""
    ran: list[str] = []

    def run(words: list[str | Path], environment: object = None) -> None:
        ran.append(next(str(w) for w in words if str(w) in {"models", "solve", "preview"} or "batch" in str(w)))
        for name in () if "models" in words else ("take.npz", "scene.glb", "overlay.mp4", "overview.png"):
            (tmp_path / "out" / "demo" / name).touch()

    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).touch()
    (tmp_path / "core_solver").mkdir()
    monkeypatch.setattr(build, "ROOT", tmp_path)
    monkeypatch.setattr(build, "CONSTRAINTS", tmp_path / "constraints.txt")
    monkeypatch.setattr(build, "main_environment", lambda: tmp_path / "python")
    monkeypatch.setattr(build, "answer", lambda words: str(tmp_path / "models" / words[-1]))
    monkeypatch.setattr(build, "run", run)
    return ran


def test_demo_again_does_nothing(build: ModuleType, fake_demo: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert build.main(["demo"]) == 0
    assert len(fake_demo) == 4
    fake_demo.clear()
    assert build.main(["demo"]) == 0
    assert fake_demo == ["models"]
    assert "Nothing has changed" in capsys.readouterr().out


@pytest.mark.parametrize("change", ["result", "source", "models"])
def test_demo_is_made_again_when_something_changed(
    build: ModuleType, fake_demo: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: str
) -> None:
    build.main(["demo"])
    fake_demo.clear()
    if change == "result":
        (tmp_path / "out" / "demo" / "scene.glb").unlink()
    elif change == "source":
        (tmp_path / "core_solver" / "new.py").write_text("new = True")
    else:
        monkeypatch.setattr(build, "answer", lambda _words: "a depth network was added")
    build.main(["demo"])
    assert len(fake_demo) == 4


def test_an_interrupted_demo_is_not_taken_for_finished(
    build: ModuleType, fake_demo: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    build.main(["demo"])
    (tmp_path / "core_solver" / "new.py").write_text("new = True")

    def stop(*_arguments: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(build, "make_results", stop)
        assert build.main(["demo"]) == 130
    (tmp_path / "core_solver" / "new.py").unlink()
    fake_demo.clear()
    build.main(["demo"])
    assert len(fake_demo) == 4
