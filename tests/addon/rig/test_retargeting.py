"""People of a scene onto rigs, in Blender: what the operator makes, and what it refuses without a trace."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.take import write_take
from tests.addon.blender_truth import data_counts, evaluated_vertices
from tests.addon.retarget.skeletons import A_POSE, MIXAMO, SHORT, TALL, Build
from tests.addon.take_factory import TakeSpec, make_take

from .humanoids import bone_name, humanoid
from .rigs import evaluated

FRAMES = range(1, 13)
LIMBS = [
    (f"{side}_{limb}", f"{side}_{following}")
    for side in ("left", "right")
    for limb, following in (("upper_arm", "forearm"), ("forearm", "hand"), ("thigh", "shin"), ("shin", "foot"))
]
JOINTS = {"upper_arm": "shoulder", "forearm": "elbow", "hand": "wrist", "thigh": "hip", "shin": "knee", "foot": "ankle"}


@pytest.fixture
def people(bpy: Any, tmp_path: Path) -> list[Any]:
    """Two imported people."""
    write_take(tmp_path / "two.npz", make_take(TakeSpec(frames=len(FRAMES))))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "two.npz"))
    return sorted((o for o in bpy.data.objects if "person_id" in o), key=lambda o: o.name)


def retarget(bpy: Any, **chosen: Any) -> set[str]:
    return bpy.ops.scene_aware_mocap.retarget(**{"refine": False, **chosen})


def limb_directions(bpy: Any, obj: Any, names: list[tuple[str, str]]) -> np.ndarray:
    """(T, 8, 3) as Blender evaluates them."""
    flat = [name for pair in names for name in pair]
    heads = evaluated(bpy, obj, flat, FRAMES)[1]
    ways = heads[:, 1::2] - heads[:, 0::2]
    return ways / np.linalg.norm(ways, axis=-1, keepdims=True)


def joint_name(role: str) -> str:
    side, _, limb = role.partition("_")
    return f"{side}_{JOINTS[limb]}"


@pytest.mark.parametrize("build", [MIXAMO, A_POSE, TALL], ids=["mixamo", "a pose", "tall"])
def test_limbs_point_where_the_persons_point(bpy: Any, addon: Any, people: list[Any], build: Build) -> None:
    rig = humanoid(bpy, addon, build)
    assert retarget(bpy, rig=rig.name, feet=False) == {"FINISHED"}
    for person in people:
        copy = bpy.data.objects[f"Hero {person.name}"]
        theirs = limb_directions(bpy, person, [(joint_name(a), joint_name(b)) for a, b in LIMBS])
        ours = limb_directions(bpy, copy, [(bone_name(a), bone_name(b)) for a, b in LIMBS])
        # The least that a rig with other hip joints can do: thighs and arms are exact, whatever pose it rests in.
        assert np.degrees(2 * np.arcsin(np.linalg.norm(theirs - ours, axis=-1) / 2)).max() < 0.05


def test_everybody_gets_a_copy_and_the_rig_stays(bpy: Any, addon: Any, people: list[Any]) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    bpy.context.view_layer.objects.active = rig
    meshes = len(bpy.data.meshes)
    assert retarget(bpy) == {"FINISHED"}
    assert rig.animation_data is None
    assert len(bpy.data.meshes) == meshes
    for person in people:
        copy = bpy.data.objects[f"Hero {person.name}"]
        assert copy.animation_data.action.name == f"{person.name} on Hero"
        (skin,) = copy.children
        assert skin.modifiers[0].object == copy
        head = evaluated(bpy, copy, [bone_name("head")], FRAMES)[1][:, 0]
        index = list(rig.data.bones.keys()).index(bone_name("head"))
        np.testing.assert_allclose(evaluated_vertices(bpy, skin, FRAMES)[:, index], head, atol=1e-4)


def test_people_keep_their_places_on_rigs_of_their_own(bpy: Any, addon: Any, people: list[Any]) -> None:
    """A small and a tall rig, each given to one person: hips above the same places, actions on the rigs themselves."""
    rigs = [humanoid(bpy, addon, SHORT, "Small"), humanoid(bpy, addon, TALL, "Tall")]
    pairs = [{"name": person.name, "rig": rig.name} for person, rig in zip(people, rigs, strict=True)]
    count = len(bpy.data.objects)
    assert retarget(bpy, cast=pairs) == {"FINISHED"}
    assert len(bpy.data.objects) == count
    for person, rig in zip(people, rigs, strict=True):
        hips = [("left_hip", "right_hip"), (bone_name("left_thigh"), bone_name("right_thigh"))]
        theirs, ours = (
            evaluated(bpy, obj, names, FRAMES)[1].mean(axis=1) for obj, names in zip((person, rig), hips, strict=True)
        )
        np.testing.assert_allclose(ours[:, :2], theirs[:, :2], atol=1e-3)
    table = {row.label: (row.people, row.rigs) for row in bpy.context.scene.mocap_retarget.table}
    assert table["Distances are off by"] == ("0 mm", "0 mm")


def test_the_same_frame_rate_and_frames_as_the_people(bpy: Any, addon: Any, people: list[Any]) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    people[0].select_set(True)
    people[1].select_set(False)
    assert retarget(bpy, rig=rig.name, copied=False) == {"FINISHED"}
    assert tuple(rig.animation_data.action.frame_range) == (1.0, float(len(FRAMES)))


def test_a_motion_from_elsewhere_is_taken_with_a_warning(
    bpy: Any, addon: Any, people: list[Any], capfd: pytest.CaptureFixture[str]
) -> None:
    """Without contacts they are found; any armature that moves will do."""
    rig = humanoid(bpy, addon, MIXAMO)
    del people[0]["contact_left"]
    assert retarget(bpy, cast=[{"name": people[0].name, "rig": rig.name}]) == {"FINISHED"}
    assert "how low and slow" in capfd.readouterr().out


def _no_such_rig(bpy: Any, addon: Any) -> dict[str, Any]:
    return {"rig": "Nobody"}


def _not_an_armature(bpy: Any, addon: Any) -> dict[str, Any]:
    bpy.ops.mesh.primitive_cube_add()
    return {"rig": "Cube"}


def _no_rig_at_all(bpy: Any, addon: Any) -> dict[str, Any]:
    bpy.context.view_layer.objects.active = None
    return {}


def _no_humanoid(bpy: Any, addon: Any) -> dict[str, Any]:
    bpy.ops.object.armature_add()
    return {"rig": bpy.context.object.name}


def _one_rig_for_two(bpy: Any, addon: Any) -> dict[str, Any]:
    return {"rig": humanoid(bpy, addon, MIXAMO).name, "copied": False}


def _nobody_moves(bpy: Any, addon: Any) -> dict[str, Any]:
    rig, still = humanoid(bpy, addon, MIXAMO), humanoid(bpy, addon, MIXAMO, "Still")
    return {"cast": [{"name": still.name, "rig": rig.name}]}


def _itself(bpy: Any, addon: Any) -> dict[str, Any]:
    return {"cast": [{"name": "Person 1", "rig": "Person 1"}]}


def _driven(bpy: Any, addon: Any) -> dict[str, Any]:
    rig = humanoid(bpy, addon, MIXAMO)
    rig.pose.bones[bone_name("head")].driver_add("rotation_quaternion", 0)
    return {"cast": [{"name": "Person 1", "rig": rig.name}]}


REFUSALS = {
    "no such rig": (_no_such_rig, "no object 'Nobody'"),
    "not an armature": (_not_an_armature, "no armature"),
    "no rig at all": (_no_rig_at_all, "choose the rig"),
    "no humanoid": (_no_humanoid, "."),
    "one rig for two": (_one_rig_for_two, "cannot play several"),
    "nobody moves": (_nobody_moves, "does not move"),
    "itself": (_itself, "the person and the rig"),
    "driven": (_driven, "drivers move"),
}


@pytest.mark.parametrize("kind", REFUSALS)
def test_refused_with_the_reason_and_nothing_changed(kind: str, bpy: Any, addon: Any, people: list[Any]) -> None:
    spoil, reason = REFUSALS[kind]
    chosen = spoil(bpy, addon)
    before, actions = data_counts(bpy), [person.animation_data.action for person in people]
    with pytest.raises(RuntimeError, match=reason) as refusal:
        retarget(bpy, **chosen)
    assert "Traceback" not in str(refusal.value)
    assert data_counts(bpy) == before
    assert [person.animation_data.action for person in people] == actions


def test_nobody_to_retarget(bpy: Any, addon: Any) -> None:
    humanoid(bpy, addon, MIXAMO)
    with pytest.raises(RuntimeError, match="import a take"):
        retarget(bpy)


@pytest.mark.parametrize(("drive", "degrees"), [("fk", 0.1), ("ik", 0.5)])
def test_a_rigify_rig_follows_through_its_controls(
    bpy: Any, rigify_file: Path, tmp_path: Path, drive: str, degrees: float
) -> None:
    """Whichever controls are keyed, the deforming bones point where the person's limbs do."""
    bpy.ops.wm.open_mainfile(filepath=str(rigify_file))
    write_take(tmp_path / "one.npz", make_take(TakeSpec(people=1, frames=len(FRAMES), swing=0.2)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "one.npz"))
    rig = bpy.data.objects["Generated"]
    poses = [bone.matrix_basis.copy() for bone in rig.pose.bones]
    assert retarget(bpy, rig="Generated", drive=drive, feet=False) == {"FINISHED"}
    assert [bone.matrix_basis for bone in rig.pose.bones] == poses
    copy = bpy.data.objects["Generated Person 1"]
    theirs = limb_directions(bpy, bpy.data.objects["Person 1"], [(joint_name(a), joint_name(b)) for a, b in LIMBS])
    ours = limb_directions(bpy, copy, [(original_bone(a), original_bone(b)) for a, b in LIMBS])
    assert np.degrees(2 * np.arcsin(np.linalg.norm(theirs - ours, axis=-1) / 2)).max() < degrees
    curves = {curve.data_path for curve in addon_curves(copy)}
    assert 'pose.bones["thigh_parent.L"]["IK_FK"]' in curves
    assert any("foot_ik.L" in path for path in curves) == (drive == "ik")


