# SPDX-License-Identifier: GPL-3.0-or-later
"""One person's skin: the mesh at rest, bound to the armature by linear blend skinning."""

import bpy
import numpy as np
from mathutils import Color
from numpy.typing import NDArray

from core_solver.take import Person

from .armature import Rig
from .rest_pose import RestPose
from .world import rest_from_body


def build_body(collection: bpy.types.Collection, rig: Rig, person: Person, rest: RestPose) -> bpy.types.Object:
    """Create the skinned mesh under its armature.

    Args:
        collection: receives the object.
        rig: from `build_rig`.
        person: rest vertices, faces and weights.
        rest: the rest pose the bones lie in.

    Returns:
        The mesh object.
    """
    name = f"{person.name} body"
    vertices = rest_from_body(person.rest_vertices, person.scale) + rest.offset
    mesh = _mesh(name, vertices, person.faces)
    mesh.materials.append(_material(name, person.colour))
    obj = bpy.data.objects.new(name, mesh)
    collection.objects.link(obj)
    obj.parent = rig.object
    bind(obj, rig.bones, person.weight_joints, person.weights)
    modifier = obj.modifiers.new("Armature", "ARMATURE")
    modifier.object = rig.object
    return obj


def bind(
    obj: bpy.types.Object, bone_names: tuple[str, ...], joints: NDArray[np.uint8], weights: NDArray[np.float32]
) -> None:
    """Write the skinning weights as one vertex group per bone.

    Args:
        obj: a mesh object with V vertices.
        bone_names: a joint's bone.
        joints: (V, 4) joint indices; one joint may stand twice at a vertex.
        weights: (V, 4).
    """
    groups = [obj.vertex_groups.new(name=name) for name in bone_names]
    vertices, slots = np.nonzero(weights > 0)
    used = joints[vertices, slots]
    for vertex, joint, weight in zip(vertices.tolist(), used.tolist(), weights[vertices, slots].tolist(), strict=True):
        groups[joint].add((vertex,), weight, "ADD")


def _mesh(name: str, vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(vertices))
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.loops.add(faces.size)
    mesh.loops.foreach_set("vertex_index", faces.astype(np.int32).ravel())
    mesh.polygons.add(len(faces))
    mesh.polygons.foreach_set("loop_start", np.arange(0, faces.size, 3, dtype=np.int32))
    mesh.update(calc_edges=True)
    mesh.validate()
    mesh.shade_smooth()
    return mesh


def _material(name: str, colour: tuple[float, float, float]) -> bpy.types.Material:
    linear = (*Color(colour).from_srgb_to_scene_linear(), 1.0)
    material = bpy.data.materials.new(name)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    surface = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    surface.inputs["Base Color"].default_value = linear
    surface.inputs["Roughness"].default_value = 0.7
    # The solid view shows this one.
    material.diffuse_color = linear
    return material
