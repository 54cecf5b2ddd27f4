"""SMPL motion as AMASS stores it: a world with z up, many layouts, no body."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.take import JOINT_NAMES, PARENTS

from .blender_truth import bone_heads, data_counts

FRAMES = 6


def motion(values: int = 156, height: float = 0.9, **entries: Any) -> dict[str, Any]:
    """Somebody who stands upright in z, looks this way and that and moves along x, legs straight."""
    rng = np.random.default_rng(5)
    poses = np.zeros((FRAMES, values))
    # SMPL's y is up: a quarter turn about x lets it stand in z, a third about all axes also turns it to the side.
    poses[:, :3] = np.where(np.arange(FRAMES)[:, None] % 2, np.pi / 2 * np.eye(3)[0], 2 * np.pi / 3 * 3**-0.5)
    poses[:, 3 * 16 : 3 * 20] = 0.4 * rng.normal(size=(FRAMES, 12))
    trans = np.stack([0.1 * np.arange(FRAMES), np.zeros(FRAMES), np.full(FRAMES, height)], axis=1)
    return {"poses": poses, "trans": trans, "betas": np.zeros(16), "mocap_framerate": np.array(60.0), **entries}


def expected_joints(entries: dict[str, Any], rest: np.ndarray, scale: float) -> np.ndarray:
    """(T, 24, 3) in the file's own world: SMPL's forward kinematics, written out."""
    from mathutils import Matrix

    joints = np.zeros((FRAMES, 24, 3))
    for frame, pose in enumerate(entries["poses"].reshape(FRAMES, -1, 3)):
        turns = []
        for joint, parent in enumerate(PARENTS):
            angle = float(np.linalg.norm(pose[joint])) if joint < 22 else 0.0
            local = np.array(Matrix.Rotation(angle, 3, pose[joint].tolist() if angle else "X"))
            turns.append(turns[parent] @ local if parent >= 0 else local)
            step = turns[parent] @ (rest[joint] - rest[parent]) if parent >= 0 else rest[joint]
            joints[frame, joint] = joints[frame, parent] * (parent >= 0) + step
    return scale * joints + entries["trans"][:, None]


def load(bpy: Any, path: Path, entries: dict[str, Any]) -> Any:
    np.savez(path, **entries)
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(path)) == {"FINISHED"}
    (armature,) = (obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    return armature


@pytest.mark.parametrize("values", [66, 72, 156, 165])
def test_joints_move_as_in_the_file(values: int, bpy: Any, addon: Any, tmp_path: Path) -> None:
    entries = motion(values)
    armature = load(bpy, tmp_path / "walk poses.npz", entries)
    module = addon("scene_import.smpl_motion")
    read = module.read_smpl_motion(tmp_path / "walk poses.npz")
    scale, found = module.fit_scale(read, module.rest_joints())
    assert found
    heads = bone_heads(bpy, armature, range(1, FRAMES + 1))
    assert np.abs(heads - expected_joints(entries, module.rest_joints(), scale)).max() < 1e-4
    assert armature.name == "walk poses"
    assert {bone.name for bone in armature.data.bones} == set(JOINT_NAMES)
    assert bpy.context.scene.camera is None
    render = bpy.context.scene.render
    assert render.fps / render.fps_base == pytest.approx(60)


@pytest.mark.parametrize("height", [0.6, 0.9, 1.05])
def test_the_size_lets_the_feet_reach_the_floor(height: float, bpy: Any, addon: Any, tmp_path: Path) -> None:
    armature = load(bpy, tmp_path / "walk.npz", motion(height=height))
    heads = bone_heads(bpy, armature, range(1, FRAMES + 1))
    lowest = heads[..., 2].min()
    assert 0.0 < lowest < 0.035
    # A standing adult's hips are at half the body's height.
    assert armature["height_m"] == pytest.approx(1.9 * heads[0, 1, 2], rel=0.15)


def test_without_a_floor_the_size_is_the_average(bpy: Any, addon: Any, tmp_path: Path) -> None:
    module = addon("scene_import.smpl_motion")
    np.savez(tmp_path / "flying.npz", **motion(height=20.0))
    read = module.read_smpl_motion(tmp_path / "flying.npz")
    assert module.fit_scale(read, module.rest_joints()) == (1.0, False)
    (note,) = module.take_of(read, "flying").meta.warnings
    assert "1.70 m" in note
    assert "no floor" in note


@pytest.mark.parametrize("key", ["mocap_framerate", "mocap_frame_rate", "framerate", "fps"])
def test_the_rate_has_many_names(key: str, addon: Any, tmp_path: Path) -> None:
    entries = motion()
    del entries["mocap_framerate"]
    np.savez(tmp_path / "walk.npz", **entries, **{key: np.array(120)})
    read = addon("scene_import.smpl_motion").read_smpl_motion(tmp_path / "walk.npz")
    assert (read.rate, read.rate_known) == (Fraction(120), True)


def test_a_missing_rate_is_assumed_and_said(addon: Any, tmp_path: Path) -> None:
    entries = motion()
    del entries["mocap_framerate"]
    np.savez(tmp_path / "walk.npz", **entries)
    take = addon("scene_import.motion_files").read_motion_file(tmp_path / "walk.npz")
    assert take.meta.frame_rate == 30
    assert [note for note in take.meta.warnings if "no frame rate" in note]


@given(rate=st.sampled_from([23.976, 29.97, 59.94, 119.88, 59.94006]))
def test_rounded_ntsc_rates_are_what_they_mean(rate: float, addon: Any) -> None:
    exact = addon("scene_import.smpl_motion").exact_rate(rate)
    assert exact.denominator == 1001
    assert float(exact) == pytest.approx(rate, abs=2e-3)


@given(rate=st.sampled_from([24.0, 25.0, 30.0, 60.0, 100.0, 120.0, 12.5, 150.0]))
def test_plain_rates_stay(rate: float, addon: Any) -> None:
    assert float(addon("scene_import.smpl_motion").exact_rate(rate)) == rate


BAD = {
    "poses has shape": motion(poses=np.zeros((FRAMES, 70))),
    "trans has shape": motion(trans=np.zeros((FRAMES, 2))),
    "trans is empty or holds values": motion(trans=np.full((FRAMES, 3), np.nan)),
    "poses holds no plain numbers": motion(poses=np.array([{"pickled": 1}], dtype=object)),
    "frame rate 0": motion(mocap_framerate=np.array(0.0)),
}


@pytest.mark.parametrize("reason", BAD)
def test_damaged_files_are_refused(reason: str, bpy: Any, tmp_path: Path) -> None:
    np.savez(tmp_path / "bad.npz", **BAD[reason])
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=reason):
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "bad.npz"))
    assert data_counts(bpy) == before
