"""The samples: small, as their generator makes them, and what the tutorial needs is in them."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import PARENTS, Take, read_take

from .blender_truth import armature_of, bone_heads, pixels_through_camera
from .take_factory import person_joints, project

BONES = 22


@pytest.fixture(scope="module")
def samples(repo_root: Path) -> Path:
    return repo_root / "blender_addon" / "samples"


@pytest.fixture(scope="module")
def take(samples: Path) -> Take:
    return read_take(samples / "sample_take.npz")


def test_they_are_small(samples: Path) -> None:
    files = {file.name: file.stat().st_size for file in samples.iterdir()}
    assert set(files) == {"sample_take.npz", "sample_take.mp4", "sample_rig.glb", "README.md"}
    assert sum(files.values()) < 1_500_000


def test_they_are_what_the_generator_makes(samples: Path, take: Take) -> None:
    pytest.importorskip("torch")  # the generator uses the solver's own tools
    from tests.samples.people import make_take
    from tests.samples.rig import write_rig

    made = make_take()
    assert [person.name for person in take.people] == [person.name for person in made.people]
    for stored, fresh in zip(take.people, made.people, strict=True):
        for name in ("theta", "gamma", "contacts", "rest_vertices", "weights"):
            np.testing.assert_allclose(getattr(stored, name), getattr(fresh, name), atol=1e-5, err_msg=name)
    np.testing.assert_allclose(take.scene.points, made.scene.points, atol=1e-4)
    assert glb_json(samples / "sample_rig.glb").keys() == json.loads(json_chunk(write_rig())).keys()


def test_the_take_holds_what_is_to_be_tried(take: Take) -> None:
    assert len(take.people) == 3
    assert take.frame_count == 120
    joints = [person_joints(person) for person in take.people]
    hand = take.meta.joint_names.index("right_hand")
    apart = np.linalg.norm(joints[0][:, hand] - joints[1][:, hand], axis=1)
    assert (apart < 0.05).sum() >= 25  # a handshake of about a second
    up = -np.asarray(take.meta.gravity)
    feet = [take.meta.joint_names.index(f"{side}_foot") for side in ("left", "right")]
    for person, places in zip(take.people, joints, strict=True):
        for side, foot in enumerate(feet):
            speed = np.linalg.norm(np.diff(places[:, foot], axis=0), axis=1)
            standing = (person.contacts[1:, side] > 0.5) & (person.contacts[:-1, side] > 0.5)
            assert standing.any()
            assert not standing.all()
            assert speed[standing].max() < 1e-3
    climbed = joints[2][:, feet] @ up
    assert np.ptp(climbed) > 0.3  # two steps


def test_the_rig_is_a_mixamo_one_in_a_t_pose(samples: Path) -> None:
    document = glb_json(samples / "sample_rig.glb")
    names = [node["name"] for node in document["nodes"][2:]]
    assert len(names) == BONES < len(PARENTS)
    assert all(name.startswith("mixamorig:") for name in names)
    assert {"mixamorig:Hips", "mixamorig:LeftForeArm", "mixamorig:RightToeBase"} <= set(names)


def test_the_take_comes_in_before_its_footage(bpy: Any, take: Take) -> None:
    assert bpy.ops.scene_aware_mocap.load_sample_take() == {"FINISHED"}
    for person in take.people:
        armature = armature_of(bpy, person)
        truth = project(take.meta.camera, person_joints(person)[[0, 70]])
        seen = [pixels_through_camera(bpy, bone_heads(bpy, armature, [frame])[0]) for frame in (1, 71)]
        assert np.abs(np.array(seen) - truth).max() < 0.05
    (background,) = bpy.context.scene.camera.data.background_images
    assert background.clip.frame_duration == 120


def test_the_rig_stands_on_the_ground_and_faces_the_front(bpy: Any) -> None:
    assert bpy.ops.scene_aware_mocap.load_sample_rig() == {"FINISHED"}
    rig = bpy.context.object
    assert (rig.type, len(rig.data.bones)) == ("ARMATURE", BONES)
    assert [o.type for o in bpy.data.objects].count("MESH") == 1  # no balls that show bones
    bones = rig.data.bones
    toe, ankle = (bones[f"mixamorig:Left{name}"].head_local for name in ("ToeBase", "Foot"))
    assert toe.y < ankle.y - 0.05
    assert ankle.x > 0
    hips = bones["mixamorig:Hips"]
    assert (hips.tail_local - hips.head_local).normalized().z > 0.95
    body = next(o for o in bpy.data.objects if o.type == "MESH")
    heights = [vertex.co.z for vertex in body.data.vertices]
    assert abs(min(heights)) < 0.005
    assert 1.4 < max(heights) < 2.0


def json_chunk(data: bytes) -> bytes:
    (length,) = struct.unpack_from("<I", data, 12)
    return data[20 : 20 + length]


def glb_json(path: Path) -> dict[str, Any]:
    return json.loads(json_chunk(path.read_bytes()))


def test_retargeted_rigs_are_selected_and_a_second_time_still_takes_the_people(bpy: Any) -> None:
    bpy.ops.scene_aware_mocap.load_sample_take()
    bpy.ops.scene_aware_mocap.load_sample_rig()
    for _ in range(2):
        before = set(bpy.data.objects)
        assert bpy.ops.scene_aware_mocap.retarget(rig="Sample Rig", refine=False) == {"FINISHED"}
        made = {obj for obj in set(bpy.data.objects) - before if obj.type == "ARMATURE"}
        assert sorted(obj.name.split(".")[0] for obj in made) == [f"Sample Rig {n}" for n in ("Ada", "Ben", "Cleo")]
        assert set(bpy.context.selected_objects) == made
