"""Joints, skin and camera of an imported take against the take's own numbers."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.geometry import GroundFrame, Similarity, world_from_camera
from core_solver.take import JOINT_NAMES, Take, write_take

from .blender_truth import armature_of, bone_heads, evaluated_vertices, pixels_through_camera
from .take_factory import TakeSpec, make_take, person_joints, person_vertices, project

SPECS = {
    "landscape": TakeSpec(),
    "portrait": TakeSpec(width=608, height=1080, fx=870.0, fy=870.0, cx=290.0, cy=575.0, seed=1),
    "oblong_pixels": TakeSpec(width=720, height=576, fx=800.0, fy=733.0, cx=402.0, cy=250.0, people=1, seed=2),
    "tall_pixels": TakeSpec(width=480, height=640, fx=500.0, fy=641.5, cx=200.0, cy=390.0, people=3, seed=3),
    # What solved clips are like: a portrait phone or lab camera, people who come late and leave early, smooth skins.
    "as_solved": TakeSpec(
        width=1088, height=1920, fx=1682.0, fy=1682.0, cx=533.5, cy=948.6, people=4, frames=16,
        absence=5, vertices=1229, distortion=(-0.3, 0.12, 0.01, -0.008, 0.02),
        rate=Fraction(60), first_frame=7, frame_step=2, seed=4,
    ),
}  # fmt: skip


def world_of(take: Take) -> Similarity:
    meta = take.meta
    return world_from_camera(GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset))


def frames(take: Take) -> range:
    return range(1, take.frame_count + 1)


@pytest.fixture(params=list(SPECS))
def imported(request: pytest.FixtureRequest, bpy: Any, tmp_path: Path) -> Take:
    take = make_take(SPECS[request.param])
    path = tmp_path / "match.npz"
    write_take(path, take)
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(path)) == {"FINISHED"}
    return take


def test_bone_heads_are_the_joints(imported: Take, bpy: Any) -> None:
    world = world_of(imported)
    for person in imported.people:
        heads = bone_heads(bpy, armature_of(bpy, person), frames(imported))
        error = np.linalg.norm(heads - world.apply(person_joints(person)), axis=-1)
        assert error.max() < 1e-4


def test_projection_through_the_camera_is_the_takes_own(imported: Take, bpy: Any) -> None:
    for person in imported.people:
        heads = bone_heads(bpy, armature_of(bpy, person), frames(imported))
        expected = project(imported.meta.camera, person_joints(person))
        assert np.abs(pixels_through_camera(bpy, heads) - expected).max() < 0.05


def test_skin_is_linear_blend_skinning(imported: Take, bpy: Any) -> None:
    world = world_of(imported)
    for person in imported.people:
        armature = armature_of(bpy, person)
        first, last = np.flatnonzero(person.valid)[[0, -1]]
        # Blender leaves a body as it is while it is hidden.
        vertices = evaluated_vertices(bpy, armature.children[0], range(first + 1, last + 2))
        error = np.linalg.norm(vertices - world.apply(person_vertices(person)[first : last + 1]), axis=-1)
        assert error.max() < 1e-4


def test_quaternions_never_flip(imported: Take, bpy: Any) -> None:
    for person in imported.people:
        armature = armature_of(bpy, person)
        quaternions = []
        for frame in frames(imported):
            bpy.context.scene.frame_set(frame)
            quaternions.append([armature.pose.bones[name].rotation_quaternion[:] for name in JOINT_NAMES])
        assert np.sum(np.diff(quaternions, axis=0) ** 2, axis=-1).max() < 1.0


def test_rest_pose_stands_upright_and_symmetric(imported: Take, bpy: Any) -> None:
    for person in imported.people:
        armature = armature_of(bpy, person)
        assert np.allclose(armature.matrix_world, np.eye(4))
        rest = {bone.name: np.array(bone.matrix_local) for bone in armature.data.bones}
        assert set(rest) == set(JOINT_NAMES)
        heads = np.array([rest[name][:3, 3] for name in JOINT_NAMES])
        size = person.scale * np.asarray(person.rest_joints, float)
        # x to the body's left, y to its back, z up: SMPL's x, -z, y.
        expected = np.stack([size[:, 0], -size[:, 2], size[:, 1]], axis=-1)
        assert np.allclose(heads - heads[0], expected - expected[0], atol=1e-6)
        for name in JOINT_NAMES:
            if name.startswith("left_"):
                mirror = np.diag([-1.0, 1.0, 1.0])
                right = rest[name.replace("left_", "right_")][:3, :3]
                # A mirrored bone has mirrored y and z; x follows from the right-hand rule.
                assert np.allclose(right, mirror @ rest[name][:3, :3] @ mirror, atol=1e-4)
        assert rest["head"][2, 1] > 0.99
        assert rest["left_foot"][1, 1] < -0.99
        assert rest["left_knee"][2, 1] < -0.9
