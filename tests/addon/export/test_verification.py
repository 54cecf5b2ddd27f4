"""Reading files back finds what is wrong, and leaves nothing behind."""

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.addon.blender_truth import data_counts
from tests.addon.take_factory import TakeSpec, make_take

from .test_profiles import SPEC, import_people


@pytest.fixture
def written(bpy: Any, addon: Any, tmp_path: Path) -> Any:
    """Two people in one file, and all that is needed to verify it."""
    imported = import_people(bpy, addon("scene_import.take_import"), make_take(SPEC))
    performance = addon("export.performance")
    addon("export.exporting").export_objects(bpy.context, imported.armatures, tmp_path / "match.fbx")
    timing = performance.timing_of(bpy.context.scene, 0)
    characters = performance.characters_among(bpy.context, imported.armatures)
    people = [performance.perform(bpy.context, character, timing) for character in characters]

    def verify(people: list[Any], nodes: tuple[str, ...] = ("Person 1", "Person 2")) -> Any:
        temporary = addon("export.temporary")
        profile = dataclasses.replace(addon("export.profiles").load_profile("generic"), format="fbx")
        with temporary.free_names(nodes):
            return addon("export.verification").verify(
                bpy.context, tmp_path / "match.fbx", nodes, people, timing, profile
            )

    return verify, people


def problems(checks: Any) -> list[str]:
    return ["; ".join(check.problems) for check in checks]


def test_a_true_file_passes_and_says_how_well(written: Any) -> None:
    verify, people = written
    for check in verify(people):
        assert check.passed
        assert (check.bones, check.bones_wanted) == (24, 24)
        assert 0 < check.joint_error_m < 1e-4
        assert check.scale == pytest.approx(1.0, abs=1e-4)
        assert check.character in check.action


def test_swapped_motions_are_found(written: Any) -> None:
    verify, (first, second) = written
    swapped = [
        dataclasses.replace(first, motion=second.motion),
        dataclasses.replace(second, motion=first.motion),
    ]
    for text in problems(verify(swapped)):
        assert "off its path" in text
        assert "joints" in text


def test_two_millimetres_are_found_and_half_a_millimetre_is_not(written: Any) -> None:
    verify, (first, second) = written
    for shift, passed in ((2e-3, False), (5e-4, True)):
        heads = first.motion.heads.copy()
        heads[-1, 20, 0] += shift
        moved = dataclasses.replace(first, motion=dataclasses.replace(first.motion, heads=heads))
        checks = verify([moved, second])
        assert [check.passed for check in checks] == [passed, True]


def test_another_size_and_missing_people_are_found(written: Any) -> None:
    verify, (first, second) = written
    small = dataclasses.replace(first.skeleton, heads=0.98 * first.skeleton.heads)
    assert "1.02 times as large" in problems(verify([dataclasses.replace(first, skeleton=small), second]))[0]
    checks = verify([first, second], ("Person 1", "Anna"))
    assert problems(checks) == ["", "is not in the file"]


def test_a_missing_bone_is_named(written: Any) -> None:
    verify, (first, second) = written
    names = tuple("tail" if name == "head" else name for name in first.skeleton.names)
    other = dataclasses.replace(first, skeleton=dataclasses.replace(first.skeleton, names=names))
    assert problems(verify([other, second])) == ["lacks the bone tail", ""]


def test_nothing_stays_and_names_are_as_before(written: Any, bpy: Any) -> None:
    verify, people = written
    bpy.data.objects["Person 1"].name = "Someone else"
    empty = bpy.data.objects.new("Person 1", None)
    bpy.context.scene.collection.objects.link(empty)
    before, names = data_counts(bpy), sorted(obj.name for obj in bpy.data.objects)
    assert all(check.passed for check in verify(people))
    assert data_counts(bpy) == before
    assert sorted(obj.name for obj in bpy.data.objects) == names
    assert empty.name == "Person 1"
    assert bpy.context.scene.name == "Scene"


def test_what_fails_inside_a_temporary_scene_leaves_nothing(bpy: Any, addon: Any) -> None:
    before = data_counts(bpy)
    temporary = addon("export.temporary")

    def fail() -> None:
        with temporary.temporary_scene(bpy.context, "stage"):
            bpy.context.scene.collection.objects.link(bpy.data.objects.new("A", bpy.data.meshes.new("A")))
            raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        fail()
    assert data_counts(bpy) == before


def test_people_of_several_sizes_keep_them(bpy: Any, addon: Any, tmp_path: Path) -> None:
    imported = import_people(bpy, addon("scene_import.take_import"), make_take(TakeSpec(people=3, frames=3, points=8)))
    done = addon("export.exporting").export_objects(bpy.context, imported.armatures, tmp_path / "match.glb")
    assert np.allclose([check.scale for check in done.checks], 1.0, atol=1e-5)
    assert len({check.character for check in done.checks}) == 3
