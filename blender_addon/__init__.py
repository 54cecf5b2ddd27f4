# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene-Aware Mocap in Blender: brings a take in as people, camera, footage and scene. Registration only."""

import bpy

from .operators.import_take import ImportTake, draw_import_entry
from .panels.sidebar import MocapPanel

_CLASSES = (ImportTake, MocapPanel)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    bpy.types.TOPBAR_MT_file_import.append(draw_import_entry)


def unregister() -> None:
    bpy.types.TOPBAR_MT_file_import.remove(draw_import_entry)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
