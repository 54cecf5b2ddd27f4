"""Choices on import: who, where, when and how; and nothing of a refused choice."""

import itertools
import math
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.take import Take, write_take

from .blender_truth import armature_of, bone_heads, data_counts
from .take_factory import TakeSpec, make_take, person_joints
from .test_import_motion import world_of


@pytest.fixture
def match(bpy: Any, tmp_path: Path) -> Path:
    write_take(tmp_path / "match.npz", make_take(TakeSpec(people=3, points=400)))
    return tmp_path / "match.npz"


def take() -> Take:
    return make_take(TakeSpec(people=3, points=400))


def people_there(bpy: Any) -> set[int]:
    return {obj["person_id"] for obj in bpy.data.objects if obj.type == "ARMATURE"}


@pytest.mark.parametrize(
    ("wanted", "ids"), [("", {1, 4, 7}), ("4", {4}), ("person 3, 1", {1, 7}), (" Person 2 ,", {4}), ("4,4", {4})]
)
def test_only_the_people_wanted_come(wanted: str, ids: set[int], match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), people=wanted)
    assert people_there(bpy) == ids


def test_a_stranger_is_refused_and_nothing_changes(match: Path, bpy: Any) -> None:
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=r"nobody is called anna: the take has Person 1 \(1\), Person 2 \(4\)"):
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), people="4, Anna")
    assert data_counts(bpy) == before


def test_thinner_clouds_are_parts_of_thicker_ones(match: Path, bpy: Any) -> None:
    clouds = []
    for density in (0.25, 0.5, 0.5, 1.0):
        bpy.ops.wm.read_homefile(use_empty=True)
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), density=density)
        mesh = bpy.data.objects["Scene cloud"].data
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        clouds.append(points.reshape(-1, 3))
    assert [len(cloud) for cloud in clouds] == [100, 200, 200, 400]
    assert np.array_equal(clouds[1], clouds[2])
    assert {tuple(point) for point in clouds[0]} < {tuple(point) for point in clouds[1]}
    assert {tuple(point) for point in clouds[1]} < {tuple(point) for point in clouds[3]}


def test_the_first_person_can_stand_at_the_origin(match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), anchor="PERSON", people="4,7")
    wanted = take().people[1]
    heads = bone_heads(bpy, armature_of(bpy, wanted), [1])[0]
    assert np.abs(heads[0, :2]).max() < 1e-5
    # Heights are those above the ground, as before.
    assert np.abs(heads[:, 2] - world_of(take()).apply(person_joints(wanted))[0, :, 2]).max() < 1e-4


def test_turn_and_offset_move_everything_alike(match: Path, bpy: Any) -> None:
    turn, offset = 0.7, (1.0, -2.0, 0.25)
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), turn=turn, offset=offset)
    c, s = math.cos(turn), math.sin(turn)
    moved = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    world = world_of(take())
    for person in take().people:
        expected = world.apply(person_joints(person))[[0, 11]] @ moved.T + offset
        assert np.abs(bone_heads(bpy, armature_of(bpy, person), [1, 12]) - expected).max() < 1e-4
    assert np.allclose(bpy.context.scene.camera.matrix_world.translation, (1, -2, 2.25), atol=1e-5)
    mesh = bpy.data.objects["Scene cloud"].data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    expected = world.apply(take().scene.points) @ moved.T + offset
    assert np.abs(points.reshape(-1, 3) - expected).max() < 1e-4


def test_a_later_start_moves_keys_range_and_times(match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), start_frame=101)
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end, scene.frame_current) == (101, 112, 101)
    person = take().people[0]
    armature = armature_of(bpy, person)
    heads = bone_heads(bpy, armature, range(101, 113))
    assert np.abs(heads - world_of(take()).apply(person_joints(person))).max() < 1e-4
    assert armature["present_from_s"] == pytest.approx(101 * 1001 / 30000)


def test_motion_as_strips_is_the_same_motion(match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), motion="STRIP", start_frame=3)
    for person in take().people:
        armature = armature_of(bpy, person)
        assert armature.animation_data.action is None
        (track,) = armature.animation_data.nla_tracks
        assert (track.strips[0].frame_start, track.strips[0].frame_end) == (3, 14)
        heads = bone_heads(bpy, armature, range(3, 15))
        assert np.abs(heads - world_of(take()).apply(person_joints(person))).max() < 1e-4
        bpy.context.scene.frame_set(3)
        assert armature["contact_left"] == pytest.approx(float(person.contacts[0, 0]), abs=1e-6)


def test_footage_can_stay_away_while_the_camera_comes(match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), behind=False)
    assert bpy.context.scene.camera is not None
    assert not bpy.data.movieclips


def test_markers_say_when_somebody_was_hidden(match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), shortest_hidden=2, start_frame=11, people="1,4")
    # The factory's people are all hidden in the take's frames 6 and 7, counted from 0.
    markers = {(marker.name, marker.frame) for marker in bpy.context.scene.timeline_markers}
    assert markers == {(f"Person {n} {what}", at) for n in (1, 2) for what, at in (("hidden", 17), ("seen", 19))}


@pytest.mark.parametrize("choice", [{"shortest_hidden": 3}, {"markers": False, "shortest_hidden": 1}])
def test_no_markers_for_short_times_or_when_not_wanted(choice: dict[str, Any], match: Path, bpy: Any) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(match), **choice)
    assert not bpy.context.scene.timeline_markers


@given(valid=st.lists(st.booleans(), min_size=1, max_size=14))
def test_hidden_spans_are_the_gaps_between_sights(valid: list[bool], addon: Any) -> None:
    spans = addon("scene_import.markers").hidden_spans(np.array(valid))
    gaps = [frame for first, end in spans for frame in range(first, end)]
    between = [f for f, seen in enumerate(valid) if not seen and any(valid[:f]) and any(valid[f:])]
    assert gaps == between
    assert all(end < first for (_, end), (first, _) in itertools.pairwise(spans))


def test_several_takes_come_in_at_once(match: Path, bpy: Any) -> None:
    other = match.with_name("zweiter Dreh 二.npz")
    write_take(other, make_take(TakeSpec(people=1, frames=4, points=8, rate=Fraction(30000, 1001))))
    files = [{"name": match.name}, {"name": other.name}]
    bpy.ops.import_scene.scene_aware_mocap(directory=str(match.parent), files=files)
    assert {c.name for c in bpy.context.scene.collection.children} == {"match", other.stem}
    assert bpy.context.scene.frame_end == 12


def test_one_bad_file_among_several_stops_all(match: Path, bpy: Any) -> None:
    match.with_name("bad.npz").write_text("text")
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=r"bad\.npz"):
        bpy.ops.import_scene.scene_aware_mocap(
            directory=str(match.parent), files=[{"name": match.name}, {"name": "bad.npz"}]
        )
    assert data_counts(bpy) == before


def test_takes_can_be_dropped_onto_a_view(bpy: Any, addon: Any) -> None:
    handler = bpy.types.IO_FH_scene_aware_mocap
    assert handler.bl_file_extensions == ".npz"
    assert handler.bl_import_operator == "import_scene.scene_aware_mocap"
    drop = addon("operators.import_take").TakeDrop
    area = SimpleNamespace(type="VIEW_3D")
    assert drop.poll_drop(SimpleNamespace(area=area))
    assert not drop.poll_drop(SimpleNamespace(area=SimpleNamespace(type="TEXT_EDITOR")))
    assert not drop.poll_drop(SimpleNamespace(area=None))
