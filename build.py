"""Task runner: `python build.py demo | test | extension | clean`. Standard library only; runs on a bare machine.

Everything is installed into `.venv` beside this file, in the versions of constraints.txt. A second run finds the
environment's stamp and changes nothing.
"""

from __future__ import annotations

import argparse
import ctypes
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping, Sequence

ROOT = Path(__file__).resolve().parent
CONSTRAINTS = ROOT / "constraints.txt"
STAMP = ".stamp"
PYTHON = "3.11"  # the last Python for which both bpy and torch of constraints.txt exist
MODELS = ("movenet-multipose", "blazepose-full", "open-body")
CLIP = "lab-two-people"
CLIP_CAMERA = "cam01"
TORCH_CPU_INDEX = "https://download.pytorch.org/whl/cpu"
EPOCH = (1980, 1, 1, 0, 0, 0)  # the date of every file in the extension, so that the same sources give the same bytes
TESTS_IN_BLENDER = ("tests/addon", "tests/solver/take", "tests/solver/geometry/test_frames.py")

# Libraries that `import bpy` loads on Linux, and the Debian package of each.
SYSTEM_LIBRARIES = {
    "libX11.so.6": "libx11-6", "libXext.so.6": "libxext6",
    "libXfixes.so.3": "libxfixes3", "libXi.so.6": "libxi6",
    "libXrender.so.1": "libxrender1", "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6", "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1", "libEGL.so.1": "libegl1",
    "libXxf86vm.so.1": "libxxf86vm1", "libgomp.so.1": "libgomp1",
}  # fmt: skip

# Programs with which the tests of the report's page run.
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


@dataclass(frozen=True)
class Blender:
    """A Blender that exists as a Python package: the Python it is made for and the numpy it accepts."""

    python: str
    numpy: str


BLENDERS = {
    "4.2": Blender("3.11", "numpy==1.26.4"),
    "4.5": Blender("3.11", "numpy==1.26.4"),
    "5.0": Blender("3.11", "numpy==1.26.4"),
    "5.2": Blender("3.13", "numpy>=2.2,<3"),
}


class BuildError(Exception):
    """Something the user can mend; the message says how."""


def run(command: Sequence[str | Path], environment: Mapping[str, str] | None = None) -> None:
    """Show and run a command.

    Raises:
        BuildError: it failed.
    """
    words = [str(word) for word in command]
    print("+", " ".join(words), flush=True)
    if subprocess.run(words, cwd=ROOT, check=False, env=environment).returncode:
        raise BuildError(f"this command failed, its own message is above: {' '.join(words)}")


def answer(command: Sequence[str | Path]) -> str | None:
    """What a command prints, or None when it cannot be run or fails."""
    try:
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, cwd=ROOT)
    except OSError:
        return None
    return done.stdout.strip() if done.returncode == 0 else None


# --- environments ----------------------------------------------------------------------------------------------------


def find_python(version: str) -> str | None:
    """An interpreter of that version: this one, else one on the path, Windows' launcher or pyenv."""
    probe = "import sys; print(sys.executable if sys.version.startswith(sys.argv[1] + '.') else '')"
    candidates: list[list[str]] = [[sys.executable], [f"python{version}"], ["py", f"-{version}"]]
    candidates += [[str(python)] for python in sorted(Path.home().glob(f".pyenv/versions/{version}.*/bin/python"))]
    for candidate in candidates:
        found = answer([*candidate, "-c", probe, version])
        if found:
            return found
    return None


def in_environment(folder: Path, program: str = "python") -> Path:
    """A program of a virtual environment."""
    return folder / "Scripts" / f"{program}.exe" if os.name == "nt" else folder / "bin" / program


def fingerprint(*parts: str) -> str:
    """What an environment was made from: the given words, the package's description and the constraints."""
    digest = hashlib.sha256("\n".join(parts).encode())
    for file in (ROOT / "pyproject.toml", CONSTRAINTS):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def is_ready(folder: Path, stamp: str) -> bool:
    """Whether an environment was finished with this fingerprint and still has its Python."""
    file = folder / STAMP
    return file.is_file() and file.read_text() == stamp and in_environment(folder).exists()


