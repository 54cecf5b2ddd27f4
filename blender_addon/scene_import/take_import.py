# SPDX-License-Identifier: GPL-3.0-or-later
"""A whole take into the current scene: one collection with the scene's things and one below it per person."""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from core_solver.geometry import Similarity
from core_solver.take import Person, Take

from .armature import animate_rig, build_rig
from .body_mesh import build_body
from .camera import build_camera
from .footage import FootageError, find_footage, show_footage
from .point_cloud import build_cloud
from .presence import hide_absent_body, hide_absent_bones
from .rest_pose import rest_pose
from .timing import clock_notes, set_clock
from .world import world_of


@dataclass(frozen=True)
class ImportOptions:
    """What to bring in.

    Attributes:
        cloud: the static scene's points.
        camera: the camera and its footage.
        body: each person's skin.
        footage: the video or its folder; empty to look beside the take.
        hide_absent: hide people before they are first and after they are last seen.
    """

    cloud: bool = True
    camera: bool = True
    body: bool = True
    footage: str = ""
    hide_absent: bool = True


@dataclass(frozen=True)
class Imported:
    """What came in.

    Attributes:
        collection: holds everything.
        armatures: one per person, in the take's order.
        bodies: the skins, in the same order; empty without bodies.
        camera: None when left out.
        cloud: None when left out or empty.
        notes: plain sentences for the user: the take's own warnings, missing footage, a changed frame rate.
    """

    collection: bpy.types.Collection
    armatures: tuple[bpy.types.Object, ...]
    bodies: tuple[bpy.types.Object, ...]
    camera: bpy.types.Object | None
    cloud: bpy.types.Object | None
    notes: tuple[str, ...]


def import_take(context: bpy.types.Context, take: Take, path: Path, options: ImportOptions) -> Imported:
    """Build a checked take in the current scene; its first frame is frame 1 of the scene.

    What is in the scene already stays as it is. The people become the selection.

    Args:
        context: Blender's; object mode is entered.
        take: from `read_take`.
        path: the take's file: gives the collection's name and the place to look for footage.
        options: what to bring in.

    Returns:
        The new objects and what the user should know.
    """
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    # Edit mode, which bones are made in, would take selected armatures of the user with it.
    _deselect_all(context)
    world = world_of(take.meta)
    notes = [*take.meta.warnings, *clock_notes(context.scene, take.meta.frame_rate)]
    collection = _collection(context.scene.collection, path.stem)
    set_clock(context.scene, take.meta.frame_rate, take.frame_count)
    surroundings = _collection(collection, f"{path.stem} scene")
    camera = cloud = None
    if options.camera:
        camera = build_camera(context.scene, surroundings, take.meta.camera, world, _farthest(take))
        notes += _show_footage(camera, take, path, options.footage)
    if options.cloud and len(take.scene.points):
        cloud = build_cloud(surroundings, take.scene, take.meta.camera, world)
    built = [_build_person(context, collection, take, person, world, options) for person in take.people]
    for armature, _ in built:
        armature.select_set(True)
    return Imported(
        collection=collection,
        armatures=tuple(armature for armature, _ in built),
        bodies=tuple(body for _, body in built if body is not None),
        camera=camera,
        cloud=cloud,
        notes=tuple(notes),
    )


def _build_person(
    context: bpy.types.Context,
    parent: bpy.types.Collection,
    take: Take,
    person: Person,
    world: Similarity,
    options: ImportOptions,
) -> tuple[bpy.types.Object, bpy.types.Object | None]:
    collection = _collection(parent, person.name)
    rest = rest_pose(person, take.meta.joint_names, take.meta.parents)
    rig = build_rig(context, collection, person, take.meta, rest)
    animate_rig(rig, person, world)
    body = build_body(collection, rig, person, rest) if options.body and len(person.rest_vertices) else None
    if options.hide_absent:
        hide_absent_bones(rig.object)
        if body is not None:
            hide_absent_body(body, rig.object)
    return rig.object, body


def _collection(parent: bpy.types.Collection, name: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(name)
    parent.children.link(collection)
    return collection


def _deselect_all(context: bpy.types.Context) -> None:
    for obj in context.view_layer.objects:
        obj.select_set(False)


def _show_footage(camera: bpy.types.Object, take: Take, path: Path, chosen: str) -> list[str]:
    try:
        show_footage(camera, find_footage(path, take.meta.video_name, chosen), take.meta, take.frame_count)
    except FootageError as error:
        return [str(error)]
    return []


def _farthest(take: Take) -> float:
    """Depth of the farthest point or person, metres."""
    depths = [take.scene.points[:, 2], *(person.gamma[:, 2] for person in take.people)]
    return float(max((np.max(depth) for depth in depths if len(depth)), default=0.0))
