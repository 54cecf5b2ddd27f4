# SPDX-License-Identifier: GPL-3.0-or-later
"""`blender -c scene_aware_mocap ...`: the batch as a command of Blender's own."""

import sys
from typing import Any

import bpy

NAME = "scene_aware_mocap"
_handles: list[Any] = []


def run_command(words: list[str]) -> int:
    """What Blender calls with the words after the command's name; gives the exit code."""
    # Only who asks for a batch waits for its modules.
    from .command import main

    code = main(words, f"blender -c {NAME}")
    sys.stdout.flush()
    sys.stderr.flush()
    return code


def register_command() -> None:
    """Make the command known."""
    _handles.append(bpy.utils.register_cli_command(NAME, run_command))


def unregister_command() -> None:
    """Take it back."""
    while _handles:
        bpy.utils.unregister_cli_command(_handles.pop())