def make_environment(folder: Path, python: str, stamp: str, install: Callable[[Path], None]) -> Path:
    """Create an environment unless it is ready, and give its Python. The stamp is written last."""
    inner = in_environment(folder)
    if is_ready(folder, stamp):
        return inner
    if answer([inner, "-m", "pip", "--version"]) is None:
        try:
            run([python, "-m", "venv", "--clear", folder])
        except BuildError as error:
            raise BuildError(f"{error}\nOn Debian and Ubuntu: sudo apt-get install -y python{PYTHON}-venv") from None
    (folder / STAMP).unlink(missing_ok=True)
    install(inner)
    (folder / STAMP).write_text(stamp)
    return inner


def pip_install(python: Path, *arguments: str) -> None:
    """Install into an environment, in the tested versions."""
    run([python, "-m", "pip", "install", "--disable-pip-version-check", *arguments])


def main_environment() -> Path:
    """`.venv` with the package, bpy and the development tools; gives its Python."""
    python = find_python(PYTHON)
    if python is None:
        raise BuildError(
            f"Python {PYTHON} is needed (Blender's own; this is {sys.version.split()[0]}): install it from "
            f"https://www.python.org/downloads/ or with 'sudo apt-get install -y python{PYTHON} python{PYTHON}-venv', "
            f"then run python{PYTHON} build.py"
        )
    install_system_libraries()

    def install(inner: Path) -> None:
        install_small_torch(inner)
        pip_install(inner, "--constraint", str(CONSTRAINTS), "--editable", f"{ROOT}[blender,benchmarks,dev]")

    return make_environment(ROOT / ".venv", python, fingerprint("main", PYTHON), install)


def install_small_torch(python: Path) -> None:
    """On Linux without an NVIDIA card take PyTorch's CPU build: the registry's own brings gigabytes of CUDA."""
    if sys.platform != "linux" or shutil.which("nvidia-smi") or not answers(TORCH_CPU_INDEX + "/torch/"):
        return
    version = next(line for line in CONSTRAINTS.read_text().splitlines() if line.startswith("torch=="))
    pip_install(python, "--no-deps", "--index-url", TORCH_CPU_INDEX, version)


def answers(address: str) -> bool:
    """Whether an https address can be reached."""
    try:
        with urllib.request.urlopen(address, timeout=10):  # noqa: S310  (a constant https address)
            return True
    except OSError:
        return False


def blender_environment(version: str) -> Path | None:
    """`.venv-bpy-X.Y` with that Blender, numpy and the test tools; None when its Python is missing here."""
    if version not in BLENDERS:
        raise BuildError(f"no Blender {version} is known: choose one of {', '.join(BLENDERS)}")
    blender = BLENDERS[version]
    python = find_python(blender.python)
    if python is None:
        return None
    install_system_libraries()

    def install(inner: Path) -> None:
        pip_install(inner, f"bpy=={version}.*", blender.numpy, "pytest", "hypothesis")
        pip_install(inner, "--no-deps", "--editable", str(ROOT))

    return make_environment(ROOT / f".venv-bpy-{version}", python, fingerprint(version, repr(blender)), install)


def missing_system_libraries() -> list[str]:
    """Debian packages of the libraries that cannot be loaded here."""
    if sys.platform != "linux":
        return []
    return [package for library, package in SYSTEM_LIBRARIES.items() if not loads(library)]


def loads(library: str) -> bool:
    """Whether the system has a shared library."""
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def install_system_libraries() -> None:
    """Install what `import bpy` needs when that is allowed, else say the one command that does."""
    missing = missing_system_libraries()
    if missing:
        apt_install(missing, "bpy needs system libraries")


def apt_install(packages: Sequence[str], need: str) -> None:
    """Install packages of Debian's and Ubuntu's names, as root.

    Raises:
        BuildError: that is not possible here; the message says what is needed and how to get it.
    """
    command = ["apt-get", "install", "-y", "--no-install-recommends", *packages]
    if shutil.which("apt-get") is None:
        raise BuildError(f"{need}; install what Debian calls {', '.join(packages)}")
    if os.geteuid() != 0:
        raise BuildError(f"{need}; run this once: sudo {' '.join(command)}")
    run(["apt-get", "update"])
    run(command, os.environ | {"DEBIAN_FRONTEND": "noninteractive"})


