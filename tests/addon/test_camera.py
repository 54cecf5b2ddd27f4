"""Any pinhole camera becomes a Blender camera that sees the same pixels."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.geometry import Similarity, matrix_from_rotvec
from core_solver.take import CameraModel

from .blender_truth import pixels_through_camera
from .take_factory import project

sizes = st.integers(64, 4096)
camera_models = st.builds(
    lambda width, height, focal, stretch, x, y: CameraModel(
        width, height, focal * width, focal * width * stretch, x * width, y * height
    ),
    sizes,
    sizes,
    st.floats(0.4, 4.0),
    st.floats(0.5, 2.0),
    st.floats(-0.2, 1.2),
    st.floats(-0.2, 1.2),
)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(model=camera_models, turn=st.tuples(*[st.floats(-3, 3)] * 3), place=st.tuples(*[st.floats(-20, 20)] * 3))
def test_same_pixels(
    model: CameraModel, turn: tuple[float, ...], place: tuple[float, ...], bpy: Any, addon: Any
) -> None:
    scene = bpy.context.scene
    world = Similarity(matrix_from_rotvec(turn), np.array(place))
    camera = addon("scene_import.camera").build_camera(scene, scene.collection, model, world, 10.0)
    bpy.context.view_layer.update()
    rays = np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0], [-0.4, 0.5, 1.0], [0.1, 0.6, 1.0]])
    points = rays * np.array([2.0, 5.0, 11.0, 40.0])[:, None]
    seen = pixels_through_camera(bpy, world.apply(points))
    assert np.abs(seen - project(model, points)).max() < 0.5
    bpy.data.objects.remove(camera)


@pytest.mark.parametrize(("farthest", "clip_end"), [(0.0, 100.0), (30.0, 100.0), (400.0, 800.0)])
def test_nothing_far_is_clipped(farthest: float, clip_end: float, bpy: Any, addon: Any) -> None:
    scene = bpy.context.scene
    world = Similarity(np.eye(3), np.zeros(3))
    model = CameraModel(640, 480, 500.0, 500.0, 320.0, 240.0)
    camera = addon("scene_import.camera").build_camera(scene, scene.collection, model, world, farthest)
    assert camera.data.clip_end == pytest.approx(clip_end)
