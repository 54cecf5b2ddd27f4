# SPDX-License-Identifier: GPL-3.0-or-later
"""Work in a scene of its own and leave no trace in the user's file."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import bpy

# The user's windows and their layout come and go by Blender's own will.
_LEFT_ALONE = {"window_managers", "workspaces", "screens"}


@contextmanager
def temporary_scene(context: bpy.types.Context, name: str) -> Iterator[bpy.types.Scene]:
    """Inside, an empty scene is the window's; afterwards the former one is, and all that was made inside is gone.

    Args:
        context: has a window, as Blender always has, without a display too.
        name: of the scene.
    """
    window, former = context.window, context.window.scene
    # A view through the camera falls back to a free one when its scene goes.
    views = [(space.region_3d, space.region_3d.view_perspective) for space in _views_of(window)]
    before = {datablock.as_pointer() for datablock in _datablocks()}
    scene = bpy.data.scenes.new(name)
    try:
        window.scene = scene
        yield scene
    finally:
        window.scene = former
        for view, perspective in views:
            view.view_perspective = perspective
        bpy.data.batch_remove([datablock for datablock in _datablocks() if datablock.as_pointer() not in before])


@contextmanager
def object_mode(context: bpy.types.Context) -> Iterator[None]:
    """Inside, nothing is being edited or posed; afterwards the active object is in its former mode again."""
    active = context.view_layer.objects.active
    mode = active.mode if active else "OBJECT"
    if mode == "OBJECT":
        yield
        return
    bpy.ops.object.mode_set(mode="OBJECT")
    try:
        yield
    finally:
        context.view_layer.objects.active = active
        bpy.ops.object.mode_set(mode=mode)


@contextmanager
def free_names(names: Iterable[str]) -> Iterator[None]:
    """Inside, nothing of the user's bears these names, so that new things can; afterwards all names are as before."""
    taken = set(names)
    kinds = (bpy.data.objects, bpy.data.armatures, bpy.data.meshes, bpy.data.actions, bpy.data.scenes, bpy.data.cameras)
    holders = [(block, block.name) for kind in kinds for block in kind if block.name in taken and not block.library]
    try:
        for number, (block, _) in enumerate(holders):
            block.name = f".set aside {number}"
        yield
    finally:
        for block, name in holders:
            block.name = name


def _views_of(window: bpy.types.Window) -> list[bpy.types.SpaceView3D]:
    spaces = (area.spaces.active for area in window.screen.areas if area.type == "VIEW_3D")
    return [space for space in spaces if space.region_3d is not None]


def _datablocks() -> Iterator[bpy.types.ID]:
    for kind in bpy.data.bl_rna.properties:
        if kind.type == "COLLECTION" and kind.identifier not in _LEFT_ALONE:
            yield from getattr(bpy.data, kind.identifier)
