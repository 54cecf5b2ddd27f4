# SPDX-License-Identifier: GPL-3.0-or-later
"""The current scene to one file by Blender's own exporters, with the options that keep every person's own motion."""

from collections.abc import Callable
from pathlib import Path

import bpy

from .glb_clock import stretch_clock
from .performance import ExportError
from .profiles import Profile

Writer = Callable[[bpy.types.Context, Path, Profile], None]

_FORMATS = {"glb": ("gltf", "glTF 2.0"), "fbx": ("fbx", "FBX")}
"""Name of the operator, and of the format in Blender's preferences."""


def writer_of(format_name: str) -> Writer:
    """The function that writes the current scene, "glb" or "fbx".

    Raises:
        ExportError: an unknown format, or Blender's add-on for it is switched off.
    """
    if format_name not in _FORMATS:
        raise ExportError(f"cannot write {format_name or 'a file without ending'}: choose .glb or .fbx")
    operator, title = _FORMATS[format_name]
    if operator not in dir(bpy.ops.export_scene) or operator not in dir(bpy.ops.import_scene):
        raise ExportError(f"Blender's {title} add-on is switched off: enable it in Edit > Preferences > Add-ons")
    return _write_glb if format_name == "glb" else _write_fbx


def _write_glb(context: bpy.types.Context, path: Path, _profile: Profile) -> None:
    render = context.scene.render
    base = render.fps_base
    # The exporter takes a base other than 1 for its inverse: see `glb_clock`.
    render.fps_base = 1.0
    # "Active actions" is one animation in which every person moves; in the other modes a player shows one person at a
    # time. A single armature would get all actions of the user's file that fit it.
    bpy.ops.export_scene.gltf(
        filepath=str(path),
        export_format="GLB",
        use_active_scene=True,
        export_animation_mode="ACTIVE_ACTIONS",
        export_anim_single_armature=False,
        export_nla_strips_merged_animation_name=path.stem,
        export_cameras=True,
        export_extras=True,
    )
    if base != 1.0:
        stretch_clock(path, base)


def _write_fbx(_context: bpy.types.Context, path: Path, profile: Profile) -> None:
    # By default the exporter simplifies curves by millimetres, gives everybody the first person's action and adds
    # bones at the ends.
    bpy.ops.export_scene.fbx(
        filepath=str(path),
        object_types={"ARMATURE", "MESH", "CAMERA"},
        apply_scale_options=profile.fbx_scale,
        axis_forward=profile.axis_forward,
        axis_up=profile.axis_up,
        add_leaf_bones=False,
        use_custom_props=True,
        mesh_smooth_type="FACE",
        bake_anim=True,
        bake_anim_use_all_actions=False,
        bake_anim_use_nla_strips=False,
        bake_anim_simplify_factor=0.0,
    )
