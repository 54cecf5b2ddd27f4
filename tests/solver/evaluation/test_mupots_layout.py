"""`evaluate mupots` on files of exactly the dataset's layout, written here: the dataset itself is not at hand."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from core_solver.body import JOINT_NAMES
from core_solver.evaluation.mupots_layout import read_mupots
from core_solver.take import write_take
from tests.solver.evaluation.real_takes import (
    CAMERA,
    empty_images,
    evaluate,
    joints_of,
    moved,
    only,
    refusal,
    rows_of,
    standing_take,
)

# The dataset's joints by ours; the first, the top of the head, has none.
OURS = [
    None, "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", None, "spine2", "head",
]  # fmt: skip
WRIST, ANKLE = 4, 13


def skeletons_of(take) -> np.ndarray:
    """(P, T, 17, 3) metres in the dataset's order, from independent kinematics."""
    joints = joints_of(take)

    def joint(name: str) -> np.ndarray:
        return joints[:, :, JOINT_NAMES.index(name)]

    middle = (joint("left_hip") + joint("right_hip")) / 2
    named = {0: _tops(take, joint("head")), 14: middle}
    return np.stack([named[k] if name is None else joint(name) for k, name in enumerate(OURS)], axis=2)


def _tops(take, heads: np.ndarray) -> np.ndarray:
    """The highest vertex of the box person's head follows its head joint."""
    parents = take.meta.parents
    chain = [JOINT_NAMES.index("head")]
    while parents[chain[-1]] >= 0:
        chain.append(parents[chain[-1]])
    tops = np.empty_like(heads)
    for index, person in enumerate(take.people):
        turn = Rotation.identity()
        for joint in reversed(chain):
            turn = turn * Rotation.from_rotvec(person.theta[:, joint].astype(float))
        vertex = person.rest_vertices[np.argmax(person.rest_vertices[:, 1])]
        tops[index] = heads[index] + person.scale * turn.apply(vertex - person.rest_joints[chain[0]])
    return tops


def write_sequence(directory: Path, true: np.ndarray, valid=None, standard=None) -> None:
    """annot.mat and occlusion.mat of skeletons (N, T, 17, 3) in metres."""
    people, frames = true.shape[:2]
    annotations = np.empty((frames, people), object)
    occlusion = np.empty((frames, people), object)
    standard = true if standard is None else standard
    for frame, person in np.ndindex(frames, people):
        points = true[person, frame]
        annotations[frame, person] = {
            "annot2": (points[:, :2] / points[:, 2:] * CAMERA.fx + (CAMERA.cx, CAMERA.cy)).T,
            "annot3": points.T * 1000,
            "univ_annot3": standard[person, frame].T * 1000,
            "isValidFrame": float(True if valid is None else valid[person, frame]),
        }
        occlusion[frame, person] = np.zeros((1, 17))
    directory.mkdir(parents=True)
    savemat(directory / "annot.mat", {"annotations": annotations})
    savemat(directory / "occlusion.mat", {"occlusion_labels": occlusion})
    empty_images(directory, frames)


@pytest.fixture
def take():
    return standing_take(2, 12)


# --- reading ---


def test_the_file_is_read_in_metres_and_in_our_order(tmp_path, take):
    true = skeletons_of(take)
    valid = np.ones((2, 12), bool)
    valid[1, 5:] = False
    write_sequence(tmp_path / "TS1", true, valid)
    sequence = read_mupots(tmp_path / "TS1")
    np.testing.assert_array_equal(sequence.annotated, valid)
    np.testing.assert_allclose(sequence.truth.joints[valid], true[:, :, :14][valid])
    np.testing.assert_allclose(sequence.standard[valid], true[valid])
    assert np.isnan(sequence.truth.joints[1, 5:]).all()
    hips = sequence.truth.roots[0, 0]
    assert hips == pytest.approx((true[0, 0, 8] + true[0, 0, 11]) / 2)


# --- numbers ---


def test_right_takes_have_no_errors_and_the_mean_is_over_sequences(capsys, tmp_path, take):
    for name in ("TS10", "TS2"):
        write_sequence(tmp_path / name, skeletons_of(take))
        write_take(tmp_path / name / "take.npz", moved(take, (0, 0, 0.1)) if name == "TS2" else take)
    rows = rows_of(capsys, "mupots", tmp_path)
    assert [row["sequence"] for row in rows] == ["TS2", "TS10", "mean"]
    assert [row["mrpe_mm"] for row in rows] == pytest.approx([100, 0, 50], abs=0.02)
    for row in rows:
        for name in ("ap25", "ap25_matched", "pck3d", "pck3d_official_all", "pck3d_official_matched", "depth_order"):
            assert row[name] == pytest.approx(1), name
        assert row["mpjpe_mm"] == pytest.approx(0, abs=0.05)
        assert row["height_error"] is None


def test_missed_people_count_in_one_official_mode_and_not_in_the_papers(capsys, tmp_path, take):
    write_sequence(tmp_path / "data" / "TS1", skeletons_of(take))
    write_take(tmp_path / "takes" / "TS1" / "take.npz", only(take, 1))
    row = rows_of(capsys, "mupots", tmp_path / "data", "--takes", tmp_path / "takes")[0]
    assert row["pck3d_official_all"] == pytest.approx(0.5)
    assert row["pck3d_official_matched"] == pytest.approx(1)
    assert row["pck3d"] == pytest.approx(1)
    assert row["ap25"] == pytest.approx(0.5)
    assert row["ap25_matched"] == pytest.approx(1)


