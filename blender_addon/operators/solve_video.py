# SPDX-License-Identifier: GPL-3.0-or-later
"""Solve Video: from footage to a take, by the solver in its own Python."""

import bpy

from core_solver.errors import UserError

from ..preferences import preferences_of
from ..settings.solve import SolveInputs, request_of
from ..solving import watch
from ..solving.process import SolverProcess
from ..solving.python import find_python

rpt_ = bpy.app.translations.pgettext_rpt


class SolveVideo(SolveInputs, bpy.types.Operator):
    """Solve a video into a take. Blender stays usable meanwhile; without a window it waits for the end"""

    bl_idname = "scene_aware_mocap.solve_video"
    bl_label = "Solve Video"

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            python = find_python(bpy.path.abspath(preferences_of(context).solver_python))
            request = request_of(self)
            if not bpy.app.background:
                watch.begin(python, request, import_result=self.import_result)
                self.report({"INFO"}, rpt_("Solving {}: the sidebar shows how far it is").format(request.video.name))
                return {"FINISHED"}
            process = SolverProcess(python, request)
            process.wait()
            watch.show_log(process.lines)
            process.check()
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if self.import_result:
            watch.import_take(request)
        self.report({"INFO"}, rpt_("Solved: {}").format(request.take.name))
        return {"FINISHED"}


class CancelSolve(bpy.types.Operator):
    """Stop the solver. What it has found out so far stays beside the take, for Resume; an older take stays as it is"""

    bl_idname = "scene_aware_mocap.cancel_solve"
    bl_label = "Cancel the Solve"

    @classmethod
    def poll(cls, _context: bpy.types.Context) -> bool:
        return watch.current() is not None

    def execute(self, _context: bpy.types.Context) -> set[str]:
        running = watch.current()
        if running is not None:
            running.process.cancel()
        return {"FINISHED"}
