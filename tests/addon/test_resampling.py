"""A take at the scene's own frame rate: true speed, exact fractions, the shortest way between rotations."""

import dataclasses
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.take import write_take

from .blender_truth import armature_of, bone_heads
from .take_factory import TakeSpec, make_take, person_joints
from .test_import_motion import world_of

NTSC = [Fraction(24000, 1001), Fraction(30000, 1001), Fraction(60000, 1001)]
rates = st.sampled_from([*NTSC, Fraction(24), Fraction(25), Fraction(30), Fraction(60), Fraction(120), Fraction(25, 2)])


@given(take_rate=rates, scene_rate=rates, frames=st.integers(1, 90))
def test_a_scene_frame_shows_the_moment_of_its_own_time(
    take_rate: Fraction, scene_rate: Fraction, frames: int, addon: Any
) -> None:
    take = make_take(TakeSpec(people=0, frames=frames, points=4, rate=take_rate))
    clock = addon("scene_import.clock").clock_of_scene(take, 7, scene_rate)
    exact = [Fraction(i) * take_rate / scene_rate for i in range(len(clock.moments))]
    assert clock.moments.tolist() == [float(moment) for moment in exact]
    assert clock.moments[-1] <= frames - 1 < exact[-1] + take_rate / scene_rate
    assert (clock.frames[0], clock.frames[-1]) == (7, clock.end)


def test_an_hour_of_ntsc_does_not_drift(addon: Any) -> None:
    take = make_take(TakeSpec(people=0, frames=3600 * 30 + 1, points=4, rate=NTSC[1]))
    clock = addon("scene_import.clock").clock_of_scene(take, 1, Fraction(24))
    # 3603.6 seconds at 24 frames per second.
    assert len(clock.moments) == int(3603.6 * 24) + 1
    assert clock.moments[24 * 1001 * 3] == 30000 * 3


def test_a_video_of_varying_rate_goes_by_its_time_stamps(addon: Any) -> None:
    take = make_take(TakeSpec(people=0, frames=5, points=4, rate=Fraction(10)))
    take = dataclasses.replace(take, times=np.array([3.0, 3.1, 3.2, 3.6, 4.0]))
    clock = addon("scene_import.clock").clock_of_scene(take, 1, Fraction(5))
    assert clock.moments == pytest.approx([0, 2, 2.5, 3, 3.5, 4])


def quaternion(vector: np.ndarray) -> Any:
    """Blender's own, which interpolates by itself; in single precision, so that small angles are rough."""
    from mathutils import Quaternion

    return Quaternion(vector.tolist(), float(np.linalg.norm(vector)))


@given(seed=st.integers(0, 99), moments=st.lists(st.floats(0, 11), min_size=1, max_size=9))
def test_rotations_turn_evenly_the_shortest_way(seed: int, moments: list[float], addon: Any) -> None:
    person = make_take(TakeSpec(people=1, points=4, seed=seed)).people[0]
    seen = addon("scene_import.resampling").resample(person, np.array(moments))
    for joint in (0, 4, 16):
        turns = [quaternion(vector) for vector in person.theta[:, joint]]
        for moment, vector in zip(moments, seen.theta[:, joint], strict=True):
            after = min(int(moment) + 1, 11)
            truth = turns[int(moment)].slerp(turns[after], moment - int(moment))
            # q and -q are one rotation.
            assert abs(truth.normalized().dot(quaternion(vector))) > 1 - 1e-6
    path = np.stack([np.interp(moments, np.arange(12), person.gamma[:, axis]) for axis in range(3)], axis=1)
    assert np.abs(seen.gamma - path).max() < 1e-5
    assert seen.valid.tolist() == [bool(person.valid[int(moment + 0.5)]) for moment in moments]


def test_whole_moments_are_the_takes_own_frames(addon: Any) -> None:
    person = make_take(TakeSpec(people=1, points=4)).people[0]
    seen = addon("scene_import.resampling").resample(person, np.array([0.0, 3.0, 6.0]))
    for name in ("theta", "gamma", "contacts", "confidence", "valid"):
        assert np.array_equal(getattr(seen, name), getattr(person, name)[[0, 3, 6]])


@pytest.mark.parametrize("base", [1.0, 1.001])
def test_the_scene_keeps_its_rate_and_people_their_speed(base: float, bpy: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=2, frames=13, points=8, rate=Fraction(30000, 1001)))
    write_take(tmp_path / "match.npz", take)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = 60, base
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"), rate="SCENE", start_frame=5)
    assert (scene.render.fps, scene.render.fps_base) == (60, pytest.approx(base))
    assert (scene.frame_start, scene.frame_end) == (5, 29)
    # Every other frame of the scene, almost or exactly, is a frame of the take.
    double = 60 / base * 1001 / 30000
    world = world_of(take)
    for person in take.people:
        frames = 5 + double * np.arange(13)
        inside = frames <= scene.frame_end
        heads = bone_heads(bpy, armature_of(bpy, person), frames[inside])
        error = np.linalg.norm(heads - world.apply(person_joints(person))[inside], axis=-1)
        assert error.max() < (1e-4 if base > 1 else 0.02)


def test_footage_stays_in_step_at_another_rate(bpy: Any, tmp_path: Path) -> None:
    from .test_footage import write_video

    take = make_take(TakeSpec(people=0, frames=5, width=32, height=32, points=8, rate=Fraction(30), first_frame=2))
    write_take(tmp_path / "match.npz", take)
    write_video(tmp_path / "clip.y4m", [np.zeros((32, 32))] * 9)
    scene = bpy.context.scene
    scene.render.fps = 60
    bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "match.npz"), rate="SCENE", start_frame=10)
    clip = scene.camera.data.background_images[0].clip
    shown = []
    for frame in range(10, scene.frame_end + 1):
        scene.frame_set(frame)
        evaluated = clip.evaluated_get(bpy.context.evaluated_depsgraph_get())
        shown.append(frame - evaluated.frame_start)
    assert shown == [2, 3, 3, 4, 4, 5, 5, 6, 6]
