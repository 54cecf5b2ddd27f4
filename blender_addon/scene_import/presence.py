# SPDX-License-Identifier: GPL-3.0-or-later
"""People who have not come yet or have left: their bodies and bones are hidden; their motion stays as it is.

One curve says when a person is there. The body is hidden by drivers that follow it. Of the armature only the bones are
hidden, through their collection: Blender stops posing an armature object that is hidden, and exporters would read old
poses.
"""

import bpy
import numpy as np
from numpy.typing import NDArray

PRESENT = "present"
"""Custom property of the armature object: 1 from the first frame the person was seen to the last, otherwise 0."""

_HIDING = ("hide_viewport", "hide_render")
_BONES = "Joints"


def presence(valid: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T,) true from the first to the last frame with evidence; everywhere for somebody never seen.

    Args:
        valid: (T,) whether a frame has evidence; gaps count as there.
    """
    seen = np.flatnonzero(valid)
    if not len(seen):
        return np.ones(len(valid), bool)
    frames = np.arange(len(valid))
    return (frames >= seen[0]) & (frames <= seen[-1])


def hide_absent_bones(rig: bpy.types.Object) -> None:
    """Show an armature's bones only while its property `PRESENT` is 1."""
    bones = rig.data.collections.new(_BONES)
    for bone in rig.data.bones:
        bones.assign(bone)
    _drive(rig.data, bones.path_from_id("is_visible"), rig, "present > 0.5")


def hide_absent_body(body: bpy.types.Object, rig: bpy.types.Object) -> None:
    """Show a body, in the viewport and in renders, only while its armature's property `PRESENT` is 1."""
    for path in _HIDING:
        _drive(body, path, rig, "present < 0.5")


def _drive(owner: bpy.types.ID, path: str, rig: bpy.types.Object, expression: str) -> None:
    # Blender evaluates so simple an expression by itself, without Python and its permission to run.
    driver = owner.driver_add(path).driver
    driver.type = "SCRIPTED"
    variable = driver.variables.new()
    variable.name = PRESENT
    variable.targets[0].id = rig
    variable.targets[0].data_path = f'["{PRESENT}"]'
    driver.expression = expression
