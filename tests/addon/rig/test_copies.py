"""Characters that are copies of a rig: where they go, how they start, and that they are nobody's model afterwards."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.take import write_take
from tests.addon.blender_truth import data_counts
from tests.addon.retarget.skeletons import MIXAMO, SHORT
from tests.addon.take_factory import TakeSpec, make_take

from .humanoids import bone_name, humanoid


@pytest.fixture
def person(bpy: Any, tmp_path: Path) -> Any:
    """One imported person."""
    write_take(tmp_path / "one.npz", make_take(TakeSpec(people=1, frames=12)))
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "one.npz"))
    return bpy.data.objects["Person 1"]


def retarget(bpy: Any, **chosen: Any) -> set[str]:
    return bpy.ops.scene_aware_mocap.retarget(**{"refine": False, **chosen})


def in_a_collection(bpy: Any, rig: Any) -> Any:
    """Move a rig and its skin to a collection of their own."""
    collection = bpy.data.collections.new("Characters")
    bpy.context.scene.collection.children.link(collection)
    for obj in (rig, *rig.children):
        bpy.context.scene.collection.objects.unlink(obj)
        collection.objects.link(obj)
    return collection


def linked(bpy: Any, rig: Any, path: Path) -> Any:
    """The rig's collection again, linked from a file, and nothing of it in this one."""
    collection = in_a_collection(bpy, rig)
    bpy.data.libraries.write(str(path), {collection}, fake_user=True)
    for obj in (*rig.children, rig):
        bpy.data.objects.remove(obj)
    bpy.data.collections.remove(collection)
    with bpy.data.libraries.load(str(path), link=True) as (_, wanted):
        wanted.collections = ["Characters"]
    bpy.context.scene.collection.children.link(wanted.collections[0])
    return wanted.collections[0]


def assert_shown_and_moving(bpy: Any, copy: Any) -> None:
    for obj in (copy, *copy.children):
        assert obj.library is None
        assert obj.override_library is None
        assert obj.visible_get()
    assert len(copy.children) == 1
    assert copy.animation_data.action is not None


@pytest.mark.parametrize("kind", ["linked", "overridden", "override of the system"])
def test_copies_of_library_rigs_come_into_the_scene(
    kind: str, bpy: Any, addon: Any, person: Any, tmp_path: Path
) -> None:
    collection = linked(bpy, humanoid(bpy, addon, MIXAMO), tmp_path / "library.blend")
    if kind != "linked":
        collection.override_hierarchy_create(
            bpy.context.scene, bpy.context.view_layer, do_fully_editable=kind == "overridden"
        )
        bpy.context.scene.collection.children.unlink(collection)
    bpy.context.view_layer.update()
    before = len(bpy.data.objects)
    assert retarget(bpy, rig="Hero") == {"FINISHED"}
    assert_shown_and_moving(bpy, bpy.data.objects[f"Hero {person.name}"])
    assert len(bpy.data.objects) == before + 2
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    assert_shown_and_moving(bpy, bpy.data.objects["Hero Person 1"])


@pytest.mark.parametrize("kind", ["excluded", "hidden"])
def test_copies_of_rigs_out_of_sight_are_seen(kind: str, bpy: Any, addon: Any, person: Any) -> None:
    in_a_collection(bpy, humanoid(bpy, addon, MIXAMO))
    layer = bpy.context.view_layer.layer_collection.children["Characters"]
    setattr(layer, {"excluded": "exclude", "hidden": "hide_viewport"}[kind], True)
    bpy.context.view_layer.update()
    assert retarget(bpy, rig="Hero") == {"FINISHED"}
    assert_shown_and_moving(bpy, bpy.data.objects[f"Hero {person.name}"])


def test_copies_stay_where_the_rig_is_when_that_is_seen(bpy: Any, addon: Any, person: Any) -> None:
    collection = in_a_collection(bpy, humanoid(bpy, addon, MIXAMO))
    retarget(bpy, rig="Hero")
    copy = bpy.data.objects[f"Hero {person.name}"]
    assert copy.users_collection == copy.children[0].users_collection == (collection,)


def test_a_copy_starts_at_rest_without_what_the_rig_plays(bpy: Any, addon: Any) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    head = rig.pose.bones[bone_name("head")]
    head.rotation_quaternion = (0.8, 0.6, 0.0, 0.0)
    head.keyframe_insert("rotation_quaternion", frame=1)
    action = rig.animation_data.action
    rig.animation_data.nla_tracks.new().strips.new("run", 1, action)
    copy = addon("rig.copying").copy_rig(rig, "Copy")
    assert copy.animation_data.action is None
    assert not copy.animation_data.nla_tracks
    np.testing.assert_array_equal(copy.pose.bones[bone_name("head")].matrix_basis, np.eye(4))
    assert rig.animation_data.action == action
    assert len(rig.animation_data.nla_tracks) == 1
    assert head.matrix_basis != copy.pose.bones[bone_name("head")].matrix_basis


