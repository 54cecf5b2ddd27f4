"""Cleaning as users do it: operators on imported people, results as Blender itself shows them."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import JOINT_NAMES, write_take
from tests.addon.retarget.skeletons import MIXAMO, make_rig, walk

from .blender_truth import armature_of, bone_heads, data_counts
from .rig.humanoids import bone_name, humanoid
from .take_factory import TakeSpec, make_take

FRAMES = range(1, 41)
OPERATIONS = {
    "fill_gaps": {},
    "remove_drift": {},
    "smooth_motion": {"cutoff": 3.0},
    "snap_feet": {"surface": "FLOOR"},
    "lock_feet": {},
    "reduce_keys": {"distance": 0.005, "angle": 0.01},
    "bake_motion": {},
}


@pytest.fixture
def people(bpy: Any, tmp_path: Path) -> list[Any]:
    """Two people of an imported take who glide without turning round; their left feet stand for half a second."""
    take = make_take(TakeSpec(frames=len(FRAMES), swing=0.15))
    write_take(tmp_path / "a take.npz", replace(take, people=tuple(_gliding(person) for person in take.people)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "a take.npz"))
    return [armature_of(bpy, person) for person in take.people]


def _gliding(person: Any) -> Any:
    contacts, theta = np.zeros((len(FRAMES), 2), np.float32), person.theta.copy()
    contacts[5:20, 0] = 0.9
    theta[:, 0] = theta[0, 0]
    return replace(person, contacts=contacts, theta=theta)


def ops(bpy: Any, name: str) -> Any:
    return getattr(bpy.ops.scene_aware_mocap, name)


def keys(action: Any) -> list[tuple[float, ...]]:
    curves = action.fcurves if hasattr(action, "fcurves") else action.layers[0].strips[0].channelbags[0].fcurves
    return [tuple(point.co) for curve in curves for point in curve.keyframe_points]


@pytest.mark.parametrize("name", OPERATIONS)
@pytest.mark.parametrize("result", ["ACTION", "LAYER"])
def test_what_was_there_stays(bpy: Any, people: list[Any], name: str, result: str) -> None:
    before = [bone_heads(bpy, person, FRAMES) for person in people]
    imported = [person.animation_data.action for person in people]
    held = [keys(action) for action in imported]
    assert ops(bpy, name)(result=result, **OPERATIONS[name]) == {"FINISHED"}
    assert [keys(action) for action in imported] == held
    assert all(action.users for action in imported)
    after = [bone_heads(bpy, person, FRAMES) for person in people]
    assert np.isfinite(after).all()
    for person, old, original in zip(people, before, imported, strict=True):
        animation = person.animation_data
        if result == "ACTION":
            assert animation.action not in (None, original)
            animation.action = original
            if hasattr(animation, "action_slot"):
                animation.action_slot = original.slots[0]
        else:
            assert animation.action is None
            assert animation.nla_tracks[0].name == original.name
            assert len(animation.nla_tracks) == 2
            animation.nla_tracks[1].mute = True
        np.testing.assert_allclose(bone_heads(bpy, person, FRAMES), old, atol=1e-5)


@pytest.mark.parametrize("result", ["ACTION", "LAYER"])
def test_locked_feet_stand_in_blender(bpy: Any, people: list[Any], result: str) -> None:
    other = bone_heads(bpy, people[1], FRAMES)
    assert sole_steps(bpy, people[0], range(6, 21)).min() > 0.003
    ops(bpy, "lock_feet")(result=result, people=people[0].name)
    assert sole_steps(bpy, people[0], range(6, 21)).max() < 0.001
    np.testing.assert_array_equal(bone_heads(bpy, people[1], FRAMES), other)


def sole_steps(bpy: Any, person: Any, frames: Any) -> np.ndarray:
    """Metres that heel and ball of the left foot move per frame, as evaluated; the lesser of the two."""
    bones = person.data.bones
    to_bone = np.linalg.inv(np.array(bones["left_ankle"].matrix_local))
    # The sole is where the armature stands at rest, on z = 0.
    ends = [to_bone @ [*bones[name].head_local[:2], 0.0, 1.0] for name in ("left_ankle", "left_foot")]
    places = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        evaluated = person.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrix = np.array(evaluated.matrix_world) @ np.array(evaluated.pose.bones["left_ankle"].matrix)
        places.append([(matrix @ end)[:3] for end in ends])
    return np.linalg.norm(np.diff(places, axis=0), axis=-1).min(axis=1)


@pytest.mark.parametrize("result", ["ACTION", "LAYER"])
def test_few_keys_show_the_motion_within_the_bound(bpy: Any, people: list[Any], result: str) -> None:
    before = bone_heads(bpy, people[0], FRAMES)
    dense = len(keys(people[0].animation_data.action))
    ops(bpy, "reduce_keys")(distance=0.002, angle=0.01, result=result)
    np.testing.assert_array_less(np.linalg.norm(bone_heads(bpy, people[0], FRAMES) - before, axis=-1), 0.002)
    animation = people[0].animation_data
    action = animation.action or animation.nla_tracks[-1].strips[0].action
    assert len(keys(action)) < 0.8 * dense


@pytest.mark.parametrize("result", ["ACTION", "LAYER"])
def test_what_is_known_goes_along(bpy: Any, addon: Any, people: list[Any], result: str) -> None:
    read = addon("rig.evidence").read_evidence
    frames = np.array(FRAMES, float)
    before = read(people[0], frames)
    for name, options in OPERATIONS.items():
        ops(bpy, name)(result=result, **options)
    after = read(people[0], frames)
    np.testing.assert_allclose(after.contacts, before.contacts, atol=1e-5)
    np.testing.assert_array_equal(after.seen, before.seen)
    np.testing.assert_array_equal(after.present, before.present)
    for frame in (3, 25):
        bpy.context.scene.frame_set(frame)
        assert people[0]["contact_left"] == pytest.approx(before.contacts[frame - 1, 0], abs=1e-5)


def test_layers_pile_up_and_bake_flattens_them(bpy: Any, people: list[Any]) -> None:
    for name in ("smooth_motion", "lock_feet"):
        ops(bpy, name)(result="LAYER")
    shown = bone_heads(bpy, people[0], FRAMES)
    assert len(people[0].animation_data.nla_tracks) == 3
    ops(bpy, "bake_motion")()
    np.testing.assert_allclose(bone_heads(bpy, people[0], FRAMES), shown, atol=1e-5)
    assert all(track.mute for track in people[0].animation_data.nla_tracks)


def test_only_those_chosen_are_cleaned(bpy: Any, people: list[Any]) -> None:
    actions = [person.animation_data.action for person in people]
    ops(bpy, "smooth_motion")(people=people[1].name)
    assert people[0].animation_data.action == actions[0]
    assert people[1].animation_data.action != actions[1]
    for obj in bpy.context.view_layer.objects:
        obj.select_set(obj.parent == people[0])
    ops(bpy, "smooth_motion")()
    assert people[0].animation_data.action != actions[0]


# --- who is who ---


def test_swapped_people(bpy: Any, people: list[Any]) -> None:
    hips = JOINT_NAMES.index("pelvis")
    before = [bone_heads(bpy, person, FRAMES)[:, hips] for person in people]
    assert ops(bpy, "swap_people")(first=people[0].name, second=people[1].name, frame=21) == {"FINISHED"}
    after = [bone_heads(bpy, person, FRAMES)[:, hips] for person in people]
    for own, other, new in zip(before, before[::-1], after, strict=True):
        np.testing.assert_allclose(new[:15], own[:15], atol=1e-5)
        np.testing.assert_allclose(new[26:, :2], other[26:, :2], atol=1e-5)


def test_split_and_merged_people(bpy: Any, people: list[Any]) -> None:
    person = people[0]
    before = bone_heads(bpy, person, FRAMES)
    armatures = {obj for obj in bpy.data.objects if obj.type == "ARMATURE"}
    ops(bpy, "split_person")(first=person.name, frame=21)
    (second,) = {obj for obj in bpy.data.objects if obj.type == "ARMATURE"} - armatures
    assert second["person_id"] not in [p["person_id"] for p in people]
    np.testing.assert_allclose(bone_heads(bpy, second, FRAMES)[20:], before[20:], atol=1e-5)
    body = next(obj for obj in second.children if obj.type == "MESH")
    for frame, first_is_there in ((10, True), (30, False)):
        bpy.context.scene.frame_set(frame)
        graph = bpy.context.evaluated_depsgraph_get()
        assert body.evaluated_get(graph).hide_render == first_is_there
        own = next(obj for obj in person.children if obj.type == "MESH")
        assert own.evaluated_get(graph).hide_render != first_is_there
        for obj, there in ((person, first_is_there), (second, not first_is_there)):
            assert obj.data.evaluated_get(graph).collections[0].is_visible == there
    assert person["present_until_s"] < second["present_from_s"]
    ops(bpy, "merge_people")(first=person.name, second=second.name)
    assert np.abs(bone_heads(bpy, person, FRAMES) - before).max() < 0.15
    bpy.context.scene.frame_set(30)
    assert body.evaluated_get(bpy.context.evaluated_depsgraph_get()).hide_render
    assert second["present_until_s"] < second["present_from_s"]
    for name in ("swap_people", "merge_people"):
        refused(bpy, name, "never there", first=person.name, second=second.name, frame=21)


def test_a_swap_puts_a_split_right(bpy: Any, people: list[Any]) -> None:
    person = people[0]
    times = person["present_from_s"], person["present_until_s"]
    before = bone_heads(bpy, person, FRAMES)
    ops(bpy, "split_person")(first=person.name, frame=21)
    ops(bpy, "swap_people")(first=f"{person.name} second", second=person.name, frame=21)
    assert (person["present_from_s"], person["present_until_s"]) == pytest.approx(times)
    assert np.abs(bone_heads(bpy, person, FRAMES) - before).max() < 0.15


def test_who_is_never_there_is_left_out(bpy: Any, addon: Any, people: list[Any], tmp_path: Path) -> None:
    person, gone = people
    ops(bpy, "merge_people")(first=person.name, second=gone.name, frame=21)
    bpy.ops.object.select_all(action="DESELECT")
    bpy.context.view_layer.objects.active = None
    ops(bpy, "load_sample_rig")()
    bpy.ops.object.select_all(action="DESELECT")
    likely = addon("rig.casting")._likely_people
    assert likely(bpy.context, None) == [person]
    for obj in people:
        obj.select_set(True)
    assert likely(bpy.context, None) == [person]
    ops(bpy, "export")(directory=str(tmp_path), file_name="two", file_format="glb", files="EACH")
    assert [file.stem for file in tmp_path.glob("*.glb")] == [f"two_{person.name}"]
    ops(bpy, "export")(directory=str(tmp_path), file_name="one", file_format="glb", characters=gone.name)
    assert list(tmp_path.glob("one*.glb"))


def test_nothing_hidden_makes_no_new_action(bpy: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    take = make_take(TakeSpec())
    seen = tuple(replace(person, valid=np.ones_like(person.valid)) for person in take.people)
    write_take(tmp_path / "t.npz", replace(take, people=seen))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "t.npz"))
    people = [armature_of(bpy, person) for person in seen]
    actions = [person.animation_data.action for person in people]
    assert ops(bpy, "fill_gaps")() == {"FINISHED"}
    assert [person.animation_data.action for person in people] == actions
    said = capfd.readouterr()
    assert "is never hidden" in said.out + said.err
    assert "0 done" in said.out + said.err


def test_the_sample_on_its_stairs_stays_there(bpy: Any) -> None:
    ops(bpy, "load_sample_take")()
    cleo, frames = bpy.data.objects["Cleo"], (70, 90, 120)
    pelvis = cleo.data.bones.find("pelvis")
    before = bone_heads(bpy, cleo, frames)[:, pelvis, 2]
    bpy.ops.object.select_all(action="DESELECT")
    for name in ("snap_feet", "snap_feet", "remove_drift"):
        ops(bpy, name)()
        np.testing.assert_allclose(bone_heads(bpy, cleo, frames)[:, pelvis, 2], before, atol=0.02)


# --- bad input ---


def refused(bpy: Any, name: str, said: str, **options: Any) -> None:
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=said):
        ops(bpy, name)(**options)
    assert data_counts(bpy) == before


def test_nobody_to_clean(bpy: Any) -> None:
    refused(bpy, "smooth_motion", "import a take")
    refused(bpy, "lock_feet", "nobody called 'Eve'", people="Eve")
    refused(bpy, "split_person", "no armature is active", frame=3)


def test_a_locked_track_is_respected(bpy: Any, people: list[Any]) -> None:
    ops(bpy, "smooth_motion")(result="LAYER")
    people[1].animation_data.nla_tracks[0].lock = True
    refused(bpy, "smooth_motion", "is locked: unlock it")


def test_a_take_without_contacts(bpy: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=1))
    nothing = np.zeros((12, 2), np.float32)
    write_take(tmp_path / "t.npz", replace(take, people=(replace(take.people[0], contacts=nothing),)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "t.npz"))
    refused(bpy, "lock_feet", "no foot contacts")
    assert ops(bpy, "smooth_motion")() == {"FINISHED"}


def test_scene_points_that_are_not_there(bpy: Any, people: list[Any]) -> None:
    cloud = next(obj for obj in bpy.data.objects if "scene_points" in obj)
    bpy.data.objects.remove(cloud)
    refused(bpy, "snap_feet", "no scene points", surface="CLOUD")


def test_one_person_is_no_pair(bpy: Any, people: list[Any]) -> None:
    people[1].select_set(False)
    bpy.context.view_layer.objects.active = people[0]
    refused(bpy, "swap_people", "choose two people", frame=5)
    refused(bpy, "split_person", "inside the take", first=people[0].name, frame=1)
    name = people[0].name
    for operation in ("swap_people", "merge_people"):
        refused(bpy, operation, "two different", first=name, second=name, frame=5)


def test_who_is_left_out_is_not_counted(bpy: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    take = make_take(TakeSpec(frames=len(FRAMES)))
    silent = replace(take.people[1], contacts=np.zeros((len(FRAMES), 2), np.float32))
    write_take(tmp_path / "t.npz", replace(take, people=(_gliding(take.people[0]), silent)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "t.npz"))
    ops(bpy, "lock_feet")()
    said = capfd.readouterr()
    assert "Lock Feet: 1 done" in said.out + said.err


def test_a_stop_changes_nothing(bpy: Any, addon: Any, people: list[Any]) -> None:
    cleaning = addon("rig.cleaning")
    before = data_counts(bpy)
    for parts in range(1, 5):
        work = cleaning.clean(bpy.context, people, [cleaning.smoothing(3.0), cleaning.foot_lock(0.1)], "ACTION")
        for _ in range(parts):
            assert 0.0 <= next(work) <= 1.0
        work.close()
        assert data_counts(bpy) == before


def test_every_operation_can_be_undone(bpy: Any) -> None:
    for name in (*OPERATIONS, "swap_people", "merge_people", "split_person"):
        assert "UNDO" in ops(bpy, name).bl_options


def test_a_linked_person_is_refused(bpy: Any, people: list[Any], tmp_path: Path) -> None:
    name, path = people[0].name, tmp_path / "das Original.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.objects = [name]
    bpy.context.scene.collection.objects.link(bpy.data.objects[name])
    for operation in (*OPERATIONS, "split_person"):
        options = {"first": name, "frame": 9} if operation == "split_person" else {"people": name}
        refused(bpy, operation, "linked from another file", **options)


def test_rigs_that_no_take_brought_in_are_cleaned_too(bpy: Any, addon: Any) -> None:
    """A walker on a rig of scale 0.01 without any custom properties: its feet are seen to stand."""
    person = make_rig(addon, MIXAMO)
    motion, contacts = walk(addon, person, len(FRAMES))
    rig = humanoid(bpy, addon, MIXAMO)
    skeleton = addon("rig.reading").read_skeleton(rig)
    order = [next(i for i, role in enumerate(person.skeleton.names) if bone_name(role) == n) for n in skeleton.names]
    moving = type(motion)(motion.times, motion.rotations[:, order], motion.heads[:, order])
    addon("rig.writing").write_motion(rig, skeleton, moving, "walk", skeleton.names, np.array(FRAMES, float))
    rig.select_set(True)
    for name, options in OPERATIONS.items():
        assert ops(bpy, name)(**options) == {"FINISHED"}
    after = addon("rig.reading").read_motion(rig, skeleton, np.array(FRAMES, float))
    stands = contacts[1:, 0] * contacts[:-1, 0] > 0
    foot = after.heads[:, skeleton.index(bone_name("left_foot"))]
    assert np.linalg.norm(np.diff(foot, axis=0), axis=-1)[stands][2:-2].max() < 0.006
    assert np.linalg.norm(after.heads - moving.heads, axis=-1).mean() < 0.05
