"""The synthetic humanoids as armatures in Blender, with the bone names of a well-known kind of rig and a skin."""

from typing import Any

import numpy as np

from tests.addon.retarget.skeletons import Build, make_rig

_LIMBS = {
    "clavicle": "Shoulder", "upper_arm": "Arm", "forearm": "ForeArm", "hand": "Hand", "thigh": "UpLeg", "shin": "Leg",
    "foot": "Foot", "toe": "ToeBase",
}  # fmt: skip
_TRUNK = {"hips": "Hips", "spine1": "Spine", "spine2": "Spine1", "spine3": "Spine2", "neck": "Neck", "head": "Head"}


def bone_name(role: str) -> str:
    """The name that a part of the synthetic humanoids has in Blender."""
    side, _, limb = role.partition("_")
    return f"mixamorig:{side.title()}{_LIMBS[limb]}" if limb in _LIMBS else f"mixamorig:{_TRUNK.get(role, role)}"


def humanoid(bpy: Any, addon: Any, build: Build, name: str = "Hero") -> Any:
    """An armature of that build with a small mesh on it, at rest."""
    skeleton = make_rig(addon, build).skeleton
    obj = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(obj)
    world = skeleton.to_world
    obj.matrix_world = _matrix(world)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    bones = []
    for index, role in enumerate(skeleton.names):
        bone = obj.data.edit_bones.new(bone_name(role))
        bone.head, bone.tail = (
            (place - world.translation) @ world.rotation / world.scale
            for place in (skeleton.heads[index], skeleton.tails[index])
        )
        bone.align_roll(world.rotation.T @ skeleton.axes[index, :, 2])
        bone.parent = bones[skeleton.parents[index]] if skeleton.parents[index] >= 0 else None
        bones.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    _add_skin(bpy, obj)
    return obj


def _add_skin(bpy: Any, rig: Any) -> None:
    mesh = bpy.data.meshes.new(f"{rig.name} skin")
    mesh.from_pydata([bone.head_local[:] for bone in rig.data.bones], [], [])
    skin = bpy.data.objects.new(mesh.name, mesh)
    bpy.context.scene.collection.objects.link(skin)
    skin.parent = rig
    for index, bone in enumerate(rig.data.bones):
        skin.vertex_groups.new(name=bone.name).add([index], 1.0, "REPLACE")
    skin.modifiers.new("Armature", "ARMATURE").object = rig


def _matrix(world: Any) -> list[list[float]]:
    matrix = np.eye(4)
    matrix[:3, :3] = world.scale * world.rotation
    matrix[:3, 3] = world.translation
    return matrix.T.tolist()