def original_bone(role: str) -> str:
    """The bone that Rigify's deforming bones copy."""
    side, _, limb = role.partition("_")
    return f"ORG-{limb}.{side[0].upper()}"


def addon_curves(obj: Any) -> list[Any]:
    action = obj.animation_data.action
    if not hasattr(action, "slots"):
        return list(action.fcurves)
    return list(action.layers[0].strips[0].channelbag(obj.animation_data.action_slot).fcurves)


def test_rigs_that_look_wrong_are_told(
    bpy: Any, addon: Any, people: list[Any], capfd: pytest.CaptureFixture[str]
) -> None:
    """Of a size that nobody has, or with its legs above its head at rest."""
    giant = humanoid(bpy, addon, MIXAMO)
    giant.scale *= 20
    bpy.context.view_layer.update()
    assert retarget(bpy, rig=giant.name) == {"FINISHED"}
    assert "other units" in capfd.readouterr().out
    upset = humanoid(bpy, addon, MIXAMO, "Upset")
    bpy.context.view_layer.objects.active = upset
    bpy.ops.object.mode_set(mode="EDIT")
    for side in ("left", "right"):
        hip = upset.data.edit_bones[bone_name(f"{side}_thigh")].head.copy()
        for limb in ("thigh", "shin", "foot", "toe"):
            bone = upset.data.edit_bones[bone_name(f"{side}_{limb}")]
            bone.head, bone.tail = ((hip.x, 2 * hip.y - place.y, place.z) for place in (bone.head, bone.tail))
    bpy.ops.object.mode_set(mode="OBJECT")
    assert retarget(bpy, rig="Upset") == {"FINISHED"}
    assert "does not rest standing" in capfd.readouterr().out


