# SPDX-License-Identifier: GPL-3.0-or-later
"""The static scene as coloured points: mesh vertices that geometry nodes draw as small spheres.

A mesh works alike in every Blender since 4.2, and takes a million points in a fraction of a second. The colours show
in the material preview and in renders.
"""

import math
from dataclasses import replace

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import Similarity
from core_solver.take import CameraModel, Scene

COLOUR = "Col"
RADIUS = "radius"
MARK = "scene_points"
"""Custom property by which a cloud's object is known as one, whatever its name."""

_NAME = "Scene cloud"


def build_cloud(
    collection: bpy.types.Collection, scene: Scene, camera: CameraModel, world: Similarity
) -> bpy.types.Object:
    """Create the cloud's object at the world's origin.

    Args:
        collection: receives the object.
        scene: points in the camera's frame and their colours.
        camera: gives the size of a point.
        world: camera frame to world.

    Returns:
        The object; its points have the attributes `COLOUR` and `RADIUS`.
    """
    mesh = bpy.data.meshes.new(_NAME)
    mesh.vertices.add(len(scene.points))
    mesh.vertices.foreach_set("co", world.apply(scene.points).astype(np.float32).ravel())
    colours = mesh.color_attributes.new(COLOUR, "BYTE_COLOR", "POINT")
    colours.data.foreach_set("color_srgb", _rgba(scene.colors).ravel())
    radii = mesh.attributes.new(RADIUS, "FLOAT", "POINT")
    radii.data.foreach_set("value", point_radii(scene, camera))
    mesh.update()
    obj = bpy.data.objects.new(_NAME, mesh)
    obj[MARK] = 1
    collection.objects.link(obj)
    material = _colour_material()
    mesh.materials.append(material)
    obj.modifiers.new("Points", "NODES").node_group = _points_from_mesh(material)
    return obj


def thinned(scene: Scene, density: float) -> Scene:
    """The scene with a share of its points, spread evenly: the same ones every time, and all of them among more.

    Args:
        scene: P points.
        density: share of the points to keep, 0..1.
    """
    count = len(scene.points)
    kept = np.sort(np.random.default_rng(0).permutation(count)[: round(density * count)])
    return replace(scene, points=scene.points[kept], colors=scene.colors[kept])


def point_radii(scene: Scene, camera: CameraModel) -> NDArray[np.float32]:
    """(P,) metres: with so many points spread over the image, neighbours just touch when seen from the camera."""
    spacing = math.sqrt(camera.width * camera.height / max(len(scene.points), 1))
    return np.float32(0.5 * spacing / camera.fx) * scene.points[:, 2]


def _rgba(colours: NDArray[np.uint8]) -> NDArray[np.float32]:
    alpha = np.full((len(colours), 1), 255, np.uint8)
    return np.concatenate([colours, alpha], axis=1).astype(np.float32) / np.float32(255)


def _colour_material() -> bpy.types.Material:
    """Shows the points' colours as filmed, without any light."""
    material = bpy.data.materials.new(_NAME)
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    colour = tree.nodes.new("ShaderNodeAttribute")
    colour.attribute_name = COLOUR
    emission = tree.nodes.new("ShaderNodeEmission")
    output = tree.nodes.new("ShaderNodeOutputMaterial")
    tree.links.new(colour.outputs["Color"], emission.inputs["Color"])
    tree.links.new(emission.outputs["Emission"], output.inputs["Surface"])
    return material


def _points_from_mesh(material: bpy.types.Material) -> bpy.types.NodeTree:
    tree = bpy.data.node_groups.new("Points from mesh", "GeometryNodeTree")
    for direction in ("INPUT", "OUTPUT"):
        tree.interface.new_socket("Geometry", in_out=direction, socket_type="NodeSocketGeometry")
    start, end = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    radius = tree.nodes.new("GeometryNodeInputNamedAttribute")
    radius.data_type = "FLOAT"
    radius.inputs["Name"].default_value = RADIUS
    points = tree.nodes.new("GeometryNodeMeshToPoints")
    paint = tree.nodes.new("GeometryNodeSetMaterial")
    paint.inputs["Material"].default_value = material
    tree.links.new(start.outputs[0], points.inputs["Mesh"])
    tree.links.new(radius.outputs["Attribute"], points.inputs["Radius"])
    tree.links.new(points.outputs[0], paint.inputs["Geometry"])
    tree.links.new(paint.outputs["Geometry"], end.inputs[0])
    return tree
