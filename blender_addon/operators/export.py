# SPDX-License-Identifier: GPL-3.0-or-later
"""Export: characters to files for an engine, read back and compared."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from pathlib import Path

import bpy

from core_solver.errors import UserError

from ..export.exporting import export_characters
from ..export.performance import Character, ExportError, characters_among
from ..preferences import preferences_of
from ..rig.evidence import never_there
from ..settings.export import TAKES_RELATIVE, ExportInputs, profile_of, show_checks, summary
from .names import listed_names

rpt_ = bpy.app.translations.pgettext_rpt


class Export(ExportInputs, bpy.types.Operator):
    bl_idname = "scene_aware_mocap.export"
    bl_label = "Export Characters"
    bl_description = (
        "Write the selected characters, or all of the scene, over the scene's frames to files for a game engine, and "
        "read every file back to compare it. The scene stays as it is; old files of the same names are replaced"
    )
    bl_options = {"REGISTER"}  # noqa: RUF012 - Blender reads this class attribute

    directory: bpy.props.StringProperty(
        name="Folder",
        description="Where the files go; // is the folder of this Blender file",
        subtype="DIR_PATH",
        options=TAKES_RELATIVE,
    )
    file_name: bpy.props.StringProperty(name="Name", description="Of the files, without ending", default="scene")
    characters: bpy.props.StringProperty(
        name="Characters",
        description="Names of the armatures, with commas between; empty for those selected, or else for all that move",
    )

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if self.directory or preferences_of(context).export_directory:
            return self.execute(context)
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        camera = context.scene.camera if self.camera else None
        try:
            done = export_characters(
                context, self._chosen(context), profile_of(self), self._folder(context), self.file_name, camera
            )
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        show_checks(context.scene.mocap_export, done.checks)
        for check in done.checks:
            if not check.passed:
                self.report({"WARNING"}, rpt_("{} in {} {}").format(check.character, check.file, summary(check)))
        if done.passed:
            worst = max(check.joint_error_m for check in done.checks)
            names = ", ".join(path.name for path in done.files)
            message = rpt_("Wrote {} and read it back: joints within {:.3f} mm")
            self.report({"INFO"}, message.format(names, 1000 * worst))
        return {"FINISHED"}

    def _chosen(self, context: bpy.types.Context) -> tuple[Character, ...]:
        names = listed_names(context, self.characters)
        missing = [name for name in names if name not in context.scene.objects]
        if missing:
            raise ExportError(f"there is no object '{missing[0]}' in this scene: check the name")
        if names:
            return characters_among(context, [context.scene.objects[name] for name in names])
        selected = [obj for obj in context.view_layer.objects if obj.select_get()]
        moving = [obj for obj in context.view_layer.objects if obj.type == "ARMATURE" and obj.animation_data]
        likely = characters_among(context, selected) or characters_among(context, moving)
        return tuple(character for character in likely if not never_there(character.armature))

    def _folder(self, context: bpy.types.Context) -> Path:
        folder = self.directory or preferences_of(context).export_directory
        if not folder:
            raise ExportError("no folder to export to: choose one")
        if folder.startswith("//") and not bpy.data.filepath:
            raise ExportError("this Blender file has no folder yet: save it first, or choose another folder")
        return Path(bpy.path.abspath(folder))
