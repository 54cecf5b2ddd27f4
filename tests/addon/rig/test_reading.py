"""Armatures as skeletons."""

from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError

from .rigs import AWKWARD, BoneSpec, evaluated, make_rig
from .test_writing import place_object


@pytest.mark.parametrize("scale", [1.0, 0.01, 100.0])
def test_a_skeleton_is_the_rig_at_rest_in_the_world(bpy: Any, addon: Any, scale: float) -> None:
    obj = make_rig(bpy)
    place_object(bpy, obj, scale)
    skeleton = addon("rig.reading").read_skeleton(obj)
    axes, heads = evaluated(bpy, obj, skeleton.names, [1])
    np.testing.assert_allclose(skeleton.axes, axes[0], atol=1e-6)
    np.testing.assert_allclose(skeleton.heads, heads[0], atol=1e-5 * max(scale, 1))
    np.testing.assert_allclose(
        np.swapaxes(skeleton.axes, -1, -2) @ skeleton.axes, np.tile(np.eye(3), (8, 1, 1)), atol=1e-12
    )
    assert skeleton.to_world.scale == pytest.approx(scale)
    by_name = {spec.name: spec for spec in AWKWARD}
    assert set(skeleton.names) == set(by_name)
    for index, name in enumerate(skeleton.names):
        parent = skeleton.parents[index]
        assert parent < index
        assert (skeleton.names[parent] if parent >= 0 else None) == by_name[name].parent
        length = np.linalg.norm(np.subtract(by_name[name].tail, by_name[name].head))
        assert skeleton.lengths[index] == pytest.approx(length * scale, rel=1e-5)
        assert skeleton.turns_with_parent[index] == by_name[name].inherits_rotation


def test_the_present_pose_is_no_part_of_the_rest(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    at_rest = addon("rig.reading").read_skeleton(obj)
    obj.pose.bones["hips"].location = (1, 2, 3)
    obj.pose.bones["root"].rotation_quaternion = (0.5, 0.5, 0.5, 0.5)
    np.testing.assert_array_equal(addon("rig.reading").read_skeleton(obj).heads, at_rest.heads)


@pytest.mark.parametrize(
    ("scale", "match"), [((1, 1, 2), "stretched"), ((-1, 1, 1), "mirrored"), ((0, 0, 0), "no size")]
)
def test_stretched_and_mirrored_rigs_are_refused(
    bpy: Any, addon: Any, scale: tuple[float, float, float], match: str
) -> None:
    obj = make_rig(bpy)
    obj.scale = scale
    with pytest.raises(UserError, match=f"'Rig'.*{match}.*apply its scale"):
        addon("rig.reading").read_skeleton(obj)


def test_a_slightly_uneven_scale_is_rounding(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    obj.scale = (100.0, 99.99999, 99.99995)
    assert addon("rig.reading").read_skeleton(obj).to_world.scale == pytest.approx(100.0)


def test_other_objects_are_refused(bpy: Any, addon: Any) -> None:
    with pytest.raises(UserError, match="'Thing' is no armature"):
        addon("rig.reading").read_skeleton(bpy.data.objects.new("Thing", None))


def test_an_armature_without_bones_is_refused(bpy: Any, addon: Any) -> None:
    with pytest.raises(UserError, match="no bones"):
        addon("rig.reading").read_skeleton(make_rig(bpy, ()))


def test_bone_names_may_hold_anything(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy, [BoneSpec('a "b" \\ ü.L', None, (0, 0, 0), (0, 0, 1))])
    reading = addon("rig.reading")
    skeleton = reading.read_skeleton(obj)
    bone = obj.pose.bones[0]
    bone.location = (1, 0, 0)
    bone.keyframe_insert("location", frame=1)
    bone.location = (2, 0, 0)
    bone.keyframe_insert("location", frame=2)
    heads = reading.read_motion(obj, skeleton, np.array([1.0, 2.0])).heads
    assert np.linalg.norm(heads[1, 0] - heads[0, 0]) == pytest.approx(1.0)
