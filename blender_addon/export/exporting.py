# SPDX-License-Identifier: GPL-3.0-or-later
"""People and camera to one GLB or FBX file, whole or not at all."""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

import bpy

from core_solver.errors import UserError

from .glb_clock import stretch_clock
from .showing import shown

Writer = Callable[[bpy.types.Context, Path], None]


class ExportError(UserError):
    """A file that cannot be written."""


def export_objects(context: bpy.types.Context, objects: Sequence[bpy.types.Object], path: Path) -> None:
    """Write objects with their motion; the file's ending, .glb or .fbx, chooses the format.

    An old file at `path` is replaced only when the new one is complete. The scene's selection changes.
    Hidden objects are written too. Neither format can hide somebody for a while: people who have not come yet or have
    left stand still where they were first or last seen, and the armatures' custom properties (extras of a GLB's
    nodes, user properties in FBX) say when they are there.

    Args:
        context: in object mode.
        objects: what to write: armatures with their bodies, a camera.
        path: the file.

    Raises:
        ExportError: another ending, a missing exporter, or the disk refuses the file.
    """
    write = writer_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with shown(context, objects), tempfile.TemporaryDirectory(prefix=f".{path.name}.", dir=path.parent) as folder:
            # Exporters of selected objects pass over hidden ones.
            _select(context, objects)
            part = Path(folder) / path.name
            write(context, part)
            part.replace(path)
    except (OSError, RuntimeError) as error:
        reason = getattr(error, "strerror", None) or str(error).strip().splitlines()[-1]
        raise ExportError(f"cannot write {path}: {reason}; free some space or choose another place") from error


def writer_of(path: Path) -> Writer:
    """The function that writes the selected objects in the format of a file's ending.

    Raises:
        ExportError: another ending.
    """
    writers = {".glb": _write_glb, ".fbx": _write_fbx}
    writer = writers.get(path.suffix.lower())
    if writer is None:
        raise ExportError(f"cannot write {path.name}: choose a name that ends in .glb or .fbx")
    return writer


def _write_glb(context: bpy.types.Context, path: Path) -> None:
    render = context.scene.render
    rate, base = render.fps, render.fps_base
    # The exporter takes a base other than 1 for its inverse: see `glb_clock`.
    render.fps_base = 1.0
    try:
        # "Active actions" is one animation in which every person moves; in the other modes a player shows one person
        # at a time.
        bpy.ops.export_scene.gltf(
            filepath=str(path),
            export_format="GLB",
            use_selection=True,
            export_animation_mode="ACTIVE_ACTIONS",
            export_nla_strips_merged_animation_name=path.stem,
            export_cameras=True,
            export_extras=True,
        )
    finally:
        render.fps, render.fps_base = rate, base
    if base != 1.0:
        stretch_clock(path, base)


def _write_fbx(_context: bpy.types.Context, path: Path) -> None:
    # By default the exporter simplifies curves by millimetres, gives everybody the first person's action and adds
    # bones at the ends.
    bpy.ops.export_scene.fbx(
        filepath=str(path),
        use_selection=True,
        object_types={"ARMATURE", "MESH", "CAMERA"},
        add_leaf_bones=False,
        use_custom_props=True,
        mesh_smooth_type="FACE",
        bake_anim=True,
        bake_anim_use_all_actions=False,
        bake_anim_use_nla_strips=False,
        bake_anim_simplify_factor=0.0,
    )


def _select(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> None:
    for other in context.view_layer.objects:
        other.select_set(False)
    for obj in objects:
        obj.select_set(True)
