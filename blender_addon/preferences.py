# SPDX-License-Identifier: GPL-3.0-or-later
"""What is set once per computer."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

import bpy

from core_solver.errors import UserError

from .solving.python import find_python, solver_version

rpt_ = bpy.app.translations.pgettext_rpt


def _forget_check(preferences: "MocapPreferences", _context: bpy.types.Context) -> None:
    preferences.solver_found = ""


class MocapPreferences(bpy.types.AddonPreferences):
    bl_idname = __package__ or ""

    solver_python: bpy.props.StringProperty(
        name="Solver's Python",
        description="The Python in which the solver is installed, or the folder of its environment (.venv). "
        "Solve Video runs it as a program of its own",
        subtype="FILE_PATH",
        update=_forget_check,
    )
    solver_found: bpy.props.StringProperty(options={"HIDDEN", "SKIP_SAVE"})
    export_directory: bpy.props.StringProperty(
        name="Export Folder",
        description="Where exports go when no other folder is chosen; empty to be asked",
        subtype="DIR_PATH",
    )

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        row = layout.row(align=True)
        row.prop(self, "solver_python")
        row.operator(CheckSolver.bl_idname, text="Check")
        if self.solver_found:
            layout.label(text=self.solver_found, icon="INFO", translate=False)
        layout.prop(self, "export_directory")


class CheckSolver(bpy.types.Operator):
    """Run the chosen Python once and see whether it has the solver; takes seconds the first time"""

    bl_idname = "scene_aware_mocap.check_solver"
    bl_label = "Check the Solver"

    def execute(self, context: bpy.types.Context) -> set[str]:
        preferences = preferences_of(context)
        try:
            python = find_python(bpy.path.abspath(preferences.solver_python))
            preferences.solver_found = rpt_("Solver {} found").format(solver_version(python))
        except UserError as error:
            preferences.solver_found = str(error)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, preferences.solver_found)
        return {"FINISHED"}


def preferences_of(context: bpy.types.Context) -> MocapPreferences:
    """This extension's preferences; it must be enabled."""
    return context.preferences.addons[__package__].preferences
