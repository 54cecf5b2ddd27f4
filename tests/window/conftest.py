"""A Blender with a window: the program, a display that nobody sees, and the extension installed."""

import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.addon.conftest import extension_zip

__all__ = ["extension_zip"]

OLDEST = (4, 3)
SIZE = (1600, 1000)
SECONDS = 240
STEPS = Path(__file__).parent / "inside" / "steps.py"
INSTALL = """
import bpy, sys
bpy.ops.extensions.package_install_files(filepath=sys.argv[-1], repo="user_default", enable_on_install=True)
bpy.context.preferences.view.show_splash = False
bpy.context.preferences.use_preferences_save = False  # what one test chooses is not the next one's
bpy.ops.wm.save_userpref()
"""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    here = Path(__file__).parent
    for item in items:
        if here in item.path.parents:
            item.add_marker(pytest.mark.window)


@pytest.fixture(scope="session")
def blender_program() -> str:
    program = os.environ.get("BLENDER") or shutil.which("blender")
    if program is None or shutil.which("Xvfb") is None:
        pytest.skip("no Blender or no Xvfb on this computer")
    said = subprocess.run([program, "--version"], capture_output=True, text=True, check=False).stdout
    version = re.search(r"Blender (\d+)\.(\d+)", said)
    if version is None or (int(version[1]), int(version[2])) < OLDEST:
        pytest.skip(f"{program} is no Blender {OLDEST[0]}.{OLDEST[1]} or newer")
    return program


@pytest.fixture(scope="session")
def display(blender_program: str, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[str, Path]]:
    """Name of a display and the file in which its picture lies."""
    folder = tmp_path_factory.mktemp("display")
    name = f":{90 + os.getpid() % 900}"
    screen = f"{SIZE[0]}x{SIZE[1]}x24"
    server = subprocess.Popen(
        ["Xvfb", name, "-screen", "0", screen, "-fbdir", str(folder), "-nolisten", "tcp", "-nocursor"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    picture = folder / "Xvfb_screen0"
    for _ in range(100):
        if picture.exists():
            break
        time.sleep(0.1)
    else:
        pytest.skip("Xvfb does not start")
    yield name, picture
    server.terminate()
    server.wait()


@dataclass(frozen=True)
class Window:
    """Runs steps in a Blender with a window.

    Attributes:
        program: Blender.
        environment: of the process: the display, the user's folder with the extension, where screenshots go.
        shots: folder of the screenshots.
    """

    program: str
    environment: dict[str, str]
    shots: Path

    def run(self, steps: str, **more: str) -> str:
        """Run one generator of `inside/steps.py`; gives what Blender said. Fails when a step or the console complains.

        Args:
            steps: name of the generator.
            more: environment variables for it.
        """
        geometry = ["--window-geometry", "0", "0", *map(str, SIZE)]
        command = [self.program, "--enable-event-simulate", *geometry, "--python", str(STEPS), "--", steps]
        done = subprocess.run(
            command,
            capture_output=True,
            text=True,
            check=False,
            timeout=SECONDS,
            env=self.environment | more,
        )
        said = done.stdout + done.stderr
        assert "STEPS DONE" in said, said
        assert "Traceback" not in said, said
        assert done.returncode == 0, said
        return said


@pytest.fixture(scope="session")
def window(
    blender_program: str,
    display: tuple[str, Path],
    extension_zip: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> Window:
    name, picture = display
    shots = Path(os.environ.get("WINDOW_SHOTS") or tmp_path_factory.mktemp("shots"))
    shots.mkdir(parents=True, exist_ok=True)
    user = tmp_path_factory.mktemp("user")
    environment = {
        **os.environ,
        "DISPLAY": name,
        "BLENDER_USER_RESOURCES": str(user),
        "WINDOW_PICTURE": str(picture),
        "WINDOW_SHOTS": str(shots),
    }
    script = user / "install.py"
    script.write_text(INSTALL)
    done = subprocess.run(
        [blender_program, "-b", "--python-exit-code", "1", "--python", str(script), "--", str(extension_zip)],
        capture_output=True,
        text=True,
        check=False,
        env=environment,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return Window(blender_program, environment, shots)
