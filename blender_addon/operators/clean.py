# SPDX-License-Identifier: GPL-3.0-or-later
"""Clean: make people's motion better, each operation as a new action or NLA layer."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from typing import Any

import bpy

from core_solver.errors import UserError

from ..clean.key_reduction import Bound
from ..rig import cleaning
from ..rig.layers import people_of
from ..settings.clean import BlendInput, DriftInputs, FillInputs, KeyInputs, ResultInput, SmoothInputs, SurfaceInput
from .names import listed_names

rpt_ = bpy.app.translations.pgettext_rpt

_OFTEN = 0.01  # seconds between two parts of the work, in which the window answers


class CleanOperator(ResultInput):
    """Works through people: straight on in scripts, part by part in a window, where Esc stops it."""

    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    note_kind = "WARNING"

    people: bpy.props.StringProperty(
        name="People",
        description="Names of armatures with commas between them; when empty those selected, or else all people",
    )

    def execute(self, context: bpy.types.Context) -> set[str]:
        windows = context.window_manager
        windows.progress_begin(0.0, 1.0)
        try:
            cleaned = cleaning.finish(self._work(context), windows.progress_update)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        finally:
            windows.progress_end()
        return self._done(cleaned)

    def invoke(self, context: bpy.types.Context, _event: bpy.types.Event) -> set[str]:
        if context.window is None:
            return self.execute(context)
        self.working = self._work(context)
        windows = context.window_manager
        self.timer = windows.event_timer_add(_OFTEN, window=context.window)
        windows.progress_begin(0.0, 1.0)
        windows.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        if event.type == "ESC":
            self._end(context)
            self.report({"INFO"}, rpt_("Stopped: nothing has changed"))
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"RUNNING_MODAL"}
        try:
            context.window_manager.progress_update(next(self.working))
        except StopIteration as end:
            self._end(context)
            return self._done(end.value)
        except UserError as error:
            self._end(context)
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"RUNNING_MODAL"}

    def cancel(self, context: bpy.types.Context) -> None:
        self._end(context)

    def work(self, context: bpy.types.Context, people: list[bpy.types.Object]) -> cleaning.Work:
        """What is to be done."""
        return cleaning.clean(context, people, [self.step()], self.result)

    def step(self) -> cleaning.Step:
        """The one step of an operator that does not override `work`."""
        raise NotImplementedError

    def _work(self, context: bpy.types.Context) -> cleaning.Work:
        return (yield from self.work(context, people_of(context, listed_names(context, self.people))))

    def _end(self, context: bpy.types.Context) -> None:
        self.working.close()
        context.window_manager.event_timer_remove(self.timer)
        context.window_manager.progress_end()

    def _done(self: Any, cleaned: cleaning.Cleaned) -> set[str]:
        for note in cleaned.notes:
            self.report({self.note_kind}, note)
        self.report({"INFO"}, rpt_("{}: {} done").format(rpt_(self.bl_label), cleaned.count))
        return {"FINISHED"}


class SmoothMotion(SmoothInputs, CleanOperator, bpy.types.Operator):
    """Take the tremble out of people's motion, without lag: nothing happens earlier or later than it did"""

    bl_idname = "scene_aware_mocap.smooth_motion"
    bl_label = "Smooth"

    def step(self) -> cleaning.Step:
        return cleaning.smoothing(self.cutoff, keep_contacts=self.keep_contacts)


class LockFeet(BlendInput, CleanOperator, bpy.types.Operator):
    """Hold standing feet still, as the take's contacts say; they still roll from heel to ball, and legs bend for it"""

    bl_idname = "scene_aware_mocap.lock_feet"
    bl_label = "Lock Feet"

    def step(self) -> cleaning.Step:
        return cleaning.foot_lock(self.blend)


class SnapFeet(SurfaceInput, BlendInput, CleanOperator, bpy.types.Operator):
    """Put standing feet onto the floor, stairs or slopes under them, and lift what would sink in"""

    bl_idname = "scene_aware_mocap.snap_feet"
    bl_label = "Snap to Ground"

    def step(self) -> cleaning.Step:
        return cleaning.ground_snap(self.surface, self.blend)


class RemoveDrift(SurfaceInput, DriftInputs, CleanOperator, bpy.types.Operator):
    """Keep people who stand from creeping, sinking or rising slowly; steps keep their lengths"""

    bl_idname = "scene_aware_mocap.remove_drift"
    bl_label = "Remove Drift"

    def step(self) -> cleaning.Step:
        return cleaning.drift_removal(self.surface if self.heights else None)


class FillGaps(FillInputs, CleanOperator, bpy.types.Operator):
    """Replace the motion where people were hidden: what was guessed there may tremble or jump"""

    bl_idname = "scene_aware_mocap.fill_gaps"
    bl_label = "Fill Hidden Spans"

    def step(self) -> cleaning.Step:
        return cleaning.gap_filling(self.filling, self.confidence)


class ReduceKeys(KeyInputs, CleanOperator, bpy.types.Operator):
    """Leave as few keys as the error you allow needs: easier to edit by hand. Smooth first, tremble needs its keys"""

    bl_idname = "scene_aware_mocap.reduce_keys"
    bl_label = "Reduce Keys"
    note_kind = "INFO"

    def work(self, context: bpy.types.Context, people: list[bpy.types.Object]) -> cleaning.Work:
        return cleaning.reduce(context, people, Bound(self.distance, self.angle), self.result)


class BakeMotion(CleanOperator, bpy.types.Operator):
    """Flatten all layers and constraints into one action with a key on each frame"""

    bl_idname = "scene_aware_mocap.bake_motion"
    bl_label = "Bake"

    def step(self) -> cleaning.Step:
        return cleaning.baking()
