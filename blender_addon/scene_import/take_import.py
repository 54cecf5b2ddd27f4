# SPDX-License-Identifier: GPL-3.0-or-later
"""A whole take into the current scene: one collection with the scene's things and one below it per person."""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from core_solver.errors import UserError
from core_solver.geometry import Similarity
from core_solver.take import Meta, Person, Take

from .armature import animate_rig, build_rig
from .body_mesh import build_body
from .camera import build_camera
from .clock import FIRST_FRAME, Clock, clock_of_scene, clock_of_take
from .footage import FootageError, find_footage, show_footage
from .markers import mark_hidden
from .point_cloud import build_cloud, thinned
from .presence import hide_absent_body, hide_absent_bones
from .resampling import resample
from .rest_pose import rest_pose
from .strips import push_down
from .timing import clock_notes, rate_of, set_clock
from .world import CAMERA_OVER_ORIGIN, Origin, world_of


class ChoiceError(UserError):
    """A choice on import that the take cannot fulfil."""


@dataclass(frozen=True)
class ImportOptions:
    """What to bring in, and how.

    Attributes:
        people: names or ids of the people wanted; empty for all.
        body: each person's skin.
        hide_absent: hide people before they are first and after they are last seen.
        cloud: the static scene's points.
        density: share of the points to bring in, 0..1.
        camera: the camera.
        behind: the footage behind the camera.
        footage: the video or its folder; empty to look beside the take.
        origin: where the take stands in the world.
        start: scene frame of the take's first frame.
        keep_rate: leave the scene's frame rate alone and resample the take to it.
        strips: motion as strips of the NLA editor instead of active actions.
        markers: markers where a person was hidden.
        shortest_hidden: fewest frames hidden for a marker.
    """

    people: tuple[str, ...] = ()
    body: bool = True
    hide_absent: bool = True
    cloud: bool = True
    density: float = 1.0
    camera: bool = True
    behind: bool = True
    footage: str = ""
    origin: Origin = CAMERA_OVER_ORIGIN
    start: int = FIRST_FRAME
    keep_rate: bool = False
    strips: bool = False
    markers: bool = True
    shortest_hidden: int = 5


@dataclass(frozen=True)
class Imported:
    """What came in.

    Attributes:
        collection: holds everything.
        armatures: one per person, in the take's order.
        bodies: the skins, in the same order; empty without bodies.
        camera: None when left out.
        cloud: None when left out or empty.
        clock: the scene frames that show the take.
        notes: plain sentences for the user: the take's own warnings, missing footage, a changed frame rate.
    """

    collection: bpy.types.Collection
    armatures: tuple[bpy.types.Object, ...]
    bodies: tuple[bpy.types.Object, ...]
    camera: bpy.types.Object | None
    cloud: bpy.types.Object | None
    clock: Clock
    notes: tuple[str, ...]


def import_take(context: bpy.types.Context, take: Take, path: Path, options: ImportOptions) -> Imported:
    """Build a checked take in the current scene.

    What is in the scene already stays as it is. The people become the selection. A take without a video has no camera.

    Args:
        context: Blender's; object mode is entered.
        take: from `read_take`.
        path: the take's file: gives the collection's name and the place to look for footage.
        options: what to bring in, and how.

    Returns:
        The new objects and what the user should know.

    Raises:
        ChoiceError: somebody is wanted who is not in the take; nothing has changed then.
    """
    people = chosen_people(take, options.people)
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    # Edit mode, which bones are made in, would take selected armatures of the user with it.
    _deselect_all(context)
    scene = context.scene
    world = world_of(take.meta, people, options.origin)
    clock = _clock(scene, take, options)
    notes = [*take.meta.warnings, *clock_notes(scene, clock.rate)]
    collection = _collection(scene.collection, path.stem)
    set_clock(scene, clock)
    surroundings = _collection(collection, f"{path.stem} scene")
    camera = cloud = None
    if options.camera and take.meta.video_name:
        camera = build_camera(scene, surroundings, take.meta.camera, world, _farthest(take))
        notes += _show_footage(camera, take, path, clock, options)
    if options.cloud and len(take.scene.points):
        cloud = build_cloud(surroundings, thinned(take.scene, options.density), take.meta.camera, world)
    built = [
        _build_person(context, collection, take.meta, resample(person, clock.moments), world, clock, options)
        for person in people
    ]
    for armature, _ in built:
        armature.select_set(True)
    return Imported(
        collection=collection,
        armatures=tuple(armature for armature, _ in built),
        bodies=tuple(body for _, body in built if body is not None),
        camera=camera,
        cloud=cloud,
        clock=clock,
        notes=tuple(notes),
    )


def _clock(scene: bpy.types.Scene, take: Take, options: ImportOptions) -> Clock:
    if options.keep_rate:
        return clock_of_scene(take, options.start, rate_of(scene))
    return clock_of_take(take, options.start)


def chosen_people(take: Take, wanted: tuple[str, ...]) -> tuple[Person, ...]:
    """The people with these names or ids, in the take's order; all when none are named.

    Raises:
        ChoiceError: somebody is not there.
    """
    called = [{person.name.casefold(), str(person.id)} for person in take.people]
    words = {word.strip().casefold() for word in wanted}
    whole = ",".join(wanted).strip().casefold()  # a name may have commas in it
    if whole and any(whole in names for names in called):
        words = {whole}
    missing = words.difference(*called)
    if missing:
        there = ", ".join(f"{person.name} ({person.id})" for person in take.people) or "nobody"
        raise ChoiceError(f"nobody is called {', '.join(sorted(missing))}: the take has {there}")
    return tuple(person for person, names in zip(take.people, called, strict=True) if not words or words & names)


def _build_person(
    context: bpy.types.Context,
    parent: bpy.types.Collection,
    meta: Meta,
    person: Person,
    world: Similarity,
    clock: Clock,
    options: ImportOptions,
) -> tuple[bpy.types.Object, bpy.types.Object | None]:
    collection = _collection(parent, person.name)
    rest = rest_pose(person, meta.joint_names, meta.parents)
    rig = build_rig(context, collection, person, meta, rest)
    animate_rig(rig, person, world, clock)
    if options.strips:
        push_down(rig.object, clock.start)
    if options.markers:
        mark_hidden(context.scene, rig.object.name, person.valid, clock, options.shortest_hidden)
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


def _show_footage(camera: bpy.types.Object, take: Take, path: Path, clock: Clock, options: ImportOptions) -> list[str]:
    if not options.behind:
        return []
    try:
        show_footage(camera, find_footage(path, take.meta.video_name, options.footage), take.meta, clock)
    except FootageError as error:
        return [str(error)]
    return []


def _farthest(take: Take) -> float:
    """Depth of the farthest point or person, metres."""
    depths = [take.scene.points[:, 2], *(person.gamma[:, 2] for person in take.people)]
    return float(max((np.max(depth) for depth in depths if len(depth)), default=0.0))