def test_bones_of_another_length_cost_the_papers_pck_and_not_the_official_one(capsys, tmp_path, take):
    true = skeletons_of(take)
    roots = true[:, :, 14:15]
    large = roots + (true - roots) * 1.3  # arms and legs reach 0.2 m farther
    write_sequence(tmp_path / "TS1", large)
    write_take(tmp_path / "TS1" / "take.npz", take)
    row = rows_of(capsys, "mupots", tmp_path)[0]
    assert row["pck3d_official_all"] == pytest.approx(1)
    reached = np.linalg.norm((large - true)[:, :, :14], axis=-1) < 0.15
    assert 0.2 < reached.mean() < 0.8
    assert row["pck3d"] == pytest.approx(reached.mean(), abs=0.01)
    assert row["pa_mpjpe_mm"] == pytest.approx(0, abs=0.1)


def test_the_official_measure_compares_with_skeletons_of_standard_size(capsys, tmp_path, take):
    true = skeletons_of(take)
    standard = true.copy()
    standard[:, :, WRIST] += (0, 0, 0.6)  # a right wrist elsewhere, in the standard skeleton alone
    write_sequence(tmp_path / "TS1", true, standard=standard)
    write_take(tmp_path / "TS1" / "take.npz", take)
    row = rows_of(capsys, "mupots", tmp_path)[0]
    assert row["pck3d"] == 1
    assert row["pck3d_official_all"] == pytest.approx(13 / 14)


def test_joints_by_hand(capsys, tmp_path, take):
    true = skeletons_of(take)
    true[0, :, ANKLE] += (0, 0, 0.2)
    write_sequence(tmp_path / "TS1", true)
    write_take(tmp_path / "TS1" / "take.npz", take)
    row = rows_of(capsys, "mupots", tmp_path)[0]
    assert row["pck3d"] == pytest.approx(27 / 28)
    assert row["mpjpe_mm"] == pytest.approx(200 / 28, abs=0.05)


def test_frames_that_are_not_valid_say_nothing(capsys, tmp_path, take):
    true, valid = skeletons_of(take), np.ones((2, 12), bool)
    true[0, 4:], valid[0, 4:] = 77, False
    write_sequence(tmp_path / "TS1", true, valid)
    write_take(tmp_path / "TS1" / "take.npz", take)
    row = rows_of(capsys, "mupots", tmp_path)[0]
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    assert row["ap25"] == pytest.approx(1)
    assert row["pck3d_official_all"] == pytest.approx(1)


def test_a_take_of_nobody_found_nobody(capsys, tmp_path, take):
    write_sequence(tmp_path / "TS1", skeletons_of(take))
    write_take(tmp_path / "TS1" / "take.npz", only(take))
    row = rows_of(capsys, "mupots", tmp_path)[0]
    assert row["ap25"] == row["pck3d_official_all"] == row["found_share"] == 0
    assert row["mrpe_mm"] is row["pck3d_official_matched"] is row["pck3d"] is None


# --- bad input ---


def test_sequences_without_a_take_are_named(capsys, tmp_path, take):
    for name in ("TS1", "TS2"):
        write_sequence(tmp_path / name, skeletons_of(take))
    assert "no takes" in refusal_of_last_line(capsys, tmp_path)
    write_take(tmp_path / "TS2" / "take.npz", take)
    code, out, err = evaluate(capsys, "mupots", tmp_path)
    assert code == 0
    assert "TS1" in err
    assert "TS2" in out
    assert "TS1" not in out


def refusal_of_last_line(capsys, directory: Path) -> str:
    """Notes about what is left out come before the refusal."""
    code, _, err = evaluate(capsys, "mupots", directory)
    assert code == 2
    return err.strip().splitlines()[-1]


def test_other_directories_are_refused(capsys, tmp_path):
    assert "TS1/annot.mat" in refusal(capsys, "mupots", tmp_path)
    assert "nowhere" in refusal(capsys, "mupots", tmp_path / "nowhere")


@pytest.mark.parametrize(
    "damage",
    [
        lambda path: path.write_bytes(b"not MATLAB"),
        lambda path: path.write_bytes(path.read_bytes()[:3000]),
        lambda path: path.write_bytes(b""),
        lambda path: savemat(path, {"other": 1}),
        lambda path: savemat(path, {"annotations": np.zeros((3, 2))}),
        lambda path: savemat(path, {"annotations": cells({"annot2": np.zeros((2, 17))})}),
        lambda path: savemat(path, {"annotations": cells({"isValidFrame": 1.0, "annot2": np.zeros((2, 5))})}),
        lambda path: savemat(path, {"annotations": cells("text")}),
    ],
)
def test_damaged_annotations_are_refused(capsys, tmp_path, take, damage):
    write_sequence(tmp_path / "TS1", skeletons_of(take))
    write_take(tmp_path / "TS1" / "take.npz", take)
    damage(tmp_path / "TS1" / "annot.mat")
    assert "TS1/annot.mat" in refusal(capsys, "mupots", tmp_path)


def cells(content) -> np.ndarray:
    """A cell array (2, 1)."""
    array = np.empty((2, 1), object)
    array[:, 0] = [content, content]
    return array


def test_a_file_of_matlab_7_3_is_refused_with_advice(capsys, tmp_path, take):
    write_sequence(tmp_path / "TS1", skeletons_of(take))
    write_take(tmp_path / "TS1" / "take.npz", take)
    header = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (tmp_path / "TS1" / "annot.mat").write_bytes(header + bytes(512))
    assert "-v7" in refusal(capsys, "mupots", tmp_path)


def test_a_take_longer_than_the_sequence_is_refused(capsys, tmp_path, take):
    write_sequence(tmp_path / "TS1", skeletons_of(take))
    write_take(tmp_path / "TS1" / "take.npz", replace(take, meta=replace(take.meta, first_frame=3)))
    assert "frame 14" in refusal(capsys, "mupots", tmp_path)