def find_browser() -> str | None:
    """A Chromium: the environment's CHROMIUM, or a program of one of the usual names."""
    return os.environ.get("CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)


def install_browser() -> None:
    """Install a Chromium when that is allowed; without one the tests of the report's page are skipped."""
    if find_browser() is None:
        try:
            apt_install(["chromium"], "there is no Chromium")
        except BuildError as error:
            print(f"{error}\nThe tests of the report's page will be skipped.", flush=True)


# --- demo ------------------------------------------------------------------------------------------------------------


@contextmanager
def timed(stage: str, times: dict[str, float]) -> Iterator[None]:
    """Announce a stage and note its seconds."""
    print(f"\n== {stage}", flush=True)
    start = time.monotonic()
    yield
    times[stage] = time.monotonic() - start


def demo(_: argparse.Namespace) -> int:
    """Fetch the models and a clip of two people, solve it, draw it and write a GLB, all into out/demo."""
    times: dict[str, float] = {}
    target = ROOT / "out" / "demo"
    results = tuple(target / name for name in ("take.npz", "scene.glb", "overlay.mp4", "overview.png"))
    with timed("set up", times):
        python = main_environment()
        target.mkdir(parents=True, exist_ok=True)
    program = in_environment(ROOT / ".venv", "scene-aware-mocap")
    with timed("fetch", times):
        run([program, "models", "fetch", *MODELS, CLIP])
    stamp = target / STAMP
    made_from = fingerprint("demo", answer([program, "models", "list"]) or "", *sources())
    if all(file.is_file() for file in results) and stamp.is_file() and stamp.read_text() == made_from:
        print("\nNothing has changed since the results were made: remove out/demo to make them again.")
    else:
        stamp.unlink(missing_ok=True)
        make_results(python, program, target, times)
        stamp.write_text(made_from)
    print("\nTime per stage")
    for stage, seconds in times.items():
        print(f"  {stage:10}{seconds:8.1f} s")
    print("Results")
    for file in results:
        print(f"  {file.relative_to(ROOT)}  {file.stat().st_size / 1e6:.1f} MB")
    return 0


def make_results(python: Path, program: Path, target: Path, times: dict[str, float]) -> None:
    """Solve the clip, draw it and write the GLB."""
    take = target / "take.npz"
    clip = Path(answer([program, "models", "path", CLIP]) or "")
    camera = f"{clip.with_name('Calib.qca.txt')}:{CLIP_CAMERA}"
    with timed("solve", times):
        run([program, "solve", clip, "-o", take, "--camera", camera, "--people", "2"])
    with timed("preview", times):
        run([program, "preview", take, clip, "-o", target])
    with timed("export", times):
        run([python, ROOT / "blender_addon" / "batch.py", "--", "--take", take, "--out", target / "scene.glb"])


def sources() -> list[str]:
    """The text of everything that decides what the demo makes."""
    folders = (ROOT / "core_solver", ROOT / "blender_addon")
    files = sorted(file for folder in folders for kind in ("*.py", "*.toml") for file in folder.rglob(kind))
    return [file.read_text(encoding="utf-8") for file in files]


# --- test ------------------------------------------------------------------------------------------------------------


def test(arguments: argparse.Namespace) -> int:
    """Run the tests: all of them in `.venv`, or the Blender ones in each Blender that is named."""
    extra = [word for word in arguments.pytest if word != "--"]
    if not arguments.blender:
        python = main_environment()
        install_browser()
        return pytest_in(python, extra)
    results = {version: test_in_blender(version, extra) for version in arguments.blender}
    print()
    for version, code in results.items():
        print(f"Blender {version}: {'skipped, its Python is missing' if code is None else f'exit code {code}'}")
    return max(code or 0 for code in results.values())


def test_in_blender(version: str, extra: Sequence[str]) -> int | None:
    """Run the tests that Blender's own Python must pass; None when that Python is not on this computer."""
    print(f"\n== Blender {version}", flush=True)
    python = blender_environment(version)
    if python is None:
        print(f"skipped: Blender {version} needs Python {BLENDERS[version].python}, which is not here")
        return None
    folders = [place for place in TESTS_IN_BLENDER if (ROOT / place).exists()]
    return pytest_in(python, [*folders, *extra])


def pytest_in(python: Path, arguments: Sequence[str]) -> int:
    """Run pytest and give its exit code; a crash by a signal counts as failure."""
    command = [str(python), "-m", "pytest", *arguments]
    print("+", " ".join(command), flush=True)
    return abs(subprocess.run(command, cwd=ROOT, check=False).returncode)


# --- extension -------------------------------------------------------------------------------------------------------


def extension(_: argparse.Namespace) -> int:
    """Build the Blender extension."""
    print(f"built {stage_extension(ROOT / 'dist')}")
    return 0


def stage_extension(dist_dir: Path) -> Path:
    """Build the extension's zip in a directory and give its path.

    The solver travels as a wheel inside, which Blender unpacks by itself: one source of the take format, no copies.

    Raises:
        BuildError: the wheel cannot be built, or the manifest is not as expected.
    """
    dist_dir.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".staging-", dir=dist_dir) as staging:
        staged = Path(staging) / "extension"
        shutil.copytree(ROOT / "blender_addon", staged, ignore=shutil.ignore_patterns("__pycache__", "*.pyc"))
        shutil.copy(ROOT / "LICENSES" / "GPL-3.0-or-later.txt", staged / "LICENSE")
        wheel = build_wheel(staged / "wheels")
        version = name_wheel(staged / "blender_manifest.toml", wheel.name)
        finished = dist_dir / f"scene_aware_mocap-{version}.zip"
        temporary = write_zip(staged, Path(staging) / finished.name)
        temporary.replace(finished)
    return finished