def test_a_failed_copy_leaves_nothing(bpy: Any, addon: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    copying, before = addon("rig.copying"), data_counts(bpy)

    def fail(*_: Any) -> None:
        raise RuntimeError

    monkeypatch.setattr(copying, "_relink", fail)
    with pytest.raises(RuntimeError):
        copying.copy_rig(rig, "Copy")
    assert data_counts(bpy) == before


@pytest.mark.parametrize("error", [UserError, RuntimeError, KeyboardInterrupt])
def test_an_error_while_keying_takes_everything_back(
    error: type[BaseException], bpy: Any, addon: Any, person: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One rig of its own that is keyed already, one copy that fails."""
    own, other = humanoid(bpy, addon, MIXAMO, "Own"), humanoid(bpy, addon, SHORT, "Other")
    retargeting, maps = addon("rig.retargeting"), addon("rig.maps")
    person_map, own_map, other_map = (maps.map_of(bpy.context, obj, "fk") for obj in (person, own, other))
    roles = [
        retargeting.Role(person, person_map, own, own_map),
        retargeting.Role(person, person_map, other, other_map, copied=True),
    ]
    before, key = data_counts(bpy), retargeting._key

    def failing(rig: Any, *rest: Any) -> None:
        key(rig, *rest)
        if rig != own:
            raise error("no")

    monkeypatch.setattr(retargeting, "_key", failing)
    with pytest.raises(error):
        retargeting.retarget(roles, addon("retarget.options").Options(refine=False), lambda _: None)
    assert data_counts(bpy) == before
    assert own.animation_data is None or own.animation_data.action is None


def test_a_rig_whose_copies_cannot_be_keyed_is_refused_at_once(bpy: Any, addon: Any, person: Any) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    rig.pose.bones[bone_name("head")].driver_add("rotation_quaternion", 0)
    before, heard = data_counts(bpy), []
    maps, retargeting = addon("rig.maps"), addon("rig.retargeting")
    rig_map, person_map = (maps.map_of(bpy.context, obj, "fk") for obj in (rig, person))
    role = retargeting.Role(person, person_map, rig, rig_map, copied=True)
    with pytest.raises(UserError, match="drivers move"):
        retargeting.retarget([role], addon("retarget.options").Options(), heard.append)
    assert not heard
    assert data_counts(bpy) == before


@pytest.mark.parametrize("copied", [True, False])
def test_characters_from_before_are_no_people(copied: bool, bpy: Any, addon: Any, person: Any) -> None:
    """They are selected after retargeting; the next rig gets the people all the same."""
    first, second = humanoid(bpy, addon, MIXAMO), humanoid(bpy, addon, SHORT, "Small")
    assert retarget(bpy, rig=first.name, copied=copied) == {"FINISHED"}
    (character,) = (obj for obj in bpy.context.view_layer.objects if obj.select_get())
    assert retarget(bpy, rig=second.name) == {"FINISHED"}
    assert {obj.name for obj in bpy.data.objects if obj.name.startswith("Small ")} == {
        "Small skin", f"Small {person.name}", f"Small skin Small {person.name}",
    }  # fmt: skip
    assert retarget(bpy, cast=[{"name": character.name, "rig": ""}], rig=second.name) == {"FINISHED"}
    assert f"Small {character.name}" in bpy.data.objects


def test_somebody_without_limbs_is_named(bpy: Any, addon: Any, person: Any) -> None:
    rig = humanoid(bpy, addon, MIXAMO)
    bpy.ops.object.armature_add()
    bpy.context.object.name = "Stick"
    with pytest.raises(RuntimeError, match="'Stick'"):
        retarget(bpy, cast=[{"name": "Stick", "rig": rig.name}])


def test_a_take_without_contacts_is_told_and_feet_still_stand(
    bpy: Any, addon: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    take = make_take(TakeSpec(people=1, frames=12))
    take.people[0].contacts[:] = 0
    write_take(tmp_path / "none.npz", take)
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "none.npz"))
    rig = humanoid(bpy, addon, MIXAMO)
    assert retarget(bpy, rig=rig.name) == {"FINISHED"}
    told = capfd.readouterr().out
    assert "how low and slow" in told
    assert "distances" not in told  # there is one person only
    table = {row.label: (row.people, row.rigs) for row in bpy.context.scene.mocap_retarget.table}
    assert table["Distances are off by"] == table["Hands miss by"] == table["Bodies overlap by"] == ("-", "-")


def test_a_name_with_a_comma_is_one_name(bpy: Any, addon: Any, person: Any) -> None:
    listed = addon("operators.names").listed_names
    person.name = "Ada, the 1st"
    assert listed(bpy.context, " Ada, the 1st ") == ["Ada, the 1st"]
    assert listed(bpy.context, "Ada, Ben,") == ["Ada", "Ben"]
    assert bpy.ops.scene_aware_mocap.smooth_motion(people="Ada, the 1st") == {"FINISHED"}


def test_a_take_brings_in_somebody_with_a_comma(addon: Any) -> None:
    take = make_take(TakeSpec(frames=2))
    take = replace(take, people=(replace(take.people[0], name="Ada, the 1st"), *take.people[1:]))
    chosen = addon("scene_import.take_import").chosen_people
    assert chosen(take, ("Ada", " the 1st")) == take.people[:1]
    assert chosen(take, ()) == take.people
