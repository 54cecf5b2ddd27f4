# SPDX-License-Identifier: GPL-3.0-or-later
"""One person's armature: 24 bones at real size at the world's origin, moved by keys alone."""

from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import Similarity
from core_solver.take import Meta, Person

from .actions import Curves, write_action
from .clock import Clock
from .motion import PoseChannels, pose_channels
from .presence import PRESENT, presence
from .rest_pose import RestPose

EVIDENCE = "visible_evidence"
"""Custom property of the armature object: 1 where the person was seen, 0 where the motion was filled in."""

PRESENT_FROM, PRESENT_UNTIL = "present_from_s", "present_until_s"
"""Custom properties of the armature object: when the person is there, in seconds from the scene's frame 0, which are
those of an exported animation. A game engine can hide the body at other times: GLB and FBX cannot."""

CONTACTS = ("contact_left", "contact_right")
"""Custom properties of the armature object: probability that the left and the right foot stand on something."""

CONFIDENCE = "confidence"
"""Custom property of the armature object: how sure the solver is of the pose, 0..1, the mean over the joints."""


@dataclass(frozen=True)
class Rig:
    """An armature and the order of the take in it: Blender sorts bones by its own rules.

    Attributes:
        object: the armature object.
        bones: the 24 joints' bones by name, in the take's order.
    """

    object: bpy.types.Object
    bones: tuple[str, ...]


def build_rig(
    context: bpy.types.Context, collection: bpy.types.Collection, person: Person, meta: Meta, rest: RestPose
) -> Rig:
    """Create the armature at rest.

    Args:
        context: in object mode.
        collection: linked to the current scene; receives the object.
        person: whose it is.
        meta: names and parents of the joints, body model and licence.
        rest: where the bones lie.

    Returns:
        The rig at the world's origin.
    """
    armature = bpy.data.armatures.new(person.name)
    obj = bpy.data.objects.new(person.name, armature)
    collection.objects.link(obj)
    obj.show_in_front = True
    bones = _lay_bones(context, obj, meta, rest)
    for bone in obj.pose.bones:
        bone.rotation_mode = "QUATERNION"
    obj["person_id"] = person.id
    obj["height_m"] = person.height_m
    obj["body_model"] = meta.body_model
    obj["body_licence"] = meta.body_licence
    return Rig(obj, bones)


def animate_rig(rig: Rig, person: Person, world: Similarity, clock: Clock) -> None:
    """Key the person's motion: rotations on every bone, the path through the world on the pelvis.

    Args:
        rig: from `build_rig`.
        person: at the clock's moments.
        world: camera frame to world.
        clock: the scene frames of the keys.
    """
    obj = rig.object
    there = np.flatnonzero(presence(person.valid))
    obj[PRESENT_FROM], obj[PRESENT_UNTIL] = (clock.seconds(int(frame)) for frame in there[[0, -1]])
    rest = np.array([obj.data.bones[name].matrix_local for name in rig.bones], float)
    channels = pose_channels(person, world, rest[:, :3, :3], rest[0, :3, 3])
    curves = [
        *_bone_curves(rig, channels),
        *_evidence_curves(obj, person),
    ]
    write_action(obj, f"{obj.name} motion", clock.frames, curves)


def _lay_bones(context: bpy.types.Context, obj: bpy.types.Object, meta: Meta, rest: RestPose) -> tuple[str, ...]:
    # Edit bones exist in edit mode only, and edit mode works on the active object.
    context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    try:
        bones = [obj.data.edit_bones.new(name) for name in meta.joint_names]
        for bone, head, tail, z_axis, parent in zip(
            bones, rest.heads, rest.tails, rest.z_axes, meta.parents, strict=True
        ):
            bone.head, bone.tail = head, tail
            bone.align_roll(z_axis)
            bone.parent = bones[parent] if parent >= 0 else None
        return tuple(bone.name for bone in bones)
    finally:
        bpy.ops.object.mode_set(mode="OBJECT")


def _bone_curves(rig: Rig, channels: PoseChannels) -> list[Curves]:
    bones = [rig.object.pose.bones[name] for name in rig.bones]
    curves = [Curves(bones[0].path_from_id("location"), channels.root, bones[0].name)]
    for index, bone in enumerate(bones):
        path = bone.path_from_id("rotation_quaternion")
        curves.append(Curves(path, channels.rotations[:, index], bone.name))
    return curves


def _evidence_curves(obj: bpy.types.Object, person: Person) -> list[Curves]:
    left, right = np.moveaxis(np.asarray(person.contacts, float), -1, 0)
    flag, share = "CONSTANT", "LINEAR"
    return [
        _property_curve(obj, EVIDENCE, person.valid, flag, "1 where seen, 0 where filled in"),
        _property_curve(obj, PRESENT, presence(person.valid), flag, "1 from the first to the last frame seen"),
        _property_curve(obj, CONTACTS[0], left, share, "Probability that the left foot stands on something"),
        _property_curve(obj, CONTACTS[1], right, share, "Probability that the right foot stands on something"),
        _property_curve(obj, CONFIDENCE, person.confidence.mean(axis=1), share, "How sure the solver is of the pose"),
    ]


def _property_curve(
    obj: bpy.types.Object, name: str, numbers: NDArray[Any], interpolation: str, description: str
) -> Curves:
    """Give an object a custom property between 0 and 1, and make its curve."""
    values = np.asarray(numbers, float)
    obj[name] = float(values[0])
    obj.id_properties_ui(name).update(min=0.0, max=1.0, description=description)
    return Curves(f'["{name}"]', values[:, None], "Evidence", interpolation)