def build_wheel(folder: Path) -> Path:
    """Build the solver's wheel into a folder."""
    environment = in_environment(ROOT / ".venv")
    python = environment if environment.exists() else Path(sys.executable)
    run([python, "-m", "pip", "wheel", "--disable-pip-version-check", "--quiet", "--no-deps", ROOT, "-w", folder])
    return next(folder.glob("*.whl"))


def name_wheel(manifest: Path, wheel: str) -> str:
    """Write the wheel's name into a manifest that has an empty list for it; gives the extension's version."""
    text = manifest.read_text(encoding="utf-8")
    empty = "\nwheels = []\n"
    if text.count(empty) != 1:
        raise BuildError(f"{manifest.name} must hold the line 'wheels = []' once")
    text = text.replace(empty, f'\nwheels = ["./wheels/{wheel}"]\n')
    manifest.write_bytes(text.encode())
    return next(line.split('"')[1] for line in text.splitlines() if line.startswith("version = "))


def write_zip(folder: Path, target: Path) -> Path:
    """Zip a folder's files in alphabetical order with fixed dates and rights: same sources, same bytes."""
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(file for file in folder.rglob("*") if file.is_file()):
            entry = zipfile.ZipInfo(file.relative_to(folder).as_posix(), EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, file.read_bytes())
    return target


# --- clean and command line ------------------------------------------------------------------------------------------


def clean(_: argparse.Namespace) -> int:
    """Remove environments and everything built. Fetched models stay in the user's cache."""
    for folder in (*ROOT.glob(".venv*"), ROOT / "out", ROOT / "dist", ROOT / "build"):
        if folder.is_dir():
            print(f"removing {folder.relative_to(ROOT)}")
            shutil.rmtree(folder)
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    commands = argparse.ArgumentParser(prog="build.py", description="Set up, try and test Scene-Aware Mocap.")
    actions = commands.add_subparsers(dest="command", required=True)
    for name, action in (("demo", demo), ("test", test), ("extension", extension), ("clean", clean)):
        purpose = (action.__doc__ or "").splitlines()[0]
        sub = actions.add_parser(name, help=purpose, description=purpose)
        sub.set_defaults(action=action)
        if action is test:
            sub.add_argument(
                "--blender", action="append", metavar="X.Y", help=f"one of {', '.join(BLENDERS)}; repeatable"
            )
            sub.add_argument("pytest", nargs=argparse.REMAINDER, help="after --: arguments for pytest")
    return commands


def main(words: Sequence[str] | None = None) -> int:
    """Run one command; gives the exit code."""
    arguments = parser().parse_args(words)
    try:
        return arguments.action(arguments)
    except BuildError as error:
        print(f"\nbuild.py: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("\nbuild.py: stopped; run the same command again to go on", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
