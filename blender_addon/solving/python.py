# SPDX-License-Identifier: GPL-3.0-or-later
"""The Python that has the solver. No Blender in here."""

import os
import subprocess
import sys
from pathlib import Path

from core_solver.errors import UserError

MODULE = "core_solver.cli"
_INSTALL = "install the solver there with 'python build.py demo', or 'pip install' its folder"
_SECONDS = 60.0  # a cold disk and a virus scanner are slow
NO_WINDOW = subprocess.CREATE_NO_WINDOW if sys.platform == "win32" else 0
"""`creationflags` that keep Windows from opening a black window."""
_IN_ENVIRONMENT = ("bin/python", "bin/python3", "Scripts/python.exe", "python.exe")


class SolverError(UserError):
    """The solver cannot be run, or has failed."""


def find_python(place: str) -> Path:
    """The interpreter that a user means by its own path or by its environment's folder.

    Raises:
        SolverError: there is none.
    """
    if not place:
        raise SolverError("no Python with the solver is chosen: set it in the preferences of Scene-Aware Mocap")
    # Made absolute without following links: an environment's python is a link, and followed it forgets its packages.
    path = Path(place).expanduser().absolute()
    candidates = [path / name for name in _IN_ENVIRONMENT] if path.is_dir() else [path]
    found = next((candidate for candidate in candidates if candidate.is_file()), None)
    if found is None:
        raise SolverError(f"there is no Python at {path}: choose the interpreter or its environment's folder")
    return found


def solver_version(python: Path) -> str:
    """The version of the solver that a Python has.

    Raises:
        SolverError: it has none, or does not run; says how to install it.
    """
    command = [str(python), "-m", MODULE, "--version"]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
            timeout=_SECONDS,
            env=environment(),
            creationflags=NO_WINDOW,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SolverError(f"{python} does not run: {error}") from error
    if done.returncode or not done.stdout.strip():
        raise SolverError(f"{python} has no solver: {_INSTALL}")
    return done.stdout.split()[-1]


def environment() -> dict[str, str]:
    """The child's environment: it speaks UTF-8 and at once, and finds no modules in the folder it happens to be in."""
    return {**os.environ, "PYTHONUTF8": "1", "PYTHONUNBUFFERED": "1", "PYTHONSAFEPATH": "1"}
