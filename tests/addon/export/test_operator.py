"""The export operator: who is meant, what is refused, what it tells, and rigs of all kinds."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import write_take
from tests.addon.blender_truth import data_counts
from tests.addon.take_factory import make_take

from .test_profiles import SPEC, heads, read_back


@pytest.fixture
def scene(bpy: Any, tmp_path: Path) -> Any:
    write_take(tmp_path / "match.npz", make_take(SPEC))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"), cloud=False)
    bpy.ops.object.select_all(action="DESELECT")
    return bpy.context.scene


def run(bpy: Any, folder: Path, **options: Any) -> set[str]:
    assert bpy.ops.scene_aware_mocap.export(directory=str(folder), **options) == {"FINISHED"}
    return {path.name for path in folder.iterdir()}


def test_the_selection_is_exported_else_all(scene: Any, bpy: Any, tmp_path: Path) -> None:
    assert run(bpy, tmp_path / "all", engine="unity") == {"scene_Person 1.fbx", "scene_Person 2.fbx"}
    bpy.data.objects["Person 2 body"].select_set(True)
    assert run(bpy, tmp_path / "selected", engine="unity") == {"scene_Person 2.fbx"}
    assert run(bpy, tmp_path / "named", engine="unity", characters="Person 1", file_name="a b") == {"a b_Person 1.fbx"}


def test_what_was_found_is_told_in_the_section(scene: Any, bpy: Any, tmp_path: Path) -> None:
    run(bpy, tmp_path / "out", engine="godot")
    rows = scene.mocap_export.checks
    assert [(row.name, row.file, row.passed) for row in rows] == [
        ("Person 1", "scene.glb", True),
        ("Person 2", "scene.glb", True),
    ]
    assert "25 bones, joints within 0.0" in rows[0].text


def test_wishes_go_before_the_profile(scene: Any, bpy: Any, tmp_path: Path) -> None:
    files = run(bpy, tmp_path / "out", engine="unreal", file_format="glb", files="ALL", contents="MOTION", camera=True)
    assert files == {"scene.glb"}
    read_back(bpy, tmp_path / "out" / "scene.glb")
    kinds = sorted(obj.type for obj in bpy.data.objects)
    assert kinds.count("ARMATURE") == 2
    assert kinds.count("CAMERA") == 1


def test_names_and_folders_may_be_anything(scene: Any, bpy: Any, tmp_path: Path) -> None:
    bpy.data.objects["Person 1"].name = "Анна: 二/été"
    names = run(bpy, tmp_path / "два человека 二", engine="unreal", file_name="дубль 1")
    assert names == {"дубль 1_Анна_ 二_été.fbx", "дубль 1_Person 2.fbx"}
    assert all(row.passed for row in scene.mocap_export.checks)


def test_the_users_scene_stays_as_it_is(scene: Any, bpy: Any, tmp_path: Path) -> None:
    person = bpy.data.objects["Person 1"]
    bpy.context.view_layer.objects.active = person
    bpy.ops.object.mode_set(mode="POSE")
    scene.frame_set(4, subframe=0.25)
    person["mark"] = 1
    before = data_counts(bpy), sorted(obj.name for obj in bpy.data.objects), [a.name for a in bpy.data.actions]
    run(bpy, tmp_path / "out", engine="unreal")
    assert (
        data_counts(bpy),
        sorted(obj.name for obj in bpy.data.objects),
        [a.name for a in bpy.data.actions],
    ) == before
    assert (bpy.context.mode, bpy.context.view_layer.objects.active) == ("POSE", person)
    assert scene.frame_current_final == 4.25
    assert next(bone.name for bone in person.data.bones) == "pelvis"
    assert bpy.data.meshes["Person 1 body"].users == 1
    bpy.ops.object.mode_set(mode="OBJECT")


def test_refusals_name_the_reason_and_write_nothing(scene: Any, bpy: Any, tmp_path: Path) -> None:
    blocked = tmp_path / "a file"
    blocked.write_text("in the way")
    cases: list[tuple[str, dict[str, Any]]] = [
        ("no folder to export to", {"directory": ""}),
        ("save it first", {"directory": "//out"}),
        ("no object 'Anna'", {"directory": str(tmp_path / "out"), "characters": "Person 1, Anna"}),
        ("nobody to export", {"directory": str(tmp_path / "out"), "characters": "Take camera"}),
        ("cannot write to", {"directory": str(blocked / "out")}),
    ]
    before = data_counts(bpy)
    for reason, options in cases:
        with pytest.raises(RuntimeError, match=reason) as refusal:
            bpy.ops.scene_aware_mocap.export(**options)
        assert "Traceback" not in str(refusal.value)
    assert data_counts(bpy) == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a file", "match.npz"]


def test_a_switched_off_exporter_is_named(scene: Any, bpy: Any, tmp_path: Path) -> None:
    import addon_utils

    addon_utils.disable("io_scene_gltf2")
    try:
        with pytest.raises(RuntimeError, match=r"glTF 2\.0 add-on is switched off"):
            bpy.ops.scene_aware_mocap.export(directory=str(tmp_path / "out"))
    finally:
        addon_utils.enable("io_scene_gltf2")
    assert not (tmp_path / "out").exists()


def build_rig(bpy: Any) -> Any:
    """A rig of 1/100 metre units, turned and moved: NLA strip, constraint, a skin and a mesh that hangs on a bone."""
    data = bpy.data.armatures.new("Rig")
    rig = bpy.data.objects.new("Rig", data)
    bpy.context.scene.collection.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    hips, arm = data.edit_bones.new("hips"), data.edit_bones.new("arm")
    hips.head, hips.tail = (0, 0, 100), (0, 10, 120)
    arm.head, arm.tail, arm.parent, arm.use_connect = (0, 10, 120), (40, 10, 130), hips, True
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.scale, rig.location, rig.rotation_euler = (0.01,) * 3, (1, 2, 0), (0, 0, 0.5)
    hip = rig.pose.bones["hips"]
    hip.rotation_mode = "XYZ"
    for frame in (1, 5):
        hip.rotation_euler, hip.location = (0.1 * frame, 0.2, 0), (frame, 0, 5)
        hip.keyframe_insert("rotation_euler", frame=frame)
        hip.keyframe_insert("location", frame=frame)
    animation = rig.animation_data
    slot = getattr(animation, "action_slot", None)
    strip = animation.nla_tracks.new().strips.new("walk", 1, animation.action)
    if slot is not None:
        strip.action_slot = slot
    animation.action = None
    limit = rig.pose.bones["arm"].constraints.new("LIMIT_ROTATION")
    limit.use_limit_x, limit.min_x, limit.max_x, limit.owner_space = True, 0.6, 0.6, "LOCAL"
    for name, bone in (("skin", ""), ("hat", "arm")):
        mesh = bpy.data.meshes.new(name)
        mesh.from_pydata([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0)], [], [(0, 1, 2)])
        obj = bpy.data.objects.new(name, mesh)
        bpy.context.scene.collection.objects.link(obj)
        obj.parent = rig
        if bone:
            obj.parent_type, obj.parent_bone = "BONE", bone
            obj.scale = (100,) * 3
        else:
            obj.vertex_groups.new(name="hips").add([0, 1, 2], 1.0, "REPLACE")
            obj.modifiers.new("Armature", "ARMATURE").object = rig
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 5
    scene.render.fps = 30
    return rig


def vertices(bpy: Any, name: str, frames: list[int]) -> np.ndarray:
    found = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        obj = next(o for o in bpy.data.objects if o.name == name)
        evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrix = np.array(evaluated.matrix_world)
        points = np.array([v.co[:] for v in evaluated.to_mesh().vertices])
        found.append(points @ matrix[:3, :3].T + matrix[:3, 3])
    return np.array(found)


@pytest.mark.parametrize("engine", ["generic", "unreal"])
def test_rigs_with_constraints_strips_and_odd_units(engine: str, bpy: Any, tmp_path: Path) -> None:
    rig = build_rig(bpy)
    frames = [1, 3, 5]
    truth = heads(bpy, rig, ["hips", "arm"], frames)
    bodies = {name: vertices(bpy, name, frames) for name in ("skin", "hat")}
    assert np.ptp(bodies["hat"], axis=0).max() > 0.02
    run(bpy, tmp_path / "out", engine=engine)
    assert [row.text for row in bpy.context.scene.mocap_export.checks if not row.passed] == []
    (path,) = (tmp_path / "out").iterdir()
    read_back(bpy, path)
    (armature,) = [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]
    assert np.abs(heads(bpy, armature, ["hips", "arm"], frames) - truth).max() < 1e-3
    for name, expected in bodies.items():
        found = vertices(bpy, name, frames)
        gaps = np.linalg.norm(found[:, :, None] - expected[:, None], axis=-1)
        assert gaps.min(axis=2).max() < 1e-3
        assert gaps.min(axis=1).max() < 1e-3


@pytest.mark.parametrize("overridden", [False, True])
def test_rigs_of_other_files(overridden: bool, scene: Any, bpy: Any, tmp_path: Path) -> None:
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "library.blend"))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(tmp_path / "library.blend"), link=True) as (_, wanted):
        wanted.collections = ["match"]
    collection = bpy.data.collections["match"]
    scene = bpy.context.scene
    scene.collection.children.link(collection)
    if overridden:
        collection.override_hierarchy_create(scene, bpy.context.view_layer, do_fully_editable=True)
        scene.collection.children.unlink(collection)
    scene.frame_end = 8
    before = data_counts(bpy)
    run(bpy, tmp_path / "out", engine="unreal")
    assert [(row.name, row.passed) for row in scene.mocap_export.checks] == [("Person 1", True), ("Person 2", True)]
    assert data_counts(bpy) == before


def test_two_characters_of_one_name_are_refused(scene: Any, bpy: Any, addon: Any, tmp_path: Path) -> None:
    performance = addon("export.performance")
    person = bpy.data.objects["Person 1"]
    characters = performance.characters_among(bpy.context, [person]) * 2
    profile = addon("export.profiles").load_profile("generic")
    with pytest.raises(performance.ExportError, match="two characters are called 'Person 1'"):
        addon("export.exporting").export_characters(bpy.context, characters, profile, tmp_path / "out", "a")
    assert not (tmp_path / "out").exists()


def test_two_characters_whose_names_give_one_file_are_refused(scene: Any, bpy: Any, tmp_path: Path) -> None:
    bpy.data.objects["Person 1"].name = "A/x"
    bpy.data.objects["Person 2"].name = "a:X"
    with pytest.raises(RuntimeError, match=r"'A/x' and 'a:X' would be written to the same file scene_A_x\.fbx"):
        run(bpy, tmp_path / "out", engine="unreal")
    assert not (tmp_path / "out").exists()
    assert run(bpy, tmp_path / "out", engine="unreal", files="ALL") == {"scene.fbx"}


@pytest.mark.parametrize("file_format", ["glb", "fbx"])
def test_names_that_are_too_long_are_said_in_one_line(file_format: str, scene: Any, bpy: Any, tmp_path: Path) -> None:
    long = "n" * 300
    for folder, name in ((tmp_path / "out", long), (tmp_path / long, "scene")):
        with pytest.raises(RuntimeError, match=r"cannot write to .*: File name too long; .* place or name") as refusal:
            run(bpy, folder, file_name=name, file_format=file_format, contents="MOTION")
        assert "Traceback" not in str(refusal.value)
    assert [path.name for path in tmp_path.iterdir()] == ["match.npz"]


def test_bones_that_leave_what_they_touch_at_rest(bpy: Any, tmp_path: Path) -> None:
    """Blender's FBX importer ties such bones together; the file is right nevertheless."""
    rig = build_rig(bpy)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    rig.data.edit_bones["arm"].use_connect = False
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["arm"].location = (0, 3, 0)
    run(bpy, tmp_path / "out", engine="unity")
    assert [row.text for row in bpy.context.scene.mocap_export.checks if not row.passed] == []


def test_a_folder_that_must_not_be_written_to_is_named(
    scene: Any, bpy: Any, addon: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As root every folder may be written to: the system's refusal is played."""

    def refuse(**_: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(addon("export.exporting").tempfile, "TemporaryDirectory", refuse)
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=r"cannot write to .*out: Permission denied; .* choose another place"):
        bpy.ops.scene_aware_mocap.export(directory=str(tmp_path / "new" / "out"))
    assert data_counts(bpy) == before
    assert not (tmp_path / "new").exists()