def test_a_linked_rig_is_refused_but_its_copy_moves(bpy: Any, addon: Any, people: list[Any], tmp_path: Path) -> None:
    """The library's objects cannot be animated here; a copy is the scene's own."""
    rig = humanoid(bpy, addon, MIXAMO)
    library = tmp_path / "Räuber rig.blend"
    bpy.data.libraries.write(str(library), {rig, *rig.children}, fake_user=True)
    for obj in (*rig.children, rig):
        bpy.data.objects.remove(obj)
    with bpy.data.libraries.load(str(library), link=True) as (source, wanted):
        wanted.objects = list(source.objects)
    for obj in wanted.objects:
        bpy.context.scene.collection.objects.link(obj)
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match="linked from another file"):
        retarget(bpy, cast=[{"name": "Person 1", "rig": "Hero"}])
    assert data_counts(bpy) == before
    assert retarget(bpy, rig="Hero") == {"FINISHED"}
    copy = bpy.data.objects["Hero Person 1"]
    assert copy.library is None
    assert copy.animation_data.action.name == "Person 1 on Hero"


def test_copies_of_people_who_come_later_are_hidden_until_then(bpy: Any, addon: Any, tmp_path: Path) -> None:
    """As their people are; and they know when their feet stand, so that they can be cleaned."""
    write_take(tmp_path / "late.npz", make_take(TakeSpec(frames=len(FRAMES), absence=4)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "late.npz"))
    rig = humanoid(bpy, addon, MIXAMO)
    assert retarget(bpy, rig=rig.name) == {"FINISHED"}
    assert "present" not in rig
    for person in [obj for obj in bpy.data.objects if "person_id" in obj]:
        copy = bpy.data.objects[f"Hero {person.name}"]
        body, skin = person.children[0], copy.children[0]
        hidden = []
        for frame in FRAMES:
            bpy.context.scene.frame_set(frame)
            hidden.append((body.hide_render, skin.hide_render, copy["contact_left"] == person["contact_left"]))
        assert {pair[0] for pair in hidden} == {True, False}
        assert all(pair[0] == pair[1] and pair[2] for pair in hidden)


def test_onto_a_copy_of_the_person_nothing_changes(bpy: Any, people: list[Any]) -> None:
    """The bones beyond the wrists too, which have no role but the same name."""
    person = people[0]
    assert retarget(bpy, cast=[{"name": person.name, "rig": ""}], rig=person.name, refine=True) == {"FINISHED"}
    copy = bpy.data.objects[f"{person.name} {person.name}"]
    names = [bone.name for bone in person.data.bones]
    for theirs, ours in zip(*(evaluated(bpy, obj, names, FRAMES) for obj in (person, copy)), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4)
