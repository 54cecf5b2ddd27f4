# SPDX-License-Identifier: GPL-3.0-or-later
"""The bone map of an armature of the scene."""

import bpy

from ..retarget.bone_map import BoneMap
from ..retarget.finding import find_map
from ..retarget.options import Drive
from ..retarget.presets import built_in_presets
from .reading import read_skeleton

_OTHER_CONTROLS = {"fk": "Rigify, IK controls", "ik": "Rigify, FK controls"}


def map_of(obj: bpy.types.Object, drive: Drive) -> BoneMap:
    """The roles of a rig's bones.

    Args:
        obj: an armature object.
        drive: which controls are meant on a rig that has both kinds.

    Raises:
        UserError: the rig is no humanoid, or cannot be read.
    """
    presets = [preset for preset in built_in_presets() if preset.title != _OTHER_CONTROLS[drive]]
    return find_map(read_skeleton(obj), presets)
