"""SMPL poses in ROMP's and BEV's forms, old and new, and as plain arrays."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from core_solver.body.kinematics import pose_joints
from core_solver.errors import UserError
from core_solver.perception.precomputed.smpl import GivenPose, joint_pixels, landmarks_from, read_smpl
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.precomputed.damage import damaged, value_or_user_error

BODY = make_stick_body()
RNG = np.random.default_rng(5)
THETA = RNG.normal(0, 0.4, (3, 72)).astype(np.float32)
POINTS = RNG.uniform(0, 500, (3, 71, 2)).astype(np.float32)
CAMERA = np.array([[0.5, 0.1, -0.2]] * 3, np.float32)


def simple_romp(people: slice, **more: object) -> dict[str, object]:
    """What simple_romp keeps of a frame: one table of stacked arrays."""
    return {"smpl_thetas": THETA[people], "smpl_betas": np.zeros((3, 10), np.float32)[people], "cam": CAMERA[people],
            "cam_trans": CAMERA[people], "pj2d_org": POINTS[people], "center_confs": np.ones((3, 1))[people],
            **more}  # fmt: skip


def assert_same(poses: tuple[GivenPose, ...], people: list[int]) -> None:
    assert len(poses) == len(people)
    for pose, i in zip(poses, people, strict=True):
        np.testing.assert_array_equal(pose.theta, THETA[i].reshape(24, 3))
        if pose.points is not None:
            np.testing.assert_array_equal(pose.points, POINTS[i, :24])


def test_romp_a_file_a_frame(tmp_path: Path) -> None:
    np.savez(tmp_path / "img_000004.npz", results=simple_romp(slice(0, 2)))  # type: ignore[arg-type]
    np.savez(tmp_path / "img_000011.npz", results=simple_romp(slice(2, 3)))  # type: ignore[arg-type]
    np.savez(tmp_path / "video_results.npz", results={})  # type: ignore[arg-type]
    frames = read_smpl(tmp_path)
    assert set(frames) == {4, 11}
    assert_same(frames[4], [0, 1])
    assert_same(frames[11], [2])
    assert frames[4][0].identity is None


def test_romp_of_old_a_list_of_people(tmp_path: Path) -> None:
    people = [{"cam": CAMERA[i], "poses": THETA[i], "betas": np.zeros(10), "pj2d_org": POINTS[i, :54]} for i in (0, 2)]
    np.savez(tmp_path / "000002.npz", results=people)
    for number, nobody in enumerate(([], {}, None), 3):
        np.savez(tmp_path / f"{number:06d}.npz", results=nobody)  # type: ignore[arg-type]
    frames = read_smpl(tmp_path)
    assert_same(frames[2], [0, 2])
    assert [frames[number] for number in (3, 4, 5)] == [(), (), ()]


def test_all_frames_in_one_file_by_name(tmp_path: Path) -> None:
    results = {"frames/0007.jpg": simple_romp(slice(0, 1)), "frames/0003.jpg": simple_romp(slice(1, 3))}
    np.savez(tmp_path / "video_results.npz", results=results)  # type: ignore[arg-type]
    frames = read_smpl(tmp_path)
    assert set(frames) == {7, 3}
    assert_same(frames[3], [1, 2])


def test_plain_arrays(tmp_path: Path) -> None:
    np.savez(tmp_path / "smpl.npz", frames=[5, 9, 5], global_orient=THETA[:, :3], body_pose=THETA[:, 3:66],
             cam=CAMERA, ids=[8, 8, 2])  # fmt: skip
    frames = read_smpl(tmp_path / "smpl.npz")
    assert [p.identity for p in frames[5]] == [8, 2]
    np.testing.assert_array_equal(frames[9][0].theta[:22].ravel(), THETA[1, :66])
    assert not frames[9][0].theta[22:].any()
    np.testing.assert_array_equal(frames[5][1].camera, CAMERA[2])


def test_ids_that_name_two_people_of_a_frame_are_no_identities(tmp_path: Path) -> None:
    np.savez(tmp_path / "smpl.npz", frames=[5, 9, 5], pose=THETA, ids=[8, 8, 8])
    assert {p.identity for poses in read_smpl(tmp_path).values() for p in poses} == {None}


def test_a_pose_becomes_landmarks_about_the_hips() -> None:
    theta = np.zeros((24, 3))
    theta[0] = (np.pi, 0, 0)  # upright before a camera whose y points down
    points = landmarks_from(theta, BODY)
    np.testing.assert_allclose(points[[11, 12]].mean(axis=0), 0, atol=1e-6)
    assert points[0, 1] < -0.3, "the nose is above the hips"
    assert points[15, 1] > 0.5, "an ankle below"
    assert points[5, 0] > points[6, 0], "the left shoulder of somebody who faces the camera is on the right"
    turn = np.zeros((24, 3))
    turn[0] = (0, 0.7, 0)
    rest = BODY.rest_keypoints(BODY.neutral_betas)
    rest = rest - rest[[11, 12]].mean(axis=0)
    c, s = np.cos(0.7), np.sin(0.7)
    np.testing.assert_allclose(landmarks_from(turn, BODY), rest @ [[c, 0, -s], [0, 1, 0], [s, 0, c]], atol=1e-6)


def test_romps_camera_looks_at_a_square_around_the_picture() -> None:
    theta = np.zeros((24, 3))
    pose = GivenPose(theta, None, np.array([0.5, 0.25, -0.5]))
    pixels = joint_pixels(pose, BODY, (400, 200))
    assert pixels is not None
    _, joints = pose_joints(theta, BODY.rest_joints(BODY.neutral_betas))
    # A square of 400 pixels: its middle is the picture's, 1 is 200 pixels.
    np.testing.assert_allclose(pixels[:, 0], 200 + 200 * (0.5 * joints[:, 0] - 0.5))
    np.testing.assert_allclose(pixels[:, 1], 100 + 200 * (0.5 * joints[:, 1] + 0.25))


@pytest.mark.parametrize(
    ("arrays", "complaint"),
    [
        ({"smpl_thetas": THETA[:, :70]}, "70 numbers are no SMPL pose"),
        ({"smpl_thetas": THETA * np.nan}, "no rotations"),
        ({"smpl_thetas": THETA * 100}, "no rotations"),
        ({"betas": THETA}, "names no SMPL pose"),
        ({"smpl_thetas": THETA, "cam": CAMERA[:2]}, "one row for each of its 3"),
        ({"smpl_thetas": THETA, "pj2d_org": POINTS[:, :20]}, "20 points"),
        ({"smpl_thetas": THETA, "frames": [1, 2]}, "one whole number for each of its 3"),
    ],
)
def test_what_cannot_be_a_pose_is_refused(tmp_path: Path, arrays: dict[str, np.ndarray], complaint: str) -> None:
    np.savez(tmp_path / "f_1.npz", **arrays)
    with pytest.raises(UserError, match=complaint):
        read_smpl(tmp_path / "f_1.npz")


def test_a_file_that_does_not_say_its_frames_is_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "smpl.npz", pose=THETA)
    with pytest.raises(UserError, match="which frames"):
        read_smpl(tmp_path)


class Evil:
    """Would run a command when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


