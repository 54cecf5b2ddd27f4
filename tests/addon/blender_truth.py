"""What Blender really evaluates and projects, read back as arrays."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from core_solver.take import JOINT_NAMES, Person


def armature_of(bpy: Any, person: Person) -> Any:
    return next(o for o in bpy.data.objects if o.type == "ARMATURE" and o.get("person_id") == person.id)


def go_to(bpy: Any, frame: float) -> None:
    whole = int(frame // 1)
    bpy.context.scene.frame_set(whole, subframe=frame - whole)


def bone_heads(bpy: Any, armature: Any, frames: Iterable[float]) -> np.ndarray:
    """(T, 24, 3) evaluated world positions, in the order of the take's joints."""
    heads = []
    for frame in frames:
        go_to(bpy, frame)
        evaluated = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        to_world = np.array(evaluated.matrix_world)
        bones = np.array([evaluated.pose.bones[name].head[:] for name in JOINT_NAMES])
        heads.append(bones @ to_world[:3, :3].T + to_world[:3, 3])
    return np.array(heads)


def evaluated_vertices(bpy: Any, obj: Any, frames: Iterable[float]) -> np.ndarray:
    """(T, V, 3) world positions with all modifiers."""
    positions = []
    for frame in frames:
        go_to(bpy, frame)
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        mesh = evaluated.to_mesh()
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        to_world = np.array(evaluated.matrix_world)
        positions.append(points.reshape(-1, 3) @ to_world[:3, :3].T + to_world[:3, 3])
        evaluated.to_mesh_clear()
    return np.array(positions)


def pixels_through_camera(bpy: Any, points: np.ndarray) -> np.ndarray:
    """(..., 2) pixels, from the image's top left corner, where Blender's active camera sees world points."""
    from bpy_extras.object_utils import world_to_camera_view
    from mathutils import Vector

    scene = bpy.context.scene
    seen = np.array([world_to_camera_view(scene, scene.camera, Vector(p)) for p in points.reshape(-1, 3)])
    width, height = scene.render.resolution_x, scene.render.resolution_y
    pixels = np.stack([seen[:, 0] * width, (1 - seen[:, 1]) * height], axis=-1)
    return pixels.reshape(*points.shape[:-1], 2)


def data_counts(bpy: Any) -> dict[str, object]:
    """How many datablocks of each kind there are, and the scene's clock and size."""
    kinds = (p.identifier for p in bpy.data.bl_rna.properties if p.type == "COLLECTION")
    counts: dict[str, object] = {kind: len(getattr(bpy.data, kind)) for kind in kinds}
    scene = bpy.context.scene
    counts["clock"] = (scene.render.fps, scene.render.fps_base, scene.frame_start, scene.frame_end)
    counts["size"] = (scene.render.resolution_x, scene.render.resolution_y)
    counts["camera"] = scene.camera and scene.camera.name
    return counts


def composite(bpy: Any, clip: Any, frame: int, path: Path, *, undistort: bool = False) -> np.ndarray:
    """(H, W) grey values in [0, 1], top row first: what Blender's compositor makes of a movie clip at a scene frame."""
    scene = bpy.context.scene
    tree, output = _compositor(bpy, scene)
    source = tree.nodes.new("CompositorNodeMovieClip")
    source.clip = clip
    if undistort:
        straighten = tree.nodes.new("CompositorNodeMovieDistortion")
        straighten.clip = clip
        tree.links.new(source.outputs["Image"], straighten.inputs["Image"])
        source = straighten
    tree.links.new(source.outputs["Image"], output.inputs[0])
    scene.render.engine = "CYCLES"
    scene.cycles.samples = 1
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(path)
    scene.frame_set(frame)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(path))
    width, height = image.size
    pixels = np.array(image.pixels[:]).reshape(height, width, 4)[::-1, :, 0]
    bpy.data.images.remove(image)
    return pixels


def _compositor(bpy: Any, scene: Any) -> tuple[Any, Any]:
    if bpy.app.version >= (5, 0):
        tree = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
        tree.interface.new_socket("Image", in_out="OUTPUT", socket_type="NodeSocketColor")
        scene.compositing_node_group = tree
        return tree, tree.nodes.new("NodeGroupOutput")
    scene.use_nodes = True
    scene.node_tree.nodes.clear()
    return scene.node_tree, scene.node_tree.nodes.new("CompositorNodeComposite")
