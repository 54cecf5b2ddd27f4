"""GLB and FBX, read back by Blender's own importers: every person moves as in the take."""

import json
import struct
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.geometry import GroundFrame, world_from_camera
from core_solver.take import Take

from .blender_truth import armature_of, bone_heads, evaluated_vertices
from .take_factory import TakeSpec, make_take, person_joints, person_vertices

SPEC = TakeSpec(people=3, frames=10)


def world_joints(take: Take) -> list[np.ndarray]:
    meta = take.meta
    ground = GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)
    return [world_from_camera(ground).apply(person_joints(person)) for person in take.people]


def export(bpy: Any, addon: Any, take: Take, path: Path) -> None:
    take_import = addon("scene_import.take_import")
    imported = take_import.import_take(bpy.context, take, path, take_import.ImportOptions(cloud=False))
    objects = [*imported.armatures, *imported.bodies, imported.camera]
    addon("export.exporting").export_objects(bpy.context, objects, path)


def frames_at_30(take: Take) -> list[float]:
    """Where the take's frames lie in a scene of exactly 30 frames a second."""
    return [30 * frame / float(take.meta.frame_rate) for frame in range(1, take.frame_count + 1)]


def test_glb_has_every_person_with_their_own_motion(bpy: Any, addon: Any, tmp_path: Path) -> None:
    take = make_take(SPEC)
    export(bpy, addon, take, tmp_path / "scene.glb")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.render.fps = 30
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "scene.glb"), bone_heuristic="TEMPERANCE")
    motions = []
    for person, joints in zip(take.people, world_joints(take), strict=True):
        armature = armature_of(bpy, person)
        heads = bone_heads(bpy, armature, frames_at_30(take))
        assert np.linalg.norm(heads - joints, axis=-1).max() < 1e-3
        animation = armature.animation_data
        motions.append((animation.action.name, getattr(animation, "action_slot_handle", None)))
    assert len(set(motions)) == len(take.people)


def test_glb_holds_one_animation_at_the_takes_times(bpy: Any, addon: Any, tmp_path: Path) -> None:
    take = make_take(SPEC)
    export(bpy, addon, take, tmp_path / "scene.glb")
    content = (tmp_path / "scene.glb").read_bytes()
    length = struct.unpack_from("<I", content, 12)[0]
    document = json.loads(content[20 : 20 + length])
    (animation,) = document["animations"]
    assert animation["name"] == "scene"
    times = {document["accessors"][s["input"]]["count"]: s["input"] for s in animation["samplers"]}
    clock = document["accessors"][times[max(times)]]
    # Scene frame 1 is the first frame: the clock starts one frame after zero.
    frame = 1001 / 30000
    assert clock["min"] == pytest.approx([frame], rel=1e-5)
    assert clock["max"] == pytest.approx([take.frame_count * frame], rel=1e-5)
    assert len(document["skins"]) == len(take.people)
    assert len(document["cameras"]) == 1


def test_glb_skin_follows(bpy: Any, addon: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=1, frames=6))
    export(bpy, addon, take, tmp_path / "scene.glb")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.render.fps = 30
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "scene.glb"), bone_heuristic="TEMPERANCE")
    meta = take.meta
    ground = GroundFrame(np.array(meta.gravity), np.array(meta.ground.normal), meta.ground.offset)
    expected = world_from_camera(ground).apply(person_vertices(take.people[0]))
    body = next(o for o in bpy.data.objects if o.type == "MESH" and o.vertex_groups)
    found = evaluated_vertices(bpy, body, frames_at_30(take))
    # The exporter may split and reorder vertices: each must lie on one of the take's.
    gaps = np.linalg.norm(found[:, :, None] - expected[:, None], axis=-1).min(axis=2)
    assert gaps.max() < 1e-3


@pytest.mark.parametrize("rate", [Fraction(30), Fraction(30000, 1001)])
def test_fbx_has_every_person_with_their_own_motion(rate: Fraction, bpy: Any, addon: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=3, frames=10, rate=rate))
    export(bpy, addon, take, tmp_path / "scene.fbx")
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.ops.import_scene.fbx(filepath=str(tmp_path / "scene.fbx"), anim_offset=0.0)
    # Blender's FBX importer counts whole frames a second even where the file says 29.97.
    counted = round(rate) / float(rate)
    actions = set()
    for index, joints in enumerate(world_joints(take), start=1):
        armature = bpy.data.objects[f"Person {index}"]
        heads = bone_heads(bpy, armature, [counted * frame for frame in range(1, take.frame_count + 1)])
        assert np.linalg.norm(heads - joints, axis=-1).max() < 1e-3
        assert len(armature.data.bones) == 24
        actions.add(armature.animation_data.action.name)
    assert len(actions) == len(take.people)


def test_a_failed_export_keeps_the_old_file(bpy: Any, addon: Any, tmp_path: Path, monkeypatch: Any) -> None:
    take = make_take(TakeSpec(people=1, frames=3, points=8))
    (tmp_path / "scene.glb").write_bytes(b"old")

    def break_off(_context: Any, path: Path, _profile: Any) -> None:
        path.write_bytes(b"half")
        raise RuntimeError("Error: the disk is full")

    monkeypatch.setattr(addon("export.writing"), "_write_glb", break_off)
    with pytest.raises(addon("export.exporting").ExportError, match="disk is full"):
        export(bpy, addon, take, tmp_path / "scene.glb")
    assert (tmp_path / "scene.glb").read_bytes() == b"old"
    with pytest.raises(addon("export.exporting").ExportError, match="disk is full"):
        export(bpy, addon, take, tmp_path / "new" / "deep" / "scene.glb")
    assert [p.name for p in tmp_path.iterdir()] == ["scene.glb"]