def test_nothing_in_a_file_is_run(tmp_path: Path) -> None:
    trace = tmp_path / "it_ran"
    np.savez(tmp_path / "000001.npz", results=[{"smpl_thetas": Evil(trace)}])  # type: ignore[arg-type]
    with pytest.raises(UserError, match=r"000001\.npz.*system"):
        read_smpl(tmp_path)
    assert not trace.exists()


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    folder = tmp_path_factory.mktemp("whole")
    np.savez(folder / "a.npz", results=simple_romp(slice(0, 2)))  # type: ignore[arg-type]
    np.savez_compressed(folder / "b.npz", frames=[5, 9, 5], pose=THETA, ids=[8, 8, 2], cam=CAMERA)
    return [(folder / name).read_bytes() for name in ("a.npz", "b.npz")]


@pytest.mark.parametrize("kind", [0, 1])
def test_damaged_files_give_a_line_or_poses(tmp_path: Path, whole: list[bytes], kind: int) -> None:
    @given(damaged(whole[kind]))
    @settings(deadline=None, max_examples=150, suppress_health_check=list(HealthCheck), database=None)
    def check(content: bytes) -> None:
        for poses in (value_or_user_error(tmp_path / "f_1.npz", content, read_smpl) or {}).values():
            for pose in poses:
                assert pose.theta.shape == (24, 3)
                assert np.isfinite(pose.theta).all()

    check()
