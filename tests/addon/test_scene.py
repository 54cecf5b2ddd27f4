"""The rest of the imported scene: clock, collections, camera settings, points, facts about people, undo."""

from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import Take, write_take

from .blender_truth import armature_of, data_counts
from .take_factory import TakeSpec, make_take

Importer = Callable[..., Take]


@pytest.fixture
def import_spec(bpy: Any, tmp_path: Path) -> Importer:
    def run(spec: TakeSpec, **options: object) -> Take:
        take = make_take(spec)
        path = tmp_path / "match.npz"
        write_take(path, take)
        assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(path), **options) == {"FINISHED"}
        return take

    return run


@pytest.mark.parametrize("rate", ["30000/1001", "24000/1001", "25", "25/2", "60", "2997/100", "1/2", "240000/1001"])
def test_scene_runs_at_the_takes_rate(rate: str, import_spec: Importer, bpy: Any) -> None:
    take = import_spec(TakeSpec(rate=Fraction(rate), frames=7, people=1, points=8))
    render = bpy.context.scene.render
    assert render.fps / render.fps_base == pytest.approx(float(take.meta.frame_rate), rel=1e-7)
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == (1, 7)
    assert bpy.context.scene.frame_current == 1


def test_everything_lies_in_one_collection_per_person_and_one_for_the_scene(import_spec: Importer, bpy: Any) -> None:
    take = import_spec(TakeSpec(people=3))
    root = bpy.context.scene.collection.children["match"]
    assert {c.name for c in root.children} == {"match scene", *(p.name for p in take.people)}
    assert {o.type for o in root.children["match scene"].objects} == {"CAMERA", "MESH"}
    for person in take.people:
        assert {o.type for o in root.children[person.name].objects} == {"ARMATURE", "MESH"}


def test_a_second_import_keeps_the_first(import_spec: Importer, bpy: Any) -> None:
    import_spec(TakeSpec(people=2, points=8))
    import_spec(TakeSpec(people=2, points=8))
    armatures = [o for o in bpy.data.objects if o.type == "ARMATURE"]
    assert len(armatures) == 4
    assert len({o.animation_data.action.name for o in armatures}) == 4


def test_people_carry_their_facts(import_spec: Importer, bpy: Any) -> None:
    take = import_spec(TakeSpec(people=2))
    for person in take.people:
        armature = armature_of(bpy, person)
        assert armature["height_m"] == pytest.approx(person.height_m)
        assert armature["body_model"] == take.meta.body_model
        assert armature["body_licence"] == take.meta.body_licence
        names = ("visible_evidence", "contact_left", "contact_right", "confidence")
        told = []
        for frame in range(1, take.frame_count + 1):
            bpy.context.scene.frame_set(frame)
            told.append([armature[name] for name in names])
        seen, left, right, confidence = np.array(told).T
        assert np.array_equal(seen > 0.5, person.valid)
        assert 0 < person.valid.sum() < take.frame_count
        assert np.allclose(np.stack([left, right], axis=1), person.contacts, atol=1e-6)
        assert np.allclose(confidence, person.confidence.mean(axis=1), atol=1e-6)


def test_points_lie_on_the_ground_with_the_takes_colours(import_spec: Importer, bpy: Any) -> None:
    take = import_spec(TakeSpec(people=0, points=600))
    (cloud,) = (obj for obj in bpy.context.scene.collection.all_objects if obj.get("scene_points") == 1)
    evaluated = cloud.evaluated_get(bpy.context.evaluated_depsgraph_get())
    colours = np.empty(4 * 600, np.float32)
    cloud.data.color_attributes["Col"].data.foreach_get("color_srgb", colours)
    assert np.abs(colours.reshape(-1, 4)[:, :3] * 255 - take.scene.colors).max() < 0.6
    heights = np.empty(3 * 600, np.float32)
    cloud.data.vertices.foreach_get("co", heights)
    # The first half of the synthetic scene is its floor, the second a wall three metres high.
    heights = heights.reshape(-1, 3)[:, 2]
    assert np.abs(heights[:300]).max() < 1e-4
    assert 2.5 < heights[300:].max() <= 3.0001
    # Geometry nodes turn every vertex into a point, so nothing of the mesh itself is left.
    assert len(evaluated.data.vertices) == 0


def test_a_hundred_thousand_points_come_in_at_once(import_spec: Importer, bpy: Any) -> None:
    import_spec(TakeSpec(people=0, points=100_000))
    assert len(bpy.data.objects["Scene cloud"].data.vertices) == 100_000


