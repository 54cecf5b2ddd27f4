# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > Scene-Aware Mocap (.npz)."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from core_solver.errors import UserError
from core_solver.take import read_take

from ..scene_import.take_import import ImportOptions, import_take


class ImportTake(bpy.types.Operator, ImportHelper):
    """Bring in a take: every person in one metric scene, the camera over its footage, and the scene's points"""

    bl_idname = "import_scene.scene_aware_mocap"
    bl_label = "Import Scene-Aware Mocap (.npz)"
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    filename_ext = ".npz"
    filter_glob: bpy.props.StringProperty(default="*.npz", options={"HIDDEN"})
    body: bpy.props.BoolProperty(name="Bodies", description="Each person's skinned mesh", default=True)
    camera: bpy.props.BoolProperty(
        name="Camera and Footage",
        description="The camera that matches the video, with the video behind; becomes the scene's camera",
        default=True,
    )
    cloud: bpy.props.BoolProperty(name="Scene Points", description="The static scene as coloured points", default=True)
    hide_absent: bpy.props.BoolProperty(
        name="Hide When Away",
        description="Hide people before they are first seen and after they are last seen. GLB and FBX hide nobody: "
        "there such a person stands still, and present_from_s and present_until_s tell a game when to show them",
        default=True,
    )
    footage: bpy.props.StringProperty(
        name="Footage",
        description="The video or the folder it is in; empty to look beside the take",
        subtype="FILE_PATH",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        path = Path(self.filepath)
        try:
            take = read_take(path)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        options = ImportOptions(
            cloud=self.cloud,
            camera=self.camera,
            body=self.body,
            footage=self.footage,
            hide_absent=self.hide_absent,
        )
        imported = import_take(context, take, path, options)
        for note in imported.notes:
            self.report({"WARNING"}, note)
        self.report({"INFO"}, f"Imported {len(imported.armatures)} people, {take.frame_count} frames from frame 1")
        return {"FINISHED"}


def draw_import_entry(menu: bpy.types.Menu, _context: bpy.types.Context) -> None:
    menu.layout.operator(ImportTake.bl_idname, text="Scene-Aware Mocap (.npz)")
