# SPDX-License-Identifier: GPL-3.0-or-later
"""What characters do in the user's scene, read before anything is copied: rest, motion and where their bodies lie."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..retarget.skeleton import Motion, Skeleton
from ..rig.reading import read_motion, read_skeleton
from ..scene_import.timing import rate_of

Array = NDArray[np.float64]


class ExportError(UserError):
    """A file that cannot be written."""


@dataclass(frozen=True)
class Character:
    """An armature and the meshes that it moves."""

    armature: bpy.types.Object
    meshes: tuple[bpy.types.Object, ...]


@dataclass(frozen=True)
class Timing:
    """The frames of a file, at its own rate; time 0 of the file is frame 0 of the scene.

    Attributes:
        rate: frames per second of the file.
        frames: (T,) whole frames of the file.
        scene_frames: (T,) the scene's frames at the same times, not whole where the rates differ.
    """

    rate: Fraction
    frames: Array
    scene_frames: Array


@dataclass(frozen=True)
class Body:
    """A mesh that an armature moves.

    Attributes:
        mesh: the user's object.
        name: of the object.
        data_name: of its mesh data.
        rest: from its vertices' own space to the world, with the armature at rest.
        carrier: the bone on which it hangs as a whole; empty for a skin.
    """

    mesh: bpy.types.Object
    name: str
    data_name: str
    rest: Matrix
    carrier: str


@dataclass(frozen=True)
class Performance:
    """One character over the frames of a file.

    Attributes:
        armature: the user's object.
        name: of the armature.
        skeleton: at rest, world, metres.
        motion: world, metres, at the file's frames.
        bodies: its meshes.
    """

    armature: bpy.types.Object
    name: str
    skeleton: Skeleton
    motion: Motion
    bodies: tuple[Body, ...]


@dataclass(frozen=True)
class Shot:
    """A camera over the frames of a file.

    Attributes:
        camera: the user's object.
        name: of the object.
        data_name: of its camera data.
        places: (T, 4, 4) its world matrices, or (1, 4, 4) when it stands still.
    """

    camera: bpy.types.Object
    name: str
    data_name: str
    places: Array


def characters_among(context: bpy.types.Context, objects: Sequence[bpy.types.Object]) -> tuple[Character, ...]:
    """The armatures among some objects, and those that move a mesh among them, each with all its meshes."""
    armatures = [obj if obj.type == "ARMATURE" else armature_of(obj) for obj in objects]
    meshes = [obj for obj in context.scene.objects if obj.type == "MESH"]
    return tuple(
        Character(armature, tuple(mesh for mesh in meshes if armature_of(mesh) == armature))
        for armature in dict.fromkeys(armatures)
        if armature is not None
    )


def armature_of(obj: bpy.types.Object) -> bpy.types.Object | None:
    """The armature that moves a mesh, by a modifier or as its parent; None for anything else."""
    if obj.type != "MESH":
        return None
    movers = [modifier.object for modifier in obj.modifiers if modifier.type == "ARMATURE"] + [obj.parent]
    return next((mover for mover in movers if mover is not None and mover.type == "ARMATURE"), None)


def timing_of(scene: bpy.types.Scene, rate: float) -> Timing:
    """The frames of a file that shows the scene's range.

    Args:
        scene: gives range and rate.
        rate: frames per second of the file; 0 for the scene's.

    Raises:
        ExportError: the range is so short that it holds no frame of the file.
    """
    own = rate_of(scene)
    wanted = Fraction(rate).limit_denominator(1001) if rate else own
    step = own / wanted
    first, last = -(-Fraction(scene.frame_start) // step), Fraction(scene.frame_end) // step
    frames = np.arange(int(first), int(last) + 1, dtype=np.float64)
    if not len(frames):
        raise ExportError(f"the scene's frames hold none at {float(wanted):g} per second: choose a longer range")
    return Timing(wanted, frames, frames * float(step))


def perform(context: bpy.types.Context, character: Character, timing: Timing) -> Performance:
    """Read one character; its objects must be visible.

    Raises:
        UserError: the armature is stretched or has no bones.
    """
    armature = character.armature
    skeleton = read_skeleton(armature)
    now = read_motion(armature, skeleton, np.array([context.scene.frame_current_final]))
    bodies = tuple(_body(context, mesh, armature, skeleton, now) for mesh in character.meshes)
    motion = read_motion(armature, skeleton, timing.scene_frames)
    return Performance(armature, armature.name, skeleton, motion, bodies)


def film(context: bpy.types.Context, camera: bpy.types.Object, timing: Timing) -> Shot:
    """Read a camera; it must be visible."""
    scene = context.scene
    stands = not (camera.animation_data or camera.parent or camera.constraints)
    shown = scene.frame_current_final
    places = []
    for frame in [shown] if stands else timing.scene_frames:
        scene.frame_set(int(frame // 1), subframe=float(frame % 1))
        places.append(np.array(camera.evaluated_get(context.evaluated_depsgraph_get()).matrix_world))
    scene.frame_set(int(shown // 1), subframe=shown % 1)
    return Shot(camera, camera.name, camera.data.name, np.array(places))


def _body(
    context: bpy.types.Context, mesh: bpy.types.Object, armature: bpy.types.Object, skeleton: Skeleton, now: Motion
) -> Body:
    place = mesh.evaluated_get(context.evaluated_depsgraph_get()).matrix_world.copy()
    skinned = any(modifier.type == "ARMATURE" for modifier in mesh.modifiers)
    carrier = mesh.parent_bone if mesh.parent == armature and mesh.parent_type == "BONE" and not skinned else ""
    if carrier:
        place = carried(skeleton, now, skeleton.index(carrier)).inverted() @ place
    return Body(mesh, mesh.name, mesh.data.name, place, carrier)


def carried(skeleton: Skeleton, motion: Motion, bone: int) -> Matrix:
    """What a bone does to the world's points that hang on it, from rest to the motion's first frame."""
    turn = motion.rotations[0, bone] @ skeleton.axes[bone].T
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = motion.heads[0, bone] - turn @ skeleton.heads[bone]
    return Matrix(matrix.tolist())
