"""Motions written to armatures: what was written is read, and is what Blender evaluates."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.geometry import matrix_from_rotvec

from .rigs import AWKWARD, BoneSpec, evaluated, make_rig

FRAMES = np.array([1.0, 2.0, 3.5, 5.0, 8.0])
NAMES = tuple(spec.name for spec in AWKWARD)
MOVABLE = tuple(spec.name for spec in AWKWARD if not spec.connected)


def random_motion(addon: Any, skeleton: Any, frames: np.ndarray, seed: int = 0) -> Any:
    """Large turns of all bones; all that may leave their place do, by centimetres."""
    rng = np.random.default_rng(seed)
    bones = len(skeleton.names)
    rotations = matrix_from_rotvec(rng.normal(size=(len(frames), bones, 3)) * 1.5)
    shifts = rng.normal(size=(len(frames), bones, 3)) * 0.1
    shifts[:, [name not in MOVABLE for name in skeleton.names]] = 0.0
    return addon("retarget.skeleton").place(skeleton, frames / 24, rotations, shifts)


def place_object(bpy: Any, obj: Any, scale: float) -> None:
    """Turned, away from the origin, of some size, below a parent that is turned itself."""
    above = bpy.data.objects.new("Above", None)
    bpy.context.scene.collection.objects.link(above)
    above.rotation_euler, above.location = (0.3, -0.4, 2.0), (1, 2, 3)
    obj.parent = above
    obj.rotation_euler, obj.location, obj.scale = (-1.57, 0.2, 0.1), (0.5, -0.3, 0.2), (scale,) * 3


@pytest.mark.parametrize("scale", [1.0, 0.01, 100.0])
def test_written_motion_is_read_and_evaluated(bpy: Any, addon: Any, scale: float) -> None:
    obj = make_rig(bpy)
    place_object(bpy, obj, scale)
    reading, writing = addon("rig.reading"), addon("rig.writing")
    skeleton = reading.read_skeleton(obj)
    # Metres mean the same on rigs of all sizes only if the rig itself is about as large as a person.
    motion = random_motion(addon, skeleton, FRAMES)
    action = writing.write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    assert obj.animation_data.action == action
    assert action.name == "New"
    size = max(scale, 1.0)
    axes, heads = evaluated(bpy, obj, skeleton.names, FRAMES)
    np.testing.assert_allclose(axes, motion.rotations, atol=2e-6)
    np.testing.assert_allclose(heads, motion.heads, atol=5e-6 * size)
    bpy.context.scene.frame_set(1)
    again = reading.read_motion(obj, skeleton, FRAMES)
    np.testing.assert_allclose(again.rotations, motion.rotations, atol=1e-6)
    np.testing.assert_allclose(again.heads, motion.heads, atol=1e-6 * size)
    np.testing.assert_allclose(again.times, FRAMES * bpy.context.scene.render.fps_base / bpy.context.scene.render.fps)


def test_curves_and_frame_by_frame_reading_agree_between_keys(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    reading = addon("rig.reading")
    skeleton = reading.read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES, seed=3)
    addon("rig.writing").write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    between = np.array([0.0, 1.25, 2.5, 4.0, 6.75, 9.0])
    from_curves = reading.read_motion(obj, skeleton, between)
    bpy.context.scene.frame_set(4, subframe=0.5)
    # A constraint that does nothing makes the rig one that is evaluated frame by frame.
    obj.pose.bones["head"].constraints.new("COPY_LOCATION").mute = True
    evaluated_motion = reading.read_motion(obj, skeleton, between)
    np.testing.assert_allclose(evaluated_motion.rotations, from_curves.rotations, atol=1e-5)
    np.testing.assert_allclose(evaluated_motion.heads, from_curves.heads, atol=1e-5)
    assert bpy.context.scene.frame_current_final == pytest.approx(4.5)


def test_curved_keys_are_read_as_blender_evaluates_them(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    bone = obj.pose.bones["hips"]
    for frame, angle in ((1, 0.0), (10, 1.3), (20, -0.4)):
        bone.rotation_euler = (angle, 0.3, -angle)
        bone.keyframe_insert("rotation_euler", frame=frame)
    frames = np.array([1.0, 4.3, 10.0, 17.5, 30.0])
    reading = addon("rig.reading")
    skeleton = reading.read_skeleton(obj)
    motion = reading.read_motion(obj, skeleton, frames)
    axes, heads = evaluated(bpy, obj, skeleton.names, frames)
    np.testing.assert_allclose(motion.rotations, axes, atol=1e-5)
    np.testing.assert_allclose(motion.heads, heads, atol=1e-5)


@pytest.mark.parametrize("ruled_by", ["constraint", "nla", "moving object", "moving parent", "scaled bone", "driver"])
def test_rigs_that_more_than_keys_move_are_read_as_evaluated(bpy: Any, addon: Any, ruled_by: str) -> None:
    obj = make_rig(bpy)
    bone = obj.pose.bones["hips"]
    bone.rotation_euler = (0.5, 0.2, 0.1)
    bone.keyframe_insert("rotation_euler", frame=1)
    bone.rotation_euler = (-0.5, 0.1, 0.4)
    bone.keyframe_insert("rotation_euler", frame=9)
    rule(bpy, obj, ruled_by)
    reading = addon("rig.reading")
    skeleton = reading.read_skeleton(obj)
    motion = reading.read_motion(obj, skeleton, FRAMES)
    _, heads = evaluated(bpy, obj, skeleton.names, FRAMES)
    np.testing.assert_allclose(motion.heads, heads, atol=1e-6)
    assert np.ptp(heads[:, skeleton.index("spine")], axis=0).max() > 0.02


def rule(bpy: Any, obj: Any, ruled_by: str) -> None:
    if ruled_by == "constraint":
        constraint = obj.pose.bones["spine"].constraints.new("LIMIT_ROTATION")
        constraint.use_limit_x = True
    elif ruled_by == "nla":
        animation = obj.animation_data
        animation.nla_tracks.new().strips.new("Strip", 3, animation.action)
        animation.action = None
    elif ruled_by == "moving object":
        obj.keyframe_insert("location", frame=1)
        obj.location.x = 3
        obj.keyframe_insert("location", frame=9)
    elif ruled_by == "moving parent":
        place_object(bpy, obj, 1.0)
        obj.parent.keyframe_insert("location", frame=1)
        obj.parent.location.x = 3
        obj.parent.keyframe_insert("location", frame=9)
    elif ruled_by == "scaled bone":
        obj.pose.bones["hips"].scale = (1.5, 1.5, 1.5)
    else:
        driver = obj.pose.bones["thigh"].driver_add("rotation_euler", 0).driver
        driver.expression = "frame * 0.1"


def test_the_rig_keeps_all_but_its_action(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    obj.pose.bones["head"].lock_location = (True, True, True)
    obj.pose.bones["head"].constraints.new("LIMIT_SCALE")
    obj.pose.bones["thigh"].keyframe_insert("location", frame=1)
    former = obj.animation_data.action
    before = rig_settings(obj)
    skeleton = addon("rig.reading").read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES)
    action = addon("rig.writing").write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    assert rig_settings(obj) == before
    assert action != former
    assert former.users == 1
    assert former.use_fake_user


def rig_settings(obj: Any) -> list[Any]:
    return [
        (
            b.name,
            b.rotation_mode,
            b.lock_location[:],
            b.lock_rotation[:],
            len(b.constraints),
            b.bone.matrix_local.copy(),
        )
        for b in obj.pose.bones
    ]


def test_only_named_bones_are_keyed_and_only_those_that_leave_get_a_location(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    skeleton = addon("rig.reading").read_skeleton(obj)
    shifts = np.zeros((len(FRAMES), len(NAMES), 3))
    shifts[:, skeleton.index("root")] = np.random.default_rng(0).normal(size=(len(FRAMES), 3))
    turns = matrix_from_rotvec(np.random.default_rng(1).normal(size=(len(FRAMES), len(NAMES), 3)))
    motion = addon("retarget.skeleton").place(skeleton, FRAMES / 24, turns, shifts)
    obj.pose.bones["shin"].location = (1, 2, 3)
    addon("rig.writing").write_motion(obj, skeleton, motion, "New", ("root", "hips", "shin"), FRAMES, moved=["hips"])
    curves = addon("rig.curves").curves_of(obj.animation_data)
    assert {path for path, _ in curves} == {
        'pose.bones["root"].rotation_quaternion',
        'pose.bones["root"].location',
        'pose.bones["hips"].rotation_euler',
        'pose.bones["hips"].location',
        'pose.bones["shin"].rotation_euler',
        'pose.bones["shin"].location',
    }
    bpy.context.scene.frame_set(1)
    assert np.allclose(obj.pose.bones["shin"].location, 0, atol=1e-6)


def test_a_pose_left_by_another_action_does_not_show_through(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    for bone in obj.pose.bones:
        bone.location, bone.scale = (0.3, 0.2, 0.1), (2, 2, 2)
    skeleton = addon("rig.reading").read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES)
    addon("rig.writing").write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    axes, heads = evaluated(bpy, obj, skeleton.names, FRAMES)
    np.testing.assert_allclose(axes, motion.rotations, atol=2e-6)
    np.testing.assert_allclose(heads, motion.heads, atol=5e-6)


def test_hundreds_of_bones_are_written_quickly(bpy: Any, addon: Any) -> None:
    import time

    chain = [BoneSpec("b0", None, (0, 0, 0), (0, 0, 0.01))]
    chain += [BoneSpec(f"b{n}", f"b{n - 1}", (0, 0, n / 100), (0, 0, (n + 1) / 100), mode="XYZ") for n in range(1, 160)]
    obj = make_rig(bpy, chain)
    skeleton = addon("rig.reading").read_skeleton(obj)
    frames = np.arange(1.0, 501.0)
    angles = 0.1 * np.sin(frames / 20)[:, None, None] * np.ones((1, len(chain), 3))
    motion = addon("retarget.skeleton").place(
        skeleton, frames / 24, skeleton.axes @ matrix_from_rotvec(angles), np.zeros((500, len(chain), 3))
    )
    start = time.perf_counter()
    addon("rig.writing").write_motion(obj, skeleton, motion, "New", skeleton.names, frames)
    again = addon("rig.reading").read_motion(obj, skeleton, frames)
    assert time.perf_counter() - start < 10
    np.testing.assert_allclose(again.rotations, motion.rotations, atol=2e-6)


# --- refusals -------------------------------------------------------------------------------------------------------


def refused(bpy: Any, addon: Any, obj: Any, match: str, bones: tuple[str, ...] = NAMES) -> None:
    """Writing must raise and leave no trace."""
    skeleton = addon("rig.reading").read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES)
    actions, active = len(bpy.data.actions), obj.animation_data and obj.animation_data.action
    with pytest.raises(UserError, match=match):
        addon("rig.writing").write_motion(obj, skeleton, motion, "New", bones, FRAMES)
    assert len(bpy.data.actions) == actions
    assert (obj.animation_data and obj.animation_data.action) == active


def test_locked_bones_are_refused(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    obj.pose.bones["shin"].lock_rotation = (True, True, True)
    refused(bpy, addon, obj, "locks the rotation of 'shin'")


def test_driven_bones_are_refused(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    obj.pose.bones["shin"].driver_add("rotation_euler", 0)
    refused(bpy, addon, obj, "drivers move 'shin'")


def test_a_rig_in_tweak_mode_is_refused(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    obj.pose.bones["shin"].keyframe_insert("location", frame=1)
    animation = obj.animation_data
    track = animation.nla_tracks.new()
    strip = track.strips.new("Strip", 1, animation.action)
    animation.action = None
    track.select = strip.select = True
    animation.nla_tracks.active = track
    animation.use_tweak_mode = True
    refused(bpy, addon, obj, "tweak mode")


def test_an_unknown_bone_is_refused(bpy: Any, addon: Any) -> None:
    refused(bpy, addon, make_rig(bpy), "no bone 'tail'", ("hips", "tail"))


def test_a_connected_bone_that_must_leave_is_refused(bpy: Any, addon: Any) -> None:
    obj = make_rig(bpy)
    skeleton = addon("rig.reading").read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES)
    motion.heads[:] += np.random.default_rng(0).normal(size=motion.heads.shape)
    with pytest.raises(UserError, match=r"'spine'.*connected"):
        addon("rig.writing").write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    assert len(bpy.data.actions) == 0


@pytest.fixture
def library(bpy: Any, tmp_path: Path) -> Path:
    make_rig(bpy, name="Library Rig")
    path = tmp_path / "ein Rig.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    return path


def linked(bpy: Any, library: Path) -> Any:
    with bpy.data.libraries.load(str(library), link=True) as (_, wanted):
        wanted.objects = ["Library Rig"]
    obj = bpy.data.objects["Library Rig"]
    bpy.context.scene.collection.objects.link(obj)
    return obj


def test_a_linked_rig_is_refused(bpy: Any, addon: Any, library: Path) -> None:
    refused(bpy, addon, linked(bpy, library), "linked from another file")


def test_a_locked_override_is_refused(bpy: Any, addon: Any, library: Path) -> None:
    obj = linked(bpy, library).override_create(remap_local_usages=True)
    obj.override_library.is_system_override = True
    refused(bpy, addon, obj, "not editable")


def test_an_editable_override_is_animated_and_stays_so(bpy: Any, addon: Any, library: Path, tmp_path: Path) -> None:
    obj = linked(bpy, library).override_create(remap_local_usages=True)
    obj.override_library.is_system_override = False
    skeleton = addon("rig.reading").read_skeleton(obj)
    motion = random_motion(addon, skeleton, FRAMES)
    addon("rig.writing").write_motion(obj, skeleton, motion, "New", NAMES, FRAMES)
    path = tmp_path / "shot.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
    obj = next(o for o in bpy.data.objects if o.override_library)
    _, heads = evaluated(bpy, obj, skeleton.names, FRAMES)
    np.testing.assert_allclose(heads, motion.heads, atol=5e-6)
