# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of characters as an engine wants them, in a temporary scene: the user's own objects stay as they are.

A staged armature stands at the origin with no scale of its own; bones, bodies and keys are in the file's units. All
that moved the original (constraints, drivers, NLA strips, its object's own motion) has become one key per frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from core_solver.geometry import quaternion_from_matrix
from core_solver.take import JOINT_NAMES

from ..retarget.skeleton import Motion, Skeleton, without_flips
from ..rig.reading import read_skeleton
from ..rig.writing import write_motion
from ..scene_import.actions import Curves, write_action
from .performance import Body, Performance, Shot, Timing
from .profiles import Profile

Array = NDArray[np.float64]

_ROOT_LENGTH = 0.2
"""Of an added root bone, metres: it carries no body, so that any length is right."""


@dataclass(frozen=True)
class Bones:
    """How a character's bones are called in a file.

    Attributes:
        names: (B,) the file's names in the order of the character's own bones.
        root: name of the bone added above them; empty for none.
    """

    names: tuple[str, ...]
    root: str

    @property
    def count(self) -> int:
        """Number of bones in the file."""
        return len(self.names) + bool(self.root)


def bones_in_file(performance: Performance, profile: Profile) -> Bones:
    """Names by the profile: people of a take are renamed, other rigs are not; a root only where none is."""
    own = performance.skeleton.names
    renamed = profile.bone_names if set(JOINT_NAMES) == set(own) else {}
    names = tuple(renamed.get(name, name) for name in own)
    has_root = profile.root_bone.casefold() in {name.casefold() for name in names}
    return Bones(names, "" if has_root else profile.root_bone)


def main_root(skeleton: Skeleton) -> int:
    """The parentless bone that carries the most others: controls and stray bones are not the body."""
    roots = list(range(len(skeleton.names)))
    for bone, parent in enumerate(skeleton.parents):
        roots[bone] = roots[parent] if parent >= 0 else bone
    return int(np.argmax(np.bincount(roots)))


def root_path(performance: Performance, profile: Profile) -> Array:
    """(T, 3) where an added root bone is, metres: on the ground under the hips, or at the origin."""
    hips = performance.motion.heads[:, main_root(performance.skeleton)]
    return hips * (1.0, 1.0, 0.0) if profile.root_moves else np.zeros_like(hips)


def stage(context: bpy.types.Context, performance: Performance, timing: Timing, profile: Profile, name: str) -> None:
    """Copy one character into the current scene.

    Args:
        context: its scene is a temporary one.
        performance: from the user's scene.
        timing: the file's frames.
        profile: units, names, root.
        name: of the armature's node.
    """
    unit = units_of(profile)
    bones = bones_in_file(performance, profile)
    armature = _copy_armature(context, performance, name, unit)
    _prepare_bones(context, armature, performance.skeleton, bones, unit)
    skeleton = read_skeleton(armature)
    motion = _motion_in_file(performance, bones, skeleton, root_path(performance, profile), unit)
    moved = {bones.root} if bones.root else set()
    frames = timing.frames
    if needs_rest_key(profile):
        frames, motion = np.insert(frames, 0, frames[0] - 1), _from_rest(skeleton, motion)
    write_motion(armature, skeleton, motion, name, skeleton.names, frames, moved)
    if profile.meshes:
        new_names = dict(zip(performance.skeleton.names, bones.names, strict=True))
        for body in performance.bodies:
            _copy_body(context, body, performance.armature, armature, new_names, unit)


def needs_rest_key(profile: Profile) -> bool:
    """Whether the frame before the first must show the rest pose.

    An FBX file without bodies has no bind pose: whoever reads it takes for rest how the bones stand when it is written.
    """
    return profile.format == "fbx" and not profile.meshes


def units_of(profile: Profile) -> float:
    """Units per metre of the file; GLB knows metres only."""
    return profile.units_per_metre if profile.format == "fbx" else 1.0


def stage_camera(context: bpy.types.Context, shot: Shot, timing: Timing, profile: Profile) -> None:
    """Copy a camera into the current scene."""
    camera = _own_copy(shot.camera)
    camera.name, camera.data.name = shot.name, shot.data_name
    _cut_loose(camera)
    context.scene.collection.objects.link(camera)
    context.scene.camera = camera
    camera.rotation_mode = "QUATERNION"
    camera.location = units_of(profile) * shot.places[0, :3, 3]
    camera.rotation_quaternion = Matrix(shot.places[0].tolist()).to_quaternion()
    if len(shot.places) > 1:
        curves = [
            Curves("location", units_of(profile) * shot.places[:, :3, 3], "Camera"),
            Curves("rotation_quaternion", without_flips(quaternion_from_matrix(shot.places[:, :3, :3])), "Camera"),
        ]
        write_action(camera, shot.name, timing.frames, curves)


def _copy_armature(context: bpy.types.Context, performance: Performance, name: str, unit: float) -> bpy.types.Object:
    armature = _own_copy(performance.armature)
    armature.name = name
    armature.data.name = name
    _cut_loose(armature)
    armature.data.animation_data_clear()
    armature.data.pose_position = "POSE"
    context.scene.collection.objects.link(armature)
    for bone in armature.pose.bones:
        for constraint in list(bone.constraints):
            bone.constraints.remove(constraint)
        bone.custom_shape = None
        bone.rotation_mode = "QUATERNION"
        bone.matrix_basis = Matrix()
        bone.lock_rotation = (False, False, False)
    world = np.eye(4)
    to_world = performance.skeleton.to_world
    world[:3, :3] = to_world.scale * to_world.rotation
    world[:3, 3] = to_world.translation
    armature.data.transform(Matrix.Scale(unit, 4) @ Matrix(world.tolist()))
    return armature


def _own_copy(obj: bpy.types.Object) -> bpy.types.Object:
    """A copy of an object and its data that may be changed at will, also of what is linked or overridden."""
    copy = obj.copy()
    copy.data = obj.data.copy()
    for block in (copy, copy.data):
        block.make_local(clear_liboverride=True)
    return copy


def _cut_loose(obj: bpy.types.Object) -> None:
    """Leave an object at the origin with nothing that moves, hides or turns it."""
    obj.animation_data_clear()
    for constraint in list(obj.constraints):
        obj.constraints.remove(constraint)
    obj.parent = None
    obj.matrix_parent_inverse = Matrix()
    obj.delta_location, obj.delta_rotation_euler, obj.delta_scale = (0, 0, 0), (0, 0, 0), (1, 1, 1)
    obj.delta_rotation_quaternion = (1, 0, 0, 0)
    obj.matrix_basis = Matrix()
    obj.hide_viewport = obj.hide_render = False


def _prepare_bones(
    context: bpy.types.Context, armature: bpy.types.Object, skeleton: Skeleton, bones: Bones, unit: float
) -> None:
    """Let every bone leave its parent, give bones their names in the file and put a root above them."""
    context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        edit_bones = armature.data.edit_bones
        own = [edit_bones[name] for name in skeleton.names]
        for bone in own:
            bone.use_connect = False
        _rename(own, bones.names)
        if bones.root:
            root = edit_bones.new(bones.root)
            root.head, root.tail = (0, 0, 0), (0, _ROOT_LENGTH * unit, 0)
            for bone in own:
                bone.parent = bone.parent or root
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def _rename(things: Sequence[Any], names: Sequence[str]) -> None:
    """Give bones or vertex groups new names, in two steps: a new one may be the old one of another."""
    for number, thing in enumerate(things):
        thing.name = f".{number}"
    for thing, name in zip(things, names, strict=True):
        thing.name = name


def _motion_in_file(performance: Performance, bones: Bones, staged: Skeleton, root: Array, unit: float) -> Motion:
    """The motion of the staged bones: each turns its rest axes as the original turns its own."""
    motion, skeleton = performance.motion, performance.skeleton
    frames = len(motion.times)
    rotations = np.tile(staged.axes, (frames, 1, 1, 1))
    heads = np.tile(staged.heads, (frames, 1, 1))
    for own, name in enumerate(bones.names):
        bone = staged.index(name)
        turn = motion.rotations[:, own] @ skeleton.axes[own].T
        rotations[:, bone] = turn @ staged.axes[bone]
        heads[:, bone] = unit * motion.heads[:, own]
    if bones.root:
        heads[:, staged.index(bones.root)] = unit * root
    return Motion(motion.times, rotations, heads)


def _from_rest(skeleton: Skeleton, motion: Motion) -> Motion:
    """A motion with the rest pose put before its first frame."""
    return Motion(
        np.insert(motion.times, 0, motion.times[0]),
        np.concatenate([skeleton.axes[None], motion.rotations]),
        np.concatenate([skeleton.heads[None], motion.heads]),
    )


def _copy_body(
    context: bpy.types.Context,
    body: Body,
    former: bpy.types.Object,
    armature: bpy.types.Object,
    new_names: dict[str, str],
    unit: float,
) -> None:
    """Copy one mesh; one that was parented to a bone becomes a skin that hangs on that bone alone.

    Args:
        context: its scene is a temporary one.
        body: the user's.
        former: the user's armature.
        armature: the staged one.
        new_names: of the bones.
        unit: the file's units per metre.
    """
    staged = _own_copy(body.mesh)
    staged.name, staged.data.name = body.name, body.data_name
    _cut_loose(staged)
    context.scene.collection.objects.link(staged)
    staged.data.transform(Matrix.Scale(unit, 4) @ body.rest, shape_keys=True)
    staged.parent = armature
    for modifier in staged.modifiers:
        if modifier.type == "ARMATURE" and modifier.object == former:
            modifier.object = armature
    if body.carrier:
        staged.vertex_groups.clear()
        staged.vertex_groups.new(name=body.carrier).add(range(len(staged.data.vertices)), 1.0, "REPLACE")
        staged.modifiers.new("Armature", "ARMATURE").object = armature
    groups = list(staged.vertex_groups)
    _rename(groups, [str(new_names.get(group.name, group.name)) for group in groups])
