"""`evaluate multiview`: from files to the table, against what can be computed without the program."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core_solver.evaluation.multiview import read_multiview
from core_solver.evaluation.real_scores import REAL_MEASURES
from core_solver.evaluation.scores import MEASURES
from core_solver.take import write_take
from tests.solver.evaluation.real_takes import (
    CAMERA,
    HEIGHT,
    LIMBS,
    evaluate,
    limbs_of,
    moved,
    only,
    refusal,
    rows_of,
    standing_take,
)

ROTATION = Rotation.from_euler("xyz", (20, -35, 10), degrees=True).as_matrix()
TRANSLATION = np.array([0.4, -0.2, 1.5])
SIGMA = 0.04


def write_truth(path: Path, limbs: np.ndarray, **changes) -> Path:
    """Truth of camera 2 of two from joints (N, T, J, 3) in its frame; a change to None leaves an entry out."""
    people = len(limbs)
    matrix = [[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]]
    entries = {
        "joints": (limbs - TRANSLATION) @ ROTATION,
        "joint_names": np.array(LIMBS),
        "valid": np.ones(limbs.shape[:3], bool),
        "heights_m": np.full(people, HEIGHT),
        "K": np.array([matrix, matrix]),
        "dist": np.zeros((2, 5)),
        "R_wc": np.array([np.eye(3), ROTATION]),
        "t_wc": np.array([np.zeros(3), TRANSLATION]),
    }
    entries |= changes
    np.savez(path, **{key: value for key, value in entries.items() if value is not None})
    return path


@pytest.fixture
def case(tmp_path):
    """Write a take and its truth, and give the arguments that compare them."""

    def write(take, limbs, **changes):
        write_take(tmp_path / "take.npz", take)
        truth = write_truth(tmp_path / "truth.npz", limbs, **changes)
        return "multiview", tmp_path / "take.npz", "--truth", truth, "--camera", "cam02"

    return write


def only_row(capsys, arguments) -> dict:
    (row,) = rows_of(capsys, *arguments)
    return row


# --- numbers ---


def test_a_right_take_has_no_errors_and_the_names_of_the_synthetic_results(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(take, limbs_of(take)))
    assert list(row) == ["sequence", "preset", *REAL_MEASURES, "people"]
    assert REAL_MEASURES[: len(MEASURES)] == MEASURES
    for name in ("mrpe_mm", "mpjpe_mm", "pa_mpjpe_mm", "jitter_paper_mm", "group_w_mm", "pair_distance_mm"):
        assert row[name] == pytest.approx(0, abs=0.02), name
    for name in ("ap25_matched", "ap25", "pck3d", "depth_order", "found_share"):
        assert row[name] == pytest.approx(1), name
    assert row["height_error"] == pytest.approx(0, abs=1e-6)
    for name in ("skate_mm", "penetration_mm", "contact_f1", "seconds", "peak_mb", "pck3d_official_all"):
        assert row[name] is None, name
    assert row["jitter_wham"] == pytest.approx(row["true_jitter_wham"], rel=1e-3)
    assert [person["take_id"] for person in row["people"]] == [1, 2, 3]
    jitters = [person["jitter_wham"] for person in row["people"]]
    assert jitters == pytest.approx([person["true_jitter_wham"] for person in row["people"]], rel=1e-3)
    assert np.mean(jitters) == pytest.approx(row["jitter_wham"])


def test_a_shift_is_an_absolute_error_alone(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(moved(take, (0.03, 0, 0.04)), limbs_of(take)))
    assert row["mrpe_mm"] == pytest.approx(50, abs=0.05)
    assert row["mpjpe_mm"] == pytest.approx(0, abs=0.05)
    assert row["pair_distance_mm"] == pytest.approx(0, abs=0.05)


def test_gaussian_noise_gives_its_closed_forms(capsys, case):
    take = standing_take(frames=400)
    true = limbs_of(take)
    noisy = true + np.random.default_rng(2).normal(size=true.shape) * SIGMA
    row = only_row(capsys, case(take, noisy))
    one = 1000 * SIGMA * np.sqrt(8 / np.pi)  # mean length of a 3D Gaussian
    # The root is the mean of two hips: half the variance. Relative to it a limb has one and a half times the variance,
    # a hip, which is half of its own root, one half.
    assert row["mrpe_mm"] == pytest.approx(one * np.sqrt(0.5), rel=0.02)
    assert row["mpjpe_mm"] == pytest.approx(one * (10 * np.sqrt(1.5) + 2 * np.sqrt(0.5)) / 12, rel=0.02)


def test_a_wrong_scale_shows_where_scale_is_fixed_and_vanishes_where_it_is_not(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(take, limbs_of(take) / 1.3, heights_m=np.full(3, HEIGHT / 1.3)))
    for blind in ("pa_mpjpe_mm", "w_mpjpe_scaled_mm", "wa_mpjpe_scaled_mm", "group_w_scaled_mm"):
        assert row[blind] == pytest.approx(0, abs=0.05), blind
    for fixed in ("w_mpjpe_mm", "wa_mpjpe_mm", "group_w_mm", "mpjpe_mm"):
        assert row[fixed] > 30, fixed
    roots = limbs_of(take)[:, :, [LIMBS.index("left_hip"), LIMBS.index("right_hip")]].mean(axis=2)
    assert row["mrpe_mm"] == pytest.approx(1000 * np.linalg.norm(roots, axis=-1).mean() * 0.3 / 1.3, rel=1e-3)
    assert row["height_error"] == pytest.approx(0.3)


def test_a_mirrored_person_is_not_aligned_right(capsys, case):
    take = standing_take()
    true = limbs_of(take)
    centre = true.mean(axis=2, keepdims=True)
    row = only_row(capsys, case(take, centre + (true - centre) * (-1, 1, 1)))
    assert row["pa_mpjpe_mm"] > 50


def test_people_of_a_take_may_come_in_any_order(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(only(take, 2, 0, 1), limbs_of(take)))
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    assert [person["take_id"] for person in row["people"]] == [1, 2, 3]


def test_a_missing_person_costs_average_precision_and_nothing_else(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(only(take, 0, 2), limbs_of(take)))
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    assert row["ap25_matched"] == 1
    assert row["ap25"] == pytest.approx(2 / 3)
    assert row["found_share"] == pytest.approx(2 / 3)
    missing = row["people"][1]
    assert (missing["take_id"], missing["height_m"], missing["mrpe_mm"]) == (None, None, None)
    assert missing["true_height_m"] == HEIGHT


def test_an_invented_person_costs_average_precision(capsys, case):
    take = standing_take()
    row = only_row(capsys, case(only(take, 2, 1, 0), limbs_of(only(take, 1, 2))))
    # The invented person is the surest: two of three at precision 1/2 and 2/3.
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    frames = take.frame_count
    expected = sum(k / (frames + k) for k in range(1, 2 * frames + 1)) / (2 * frames)
    assert row["ap25"] == pytest.approx(expected)


def test_joints_that_are_not_valid_say_nothing(capsys, case):
    take = standing_take()
    joints, valid = limbs_of(take), np.ones((3, take.frame_count, 12), bool)
    joints[:, :, LIMBS.index("left_wrist")] += 5
    valid[:, :, LIMBS.index("left_wrist")] = False
    joints[0, 3] = 99  # somewhere, and known to be nonsense
    valid[0, 3] = False
    row = only_row(capsys, case(take, joints, valid=valid))
    assert row["mpjpe_mm"] == pytest.approx(0, abs=0.02)
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    assert row["ap25"] == pytest.approx(1)


def test_only_joints_of_both_skeletons_are_compared(capsys, case):
    take = standing_take()
    joints = np.concatenate([limbs_of(take), np.full((3, take.frame_count, 3, 3), 7.0)], axis=2)
    names = np.array([*LIMBS, "left_antenna", "neck", "pelvis"])
    assert only_row(capsys, case(take, joints, joint_names=names))["mpjpe_mm"] == pytest.approx(0, abs=0.02)


def test_a_person_outside_the_picture_is_not_missed(capsys, case):
    take = standing_take()
    joints = limbs_of(take)
    joints[2] += (9, 0, 0)
    row = only_row(capsys, case(only(take, 0, 1), joints))
    assert row["ap25"] == pytest.approx(1)


# --- frames ---


def test_a_part_of_the_clip_is_compared_with_its_own_frames(capsys, case):
    whole = standing_take(frames=60)
    chosen = slice(12, 48, 4)
    tracks = ("theta", "gamma", "valid", "confidence", "contacts")
    take = replace(
        whole,
        people=tuple(replace(p, **{name: getattr(p, name)[chosen] for name in tracks}) for p in whole.people),
        times=whole.times[chosen],
        meta=replace(whole.meta, first_frame=12, frame_step=4, frame_rate=Fraction(30, 4)),
        scene=replace(whole.scene, z_near=whole.scene.z_near[chosen], z_far=whole.scene.z_far[chosen]),
    )
    row = only_row(capsys, case(take, limbs_of(whole), fps=np.float64(30)))
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    # The file may begin later in the video, too.
    row = only_row(capsys, case(take, limbs_of(whole)[:, 10:], first_frame=np.int64(10)))
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    # And a file that begins elsewhere is not right: the people have moved on.
    row = only_row(capsys, case(take, limbs_of(whole), first_frame=np.int64(10)))
    assert row["mrpe_mm"] > 5


# --- the table and bad input ---


def test_the_table_names_sequence_people_and_numbers(capsys, case):
    take = standing_take()
    code, out, _ = evaluate(capsys, *case(moved(take, (0, 0, 0.05)), limbs_of(take)))
    assert code == 0
    heading, _, line = out.splitlines()[:3]
    assert " ".join(heading.split()) == "MRPE AP25 matched AP25 3DPCK MPJPE PA-MPJPE group-W height order distance"
    assert line.split()[:2] == ["cam02", "50"]
    assert "cam02: person 2" in out
    assert "3DPCK all" not in out  # nothing fills it


def test_another_camera_is_refused_by_name(capsys, case):
    take = standing_take()
    arguments = case(take, limbs_of(take))
    message = refusal(capsys, *arguments[:-1], "cam09")
    assert "cam09" in message
    assert "cam01, cam02" in message
    # The other camera looks past everybody.
    assert "--camera" in refusal(capsys, *arguments[:-1], "cam01")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"valid": None}, ("valid", "missing")),
        ({"valid": np.ones((3, 20, 12), bool)}, ("valid", "(3, 20, 12)")),
        ({"joints": np.zeros((3, 24, 36))}, ("joints",)),
        ({"joint_names": np.array(LIMBS[:5])}, ("joint_names", "12 different")),
        ({"joint_names": np.array([*LIMBS[:-1], LIMBS[0]])}, ("joint_names", "12 different")),
        ({"joint_names": np.array([n.replace("left_hip", "tail") for n in LIMBS])}, ("left_hip",)),
        ({"R_wc": np.array([np.eye(3), 2 * np.eye(3)])}, ("R_wc", "rotation")),
        ({"R_wc": np.array([np.eye(3), np.diag([1.0, 1, -1])])}, ("R_wc", "rotation")),
        ({"t_wc": np.full((2, 3), np.nan)}, ("finite",)),
        ({"heights_m": np.ones(5)}, ("heights_m",)),
        ({"image_size": np.array([640, 480])}, ("640x480", "1280x720")),
        ({"fps": np.float64(60)}, ("60", "30")),
        ({"person_names": np.array(["a", None, "b"], object)}, ("archive",)),
    ],
)
def test_truth_that_does_not_fit_is_refused(capsys, case, changes, words):
    take = standing_take()
    message = refusal(capsys, *case(take, limbs_of(take), **changes))
    for word in words:
        assert word in message


def test_a_take_of_another_clip_is_refused(capsys, case):
    take = standing_take(frames=30)
    assert "frame 29" in refusal(capsys, *case(take, limbs_of(take)[:, :24]))
    assert "none of the take's frames" in refusal(capsys, *case(take, limbs_of(take), first_frame=np.int64(100)))


def test_damaged_and_missing_files_are_refused(capsys, case, tmp_path):
    take = standing_take()
    arguments = case(take, limbs_of(take))
    assert "nowhere.npz" in refusal(capsys, *arguments[:3], tmp_path / "nowhere.npz", *arguments[4:])
    truth = tmp_path / "truth.npz"
    truth.write_bytes(truth.read_bytes()[:500])
    assert "truth.npz" in refusal(capsys, *arguments)
    write_truth(truth, limbs_of(take))
    (tmp_path / "take.npz").write_bytes(b"PK")
    assert "take.npz" in refusal(capsys, *arguments)


@pytest.mark.shared
def test_the_lab_truth_is_read_as_its_description_says(shared_data):
    path = shared_data / "clips" / "lab_two_people_truth.npz"
    truth = read_multiview(path)
    assert truth.camera_names == ("cam01", "cam02", "cam03", "cam04")
    assert truth.person_names == ("man", "woman")
    assert truth.joints.shape == (2, 100, 21, 3)  # without pelvis and neck
    assert truth.image_size == (1088, 1920)
    assert truth.frame_rate == 60
    assert truth.heights == pytest.approx([1.709, 1.401], abs=1e-3)
    with np.load(path) as archive:
        assert np.isnan(truth.joints).all(axis=-1).sum() == (~archive["valid"][:, :, :21]).sum()
