# SPDX-License-Identifier: GPL-3.0-or-later
"""The take's camera: Blender's lens, shift, resolution and pixel aspect from a pinhole's intrinsics, exactly."""

from dataclasses import dataclass

import bpy
from mathutils import Matrix

from core_solver.geometry import Similarity
from core_solver.take import CameraModel

from .world import lens_matrix

SENSOR_WIDTH_MM = 36.0
_NEAREST_CLIP_END = 100.0


@dataclass(frozen=True)
class Lens:
    """A pinhole camera in Blender's terms, for a horizontal sensor fit.

    Attributes:
        focal_length: millimetres on a sensor of `SENSOR_WIDTH_MM`.
        shift_x: image widths, positive when the principal point lies left of the image's centre.
        shift_y: image widths, positive when the principal point lies below the image's centre.
        aspect_x: width of a pixel.
        aspect_y: height of a pixel; the smaller of both is 1, as Blender wants.
    """

    focal_length: float
    shift_x: float
    shift_y: float
    aspect_x: float
    aspect_y: float


def lens_of(camera: CameraModel) -> Lens:
    """Intrinsics in Blender's terms.

    Unequal focal lengths are pixels that are not square: a pixel is fx / fy times as high as it is wide. Blender
    measures both shifts in image widths, the vertical one along such stretched pixels.
    """
    stretch = camera.fx / camera.fy
    return Lens(
        focal_length=SENSOR_WIDTH_MM * camera.fx / camera.width,
        shift_x=(camera.width / 2 - camera.cx) / camera.width,
        shift_y=(camera.cy - camera.height / 2) * stretch / camera.width,
        aspect_x=max(1.0, 1 / stretch),
        aspect_y=max(1.0, stretch),
    )


def build_camera(
    scene: bpy.types.Scene, collection: bpy.types.Collection, camera: CameraModel, world: Similarity, farthest: float
) -> bpy.types.Object:
    """Create the camera, make it the scene's and give the scene the video's resolution.

    Args:
        scene: receives resolution and active camera.
        collection: receives the object.
        camera: intrinsics.
        world: camera frame to world.
        farthest: depth in metres that must not be clipped.

    Returns:
        The camera object.
    """
    lens = lens_of(camera)
    data = bpy.data.cameras.new("Take camera")
    data.sensor_fit = "HORIZONTAL"
    data.sensor_width = SENSOR_WIDTH_MM
    data.lens = lens.focal_length
    data.shift_x, data.shift_y = lens.shift_x, lens.shift_y
    data.clip_start = 0.05
    data.clip_end = max(_NEAREST_CLIP_END, 2 * farthest)
    obj = bpy.data.objects.new(data.name, data)
    obj.matrix_world = Matrix(lens_matrix(world).tolist())
    collection.objects.link(obj)
    scene.camera = obj
    _set_resolution(scene.render, camera, lens)
    return obj


def _set_resolution(render: bpy.types.RenderSettings, camera: CameraModel, lens: Lens) -> None:
    render.resolution_x, render.resolution_y = camera.width, camera.height
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = lens.aspect_x, lens.aspect_y
