"""People are seen only from their first to their last frame with evidence, while their motion stays whole."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.take import JOINT_NAMES, Take, write_take

from .blender_truth import armature_of, bone_heads
from .take_factory import TakeSpec, make_take

SPEC = TakeSpec(people=2, frames=14, absence=4, points=8)


@pytest.fixture
def take(tmp_path: Path) -> Take:
    take = make_take(SPEC)
    write_take(tmp_path / "match.npz", take)
    return take


def seen_objects(bpy: Any) -> set[str]:
    """What the viewport shows at the current frame."""
    return {instance.object.name for instance in bpy.context.evaluated_depsgraph_get().object_instances}


def bones_shown(bpy: Any, armature: Any) -> bool:
    evaluated = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return all(any(c.is_visible for c in bone.collections) for bone in evaluated.data.bones)


@given(valid=st.lists(st.booleans(), min_size=1, max_size=12))
def test_present_between_the_first_and_the_last_frame_seen(valid: list[bool], addon: Any) -> None:
    present = addon("scene_import.presence").presence(np.array(valid)).tolist()
    for frame, shown in enumerate(present):
        before, after = valid[: frame + 1], valid[frame:]
        assert shown == ((any(before) and any(after)) or not any(valid))


@pytest.mark.parametrize("order", [1, -1])
def test_body_and_bones_are_hidden_while_away(order: int, take: Take, bpy: Any, tmp_path: Path) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"))
    there = {1: set(range(5, 15)), 2: set(range(1, 11))}
    for frame in range(1, 15)[::order]:
        bpy.context.scene.frame_set(frame)
        seen = seen_objects(bpy)
        for index, person in enumerate(take.people, start=1):
            armature = armature_of(bpy, person)
            body = armature.children[0]
            here = frame in there[index]
            assert (body.name in seen) == here
            assert body.evaluated_get(bpy.context.evaluated_depsgraph_get()).hide_render != here
            assert bones_shown(bpy, armature) == here
            assert (armature["present"] > 0.5) == here


def test_bones_go_on_being_posed_while_away(take: Take, bpy: Any, addon: Any, tmp_path: Path) -> None:
    heads = []
    take_import = addon("scene_import.take_import")
    for hide_absent in (True, False):
        bpy.ops.wm.read_homefile(use_empty=True)
        options = take_import.ImportOptions(hide_absent=hide_absent)
        imported = take_import.import_take(bpy.context, take, tmp_path / "match.npz", options)
        heads.append([bone_heads(bpy, armature, range(1, 15)) for armature in imported.armatures])
    assert np.array_equal(heads[0], heads[1])


def test_everybody_stays_when_asked(take: Take, bpy: Any, tmp_path: Path) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"), hide_absent=False)
    for frame in (1, 14):
        bpy.context.scene.frame_set(frame)
        for person in take.people:
            armature = armature_of(bpy, person)
            assert armature.children[0].name in seen_objects(bpy)
            assert bones_shown(bpy, armature) or not armature.data.collections


def test_times_of_presence_are_those_of_an_exported_animation(take: Take, bpy: Any, tmp_path: Path) -> None:
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"))
    first, second = (armature_of(bpy, person) for person in take.people)
    frame = 1001 / 30000
    assert (first["present_from_s"], first["present_until_s"]) == pytest.approx((5 * frame, 14 * frame))
    assert (second["present_from_s"], second["present_until_s"]) == pytest.approx((frame, 10 * frame))


@pytest.mark.parametrize("ending", [".glb", ".fbx"])
def test_files_hold_people_who_are_away_at_the_moment(
    ending: str, take: Take, bpy: Any, addon: Any, tmp_path: Path
) -> None:
    take_import = addon("scene_import.take_import")
    imported = take_import.import_take(
        bpy.context, take, tmp_path / "match.npz", take_import.ImportOptions(cloud=False)
    )
    imported.armatures[1].hide_set(True)
    bpy.context.scene.frame_set(1)
    before = seen_objects(bpy)
    objects = [*imported.armatures, *imported.bodies]
    addon("export.exporting").export_objects(bpy.context, objects, tmp_path / f"scene{ending}")
    bpy.context.scene.frame_set(1)
    assert seen_objects(bpy) == before
    assert "Person 1 body" not in before
    assert imported.armatures[1].hide_get()
    bpy.ops.wm.read_homefile(use_empty=True)
    importer = bpy.ops.import_scene.gltf if ending == ".glb" else bpy.ops.import_scene.fbx
    importer(filepath=str(tmp_path / f"scene{ending}"))
    skins = [o for o in bpy.data.objects if o.type == "MESH" and o.vertex_groups]
    assert len(skins) == 2
    for name in ("Person 1", "Person 2"):
        assert set(JOINT_NAMES) <= {bone.name for bone in bpy.data.objects[name].data.bones}
        assert bpy.data.objects[name].animation_data.action is not None
    assert bpy.data.objects["Person 1"]["present_from_s"] == pytest.approx(5 * 1001 / 30000)
