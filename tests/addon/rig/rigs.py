"""Armatures of every awkward kind, made in Blender, and what Blender itself evaluates for them."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.addon.blender_truth import go_to


@dataclass(frozen=True)
class BoneSpec:
    name: str
    parent: str | None
    head: tuple[float, float, float]
    tail: tuple[float, float, float]
    roll: float = 0.0
    mode: str = "QUATERNION"
    inherits_rotation: bool = True
    local_location: bool = True
    connected: bool = False


AWKWARD = (
    BoneSpec("root", None, (0.1, 0.2, 0), (0.1, 0.5, 0.1), 0.7),
    BoneSpec("hips", "root", (0, 0, 1), (0.1, 0, 1.2), -1.2, "XYZ"),
    BoneSpec("spine", "hips", (0.1, 0, 1.2), (0, 0.1, 1.5), 2.0, "ZXY", connected=True),
    BoneSpec("head", "spine", (0, 0.1, 1.6), (0, 0.1, 1.9), 0.3, "AXIS_ANGLE", inherits_rotation=False),
    BoneSpec("thigh", "hips", (0.1, 0, 1), (0.15, -0.1, 0.5), 0.0, "YZX", local_location=False),
    BoneSpec("shin", "thigh", (0.15, -0.1, 0.5), (0.1, 0, 0.1), 3.0, "XZY"),
    BoneSpec("foot", "shin", (0.1, 0, 0.1), (0.1, -0.2, 0), 0.1, "YXZ", inherits_rotation=False, local_location=False),
    BoneSpec("prop", None, (1, 0, 0), (1, 1, 0.3), 0.4, "ZYX", local_location=False),
)


def make_rig(bpy: Any, specs: Iterable[BoneSpec] = AWKWARD, name: str = "Rig") -> Any:
    specs = tuple(specs)
    obj = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bones = obj.data.edit_bones
    for spec in specs:
        bone = bones.new(spec.name)
        bone.head, bone.tail, bone.roll = spec.head, spec.tail, spec.roll
        bone.parent = bones[spec.parent] if spec.parent else None
        bone.use_connect = spec.connected
        bone.use_inherit_rotation, bone.use_local_location = spec.inherits_rotation, spec.local_location
    bpy.ops.object.mode_set(mode="OBJECT")
    for spec in specs:
        obj.pose.bones[spec.name].rotation_mode = spec.mode
    return obj


def evaluated(bpy: Any, obj: Any, names: Iterable[str], frames: Iterable[float]) -> tuple[np.ndarray, np.ndarray]:
    """Axes (T, B, 3, 3), orthonormal for an evenly scaled rig, and heads (T, B, 3) in the world."""
    names = tuple(names)
    matrices = []
    for frame in frames:
        go_to(bpy, frame)
        seen = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        world = np.array(seen.matrix_world)
        matrices.append([world @ np.array(seen.pose.bones[name].matrix) for name in names])
    stacked = np.array(matrices)
    axes = stacked[..., :3, :3]
    return axes / np.linalg.norm(axes, axis=-2, keepdims=True), stacked[..., :3, 3]
