"""Each engine's files, read back by Blender's own importers: names, units, roots, and everybody's own motion."""

import dataclasses
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import JOINT_NAMES, Take
from tests.addon.blender_truth import data_counts, go_to
from tests.addon.take_factory import TakeSpec, make_take, person_joints
from tests.addon.test_import_motion import world_of

SPEC = TakeSpec(people=2, frames=8, points=8, rate=Fraction(30))


@pytest.fixture
def take() -> Take:
    return make_take(SPEC)


@pytest.fixture
def people(bpy: Any, addon: Any, take: Take) -> list[Any]:
    take_import = addon("scene_import.take_import")
    return list(import_people(bpy, take_import, take).armatures)


def import_people(bpy: Any, take_import: Any, take: Take) -> Any:
    return take_import.import_take(bpy.context, take, Path("match.npz"), take_import.ImportOptions(cloud=False))


def export(bpy: Any, addon: Any, armatures: list[Any], folder: Path, engine: str, **changes: Any) -> Any:
    profile = dataclasses.replace(addon("export.profiles").load_profile(engine), **changes)
    characters = addon("export.performance").characters_among(bpy.context, armatures)
    return addon("export.exporting").export_characters(bpy.context, characters, profile, folder, "match")


def read_back(bpy: Any, path: Path) -> None:
    """Into an empty scene of 30 frames a second."""
    bpy.ops.wm.read_homefile(use_empty=True)
    bpy.context.scene.render.fps = 30
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path), bone_heuristic="TEMPERANCE")
    else:
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)


def heads(bpy: Any, armature: Any, bones: list[str], frames: list[float]) -> np.ndarray:
    """(T, B, 3) world."""
    found = []
    for frame in frames:
        go_to(bpy, frame)
        matrix = np.array(armature.matrix_world)
        places = np.array([armature.pose.bones[name].head[:] for name in bones])
        found.append(places @ matrix[:3, :3].T + matrix[:3, 3])
    return np.array(found)


@pytest.mark.parametrize("engine", ["generic", "unreal", "unity", "godot"])
@pytest.mark.parametrize("file_format", ["glb", "fbx"])
def test_everybody_moves_as_in_the_take(
    engine: str, file_format: str, bpy: Any, addon: Any, people: list[Any], take: Take, tmp_path: Path
) -> None:
    before = data_counts(bpy)
    done = export(bpy, addon, people, tmp_path, engine, format=file_format)
    assert data_counts(bpy) == before
    assert done.passed
    assert sorted(tmp_path.iterdir()) == sorted(done.files)
    profile = addon("export.profiles").load_profile(engine)
    names = [profile.bone_names.get(name, name) for name in JOINT_NAMES]
    assert len(done.files) == (2 if profile.one_file_each else 1)
    seen = 0
    for path in done.files:
        read_back(bpy, path)
        armatures = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
        for armature in armatures:
            person = next(p for p in take.people if p.id == armature["person_id"])
            truth = world_of(take).apply(person_joints(person))
            assert np.abs(heads(bpy, armature, names, [1, 4, 8]) - truth[[0, 3, 7]]).max() < 1e-3
            assert len(armature.data.bones) == 24 + bool(profile.root_bone)
            assert armature.name == (profile.armature_name or person.name)
            if profile.root_bone:
                path_of_root = heads(bpy, armature, [profile.root_bone], [1, 4, 8])[:, 0]
                assert np.abs(path_of_root - truth[[0, 3, 7], 0] * (1, 1, 0)).max() < 1e-3
                assert armature.data.bones[names[0]].parent.name == profile.root_bone
        seen += len(armatures)
        assert {obj.name for obj in bpy.data.objects if obj.type == "MESH" and obj.vertex_groups}
    assert seen == 2


@pytest.mark.parametrize(("engine", "scale"), [("unreal", 0.01), ("unity", 1.0)])
def test_units_of_fbx_files(engine: str, scale: float, bpy: Any, addon: Any, people: list[Any], tmp_path: Path) -> None:
    done = export(bpy, addon, people[:1], tmp_path, engine)
    read_back(bpy, done.files[0])
    (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    # Blender's importer puts the file's unit on the armature object: centimetres or metres.
    assert armature.scale[:] == pytest.approx((scale,) * 3, rel=1e-4)


@pytest.mark.parametrize("file_format", ["glb", "fbx"])
def test_motion_alone_keeps_the_rest_pose(
    file_format: str, bpy: Any, addon: Any, people: list[Any], tmp_path: Path
) -> None:
    rest = np.array([people[0].data.bones[name].head_local[:] for name in JOINT_NAMES])
    done = export(bpy, addon, people[:1], tmp_path, "generic", meshes=False, format=file_format)
    assert done.passed
    read_back(bpy, done.files[0])
    assert not [obj for obj in bpy.data.objects if obj.type == "MESH" and obj.vertex_groups]
    (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    found = np.array([armature.data.bones[name].head_local[:] for name in JOINT_NAMES]) * armature.scale[0]
    turn = np.array(armature.matrix_world.to_3x3().normalized())
    assert np.abs(found @ turn.T - rest).max() < 1e-3


def test_another_frame_rate_shows_the_times_between(
    bpy: Any, addon: Any, people: list[Any], take: Take, tmp_path: Path
) -> None:
    done = export(bpy, addon, people[:1], tmp_path, "generic", frame_rate=60.0)
    assert done.passed
    read_back(bpy, done.files[0])
    (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    truth = world_of(take).apply(person_joints(take.people[0]))
    assert np.abs(heads(bpy, armature, list(JOINT_NAMES), [3]) - truth[2]).max() < 1e-3
    pelvis = heads(bpy, armature, ["pelvis"], [3.5])[0, 0]
    assert np.abs(pelvis - (truth[2, 0] + truth[3, 0]) / 2).max() < 1e-3


def test_every_profile_is_whole(addon: Any) -> None:
    profiles = addon("export.profiles")
    assert profiles.profile_ids() == ("generic", "godot", "unity", "unreal")
    for name in profiles.profile_ids():
        profile = profiles.load_profile(name)
        assert profile.format in {"glb", "fbx"}
        if profile.bone_names:
            assert set(profile.bone_names) == set(JOINT_NAMES)
            assert len(set(profile.bone_names.values())) == 24
    with pytest.raises(profiles.ProfileError, match="choose one of generic, godot"):
        profiles.load_profile("../generic")


def test_a_damaged_profile_is_named(addon: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    profiles = addon("export.profiles")
    monkeypatch.setattr(profiles, "_FOLDER", tmp_path)
    (tmp_path / "generic.json").write_text('{"title": "Only this"}')
    with pytest.raises(profiles.ProfileError, match=r"generic\.json lacks or does not know: armature_name"):
        profiles.load_profile("generic")
    (tmp_path / "broken.json").write_text("{")
    with pytest.raises(profiles.ProfileError, match=r"broken\.json cannot be read"):
        profiles.load_profile("broken")