def test_camera_stands_two_metres_above_the_ground_and_level_with_gravity(import_spec: Importer, bpy: Any) -> None:
    take = import_spec(TakeSpec(people=0))
    camera = bpy.context.scene.camera
    assert np.allclose(camera.matrix_world.translation, (0, 0, 2), atol=1e-5)
    # Gravity in the camera's frame, seen from Blender's camera (y up, looking along -z), must point down the world.
    x, y, z = take.meta.gravity
    down = np.array(camera.matrix_world)[:3, :3] @ np.array([x, -y, -z])
    assert np.allclose(down, (0, 0, -1), atol=1e-5)


def test_options_leave_things_out(import_spec: Importer, bpy: Any) -> None:
    import_spec(TakeSpec(people=1), body=False, camera=False, cloud=False)
    assert [o.type for o in bpy.data.objects] == ["ARMATURE"]
    assert bpy.context.scene.camera is None


def test_import_works_from_edit_mode(import_spec: Importer, bpy: Any) -> None:
    bpy.ops.mesh.primitive_cube_add()
    bpy.ops.object.mode_set(mode="EDIT")
    import_spec(TakeSpec(people=1, points=8))
    assert bpy.context.mode == "OBJECT"


def test_undo_brings_the_old_scene_back(bpy: Any, tmp_path: Path) -> None:
    path = tmp_path / "match.npz"
    write_take(path, make_take(TakeSpec(people=2, points=8)))
    bpy.ops.ed.undo_push(message="before")
    before = data_counts(bpy)
    # The second word asks for an undo step, as a click in the menu does.
    bpy.ops.import_scene.scene_aware_mocap("EXEC_DEFAULT", True, filepath=str(path))
    after = data_counts(bpy)
    assert after != before
    bpy.ops.ed.undo()
    assert data_counts(bpy) == before
    bpy.ops.ed.redo()
    assert data_counts(bpy) == after


def test_a_scene_with_things_of_the_user_keeps_them(import_spec: Importer, bpy: Any) -> None:
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 0, 250
    bpy.ops.object.armature_add()
    own = bpy.context.object
    own.name = "Person 1"
    bones = {bone.name: np.array(bone.matrix_local) for bone in own.data.bones}
    for frame in (1, 48):
        own.location.x = frame
        own.keyframe_insert("location", frame=frame)
    import_spec(TakeSpec(people=2, frames=7, points=8))
    assert bpy.data.objects["Person 1"] == own
    assert {bone.name: np.array(bone.matrix_local) for bone in own.data.bones}.keys() == bones.keys()
    assert not own.select_get()
    assert {o.type for o in bpy.context.selected_objects} == {"ARMATURE"}
    assert len(bpy.context.selected_objects) == 2
    scene.frame_set(48)
    assert own.location.x == pytest.approx(48)
    # The take's rate, but a range that still holds the user's own motion.
    assert (scene.frame_start, scene.frame_end) == (0, 250)
    assert scene.render.fps / scene.render.fps_base == pytest.approx(30000 / 1001)


def test_a_changed_rate_is_said_where_something_moved(bpy: Any, addon: Any, tmp_path: Path) -> None:
    take_import = addon("scene_import.take_import")
    options = take_import.ImportOptions(camera=False)
    take = make_take(TakeSpec(people=1, frames=4, points=8))

    def rate_notes() -> list[str]:
        imported = take_import.import_take(bpy.context, take, tmp_path / "match.npz", options)
        return [note for note in imported.notes if "frames per second" in note]

    bpy.context.scene.render.fps = 24
    bpy.ops.mesh.primitive_cube_add()
    assert not rate_notes()
    # Now people of the first import move, at the same rate.
    assert not rate_notes()
    bpy.context.scene.render.fps, bpy.context.scene.render.fps_base = 24, 1.0
    (note,) = rate_notes()
    assert "ran at 24 " in note
    assert "29.97" in note


def test_names_of_folders_and_files_may_be_anything(bpy: Any, tmp_path: Path) -> None:
    folder = tmp_path / "два человека 二人"
    folder.mkdir()
    path = folder / "дубль 1 – été.npz"
    write_take(path, make_take(TakeSpec(people=1, frames=3, points=0)))
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(path)) == {"FINISHED"}
    assert bpy.context.scene.collection.children[path.stem].children["Person 1"]
    assert "Scene cloud" not in bpy.data.objects
