# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar's section that makes motion better."""

from typing import Any

import bpy

from ..operators.clean import BakeMotion, FillGaps, LockFeet, ReduceKeys, RemoveDrift, SmoothMotion, SnapFeet
from ..operators.identities import MergePeople, SplitPerson, SwapPeople

# Each operation with the settings that it reads, in the order in which they are best used.
_OPERATIONS: tuple[tuple[type, tuple[str, ...]], ...] = (
    (FillGaps, ("filling", "confidence")),
    (RemoveDrift, ("heights",)),
    (SmoothMotion, ("cutoff", "keep_contacts")),
    (SnapFeet, ("surface", "blend")),
    (LockFeet, ("blend",)),
    (ReduceKeys, ("distance", "angle")),
    (BakeMotion, ()),
)
_SHARED = {RemoveDrift: ("surface",)}
"""Settings that an operation reads but which stand at another one."""


class CleanPanel(bpy.types.Panel):
    bl_idname = "VIEW3D_PT_scene_aware_mocap_clean"
    bl_label = "Clean"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"
    bl_order = 2
    bl_options = {"DEFAULT_CLOSED"}  # noqa: RUF012 - Blender reads this class attribute

    def draw(self, context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        settings = context.scene.mocap_clean
        layout.prop(settings, "result")
        for operator, names in _OPERATIONS:
            box = layout.box()
            for name in names:
                box.prop(settings, name)
            button = box.operator(operator.bl_idname)
            _fill(button, settings, ("result", *names, *_SHARED.get(operator, ())))
        header, body = layout.panel("scene_aware_mocap_identities", default_closed=True)
        header.label(text="Who Is Who")
        if body is not None:
            for operator in (SwapPeople, MergePeople, SplitPerson):
                button = body.operator(operator.bl_idname)
                button.result = settings.result


def _fill(button: Any, settings: Any, names: tuple[str, ...]) -> None:
    for name in names:
        setattr(button, name, getattr(settings, name))
