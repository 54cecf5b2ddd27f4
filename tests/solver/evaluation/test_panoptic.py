"""`evaluate panoptic` on files of exactly the dataset's layout, written here: the dataset itself is not at hand."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from core_solver.evaluation.panoptic import COCO19
from core_solver.take import write_take
from tests.solver.evaluation.real_takes import (
    CAMERA,
    LIMBS,
    evaluate,
    limbs_of,
    only,
    refusal,
    rows_of,
    standing_take,
)

ROTATION = Rotation.from_euler("xyz", (-15, 60, 5), degrees=True).as_matrix()
TRANSLATION_CM = np.array([20.0, 110.0, 240.0])
# As published: neck, nose, body centre, then the left arm and leg, the right arm and leg, eyes and ears.
PUBLISHED = [
    "Neck", "Nose", "BodyCenter", "lShoulder", "lElbow", "lWrist", "lHip", "lKnee", "lAnkle", "rShoulder", "rElbow",
    "rWrist", "rHip", "rKnee", "rAnkle", "lEye", "lEar", "rEye", "rEar",
]  # fmt: skip
PUBLISHED_LIMBS = [PUBLISHED.index(name[0] + name.partition("_")[2].capitalize()) for name in LIMBS]


def camera(name: str, rotation, translation) -> dict:
    return {
        "name": name, "type": "hd", "resolution": [CAMERA.width, CAMERA.height], "panel": int(name[:2]),
        "node": int(name[3:]), "K": [[CAMERA.fx, 0, CAMERA.cx], [0, CAMERA.fy, CAMERA.cy], [0, 0, 1]],
        "distCoef": [0, 0, 0, 0, 0], "R": np.asarray(rotation).tolist(),
        "t": [[float(number)] for number in translation],
    }  # fmt: skip


def write_sequence(directory: Path, limbs: np.ndarray, first: int = 0, confidence=None) -> None:
    """Files of people (N, T, 12, 3), metres in the frame of camera 00_16."""
    poses = directory / "hdPose3d_stage1_coco19"
    poses.mkdir(parents=True)
    world = (limbs * 100 - TRANSLATION_CM) @ ROTATION
    confidence = np.full(limbs.shape[:3], 0.6) if confidence is None else confidence
    for frame in range(limbs.shape[1]):
        bodies = []
        for person in range(len(limbs)):
            joints = np.zeros((19, 4))
            joints[PUBLISHED_LIMBS] = np.column_stack([world[person, frame], confidence[person, frame]])
            bodies.append({"id": 10 + person, "joints19": joints.ravel().tolist()})
        scene = {"version": 0.7, "univTime": 53541.5, "fpsType": "hd_29_97", "bodies": bodies}
        (poses / f"body3DScene_{first + frame:08d}.json").write_text(json.dumps(scene))
    cameras = [camera("00_03", np.eye(3), (0, 0, 0)), camera("00_16", ROTATION, TRANSLATION_CM)]
    calibration = {"calibDataSource": "160422_calib_norm", "cameras": cameras}
    (directory / f"calibration_{directory.name}.json").write_text(json.dumps(calibration))


@pytest.fixture
def take():
    return standing_take(2, 12)


def test_our_order_of_joints_is_the_published_one():
    assert len(COCO19) == 19
    for name, position in zip(LIMBS, PUBLISHED_LIMBS, strict=True):
        assert COCO19.index(name) == position


def test_a_right_take_has_no_errors(capsys, tmp_path, take):
    write_sequence(tmp_path / "170101_pizza1", limbs_of(take))
    write_take(tmp_path / "170101_pizza1" / "take_00_16.npz", take)
    row, mean = rows_of(capsys, "panoptic", tmp_path)
    assert (row["sequence"], mean["sequence"]) == ("170101_pizza1 00_16", "mean")
    assert [person["name"] for person in row["people"]] == ["person 10", "person 11"]
    for name in ("mrpe_mm", "mpjpe_mm", "pa_mpjpe_mm", "pair_distance_mm"):
        assert row[name] == pytest.approx(0, abs=0.02), name
    assert row["ap25"] == row["pck3d"] == 1
    assert row["height_error"] is row["pck3d_official_all"] is None


def test_centimetres_of_error_are_tens_of_millimetres(capsys, tmp_path, take):
    write_sequence(tmp_path / "a", limbs_of(take) + np.array([0.03, 0, 0.04]))
    write_take(tmp_path / "a" / "take_00_16.npz", take)
    assert rows_of(capsys, "panoptic", tmp_path / "a")[0]["mrpe_mm"] == pytest.approx(50, abs=0.02)


def test_frames_are_counted_in_the_video_and_may_lack_a_file(capsys, tmp_path):
    take = standing_take(2, 12, first_frame=140, step=5)
    limbs = np.repeat(limbs_of(take), 5, axis=1)  # truth of each video frame, five to a frame of the take
    write_sequence(tmp_path / "a", limbs, first=140)
    for frame in (145, 160):
        (tmp_path / "a" / "hdPose3d_stage1_coco19" / f"body3DScene_{frame:08d}.json").unlink()
    write_take(tmp_path / "takes" / "a" / "take.npz", take)
    arguments = ("panoptic", tmp_path, "--takes", tmp_path / "takes", "--camera", "00_16")
    row = rows_of(capsys, *arguments)[0]
    assert row["mrpe_mm"] == pytest.approx(0, abs=0.02)
    assert row["ap25"] == pytest.approx(1)


def test_joints_and_people_without_confidence_say_nothing(capsys, tmp_path, take):
    limbs, confidence = limbs_of(take), np.full((2, 12, 12), 0.6)
    limbs[0, :, LIMBS.index("left_ankle")], confidence[0, :, LIMBS.index("left_ankle")] = 50, -1
    limbs[1, 5:], confidence[1, 5:, 5:] = 50, 0  # five joints are left: too few for a person
    write_sequence(tmp_path / "a", limbs, confidence=confidence)
    write_take(tmp_path / "a" / "take_00_16.npz", take)
    row = rows_of(capsys, "panoptic", tmp_path)[0]
    assert (row["mrpe_mm"], row["mpjpe_mm"]) == pytest.approx((0, 0), abs=0.02)
    assert row["ap25"] == pytest.approx(1)


def test_a_missing_person_costs_average_precision(capsys, tmp_path, take):
    write_sequence(tmp_path / "a", limbs_of(take))
    write_take(tmp_path / "a" / "take_00_16.npz", only(take, 1))
    row = rows_of(capsys, "panoptic", tmp_path)[0]
    assert row["ap25"] == pytest.approx(0.5)
    assert row["ap25_matched"] == 1


# --- bad input ---


def test_other_directories_are_refused(capsys, tmp_path):
    assert "hdPose3d_stage1_coco19" in refusal(capsys, "panoptic", tmp_path)
    (tmp_path / "a" / "hdPose3d_stage1_coco19").mkdir(parents=True)
    write_take(tmp_path / "a" / "take_00_16.npz", standing_take(1, 2))
    assert "body3DScene" in refusal(capsys, "panoptic", tmp_path)


def test_no_takes_at_all_is_an_error(capsys, tmp_path, take):
    write_sequence(tmp_path / "a", limbs_of(take))
    code, _, err = evaluate(capsys, "panoptic", tmp_path)
    assert code == 2
    assert "no takes" in err.strip().splitlines()[-1]


def test_a_take_of_an_unknown_camera_or_other_pictures_is_refused(capsys, tmp_path, take):
    write_sequence(tmp_path / "a", limbs_of(take))
    write_take(tmp_path / "a" / "take_00_17.npz", take)
    assert "00_17" in refusal(capsys, "panoptic", tmp_path)
    (tmp_path / "a" / "take_00_17.npz").unlink()
    small = replace(take, meta=replace(take.meta, camera=replace(CAMERA, width=640, height=360)))
    write_take(tmp_path / "a" / "take_00_16.npz", small)
    assert "640x360" in refusal(capsys, "panoptic", tmp_path)


@pytest.mark.parametrize("name", ["calibration_a.json", "hdPose3d_stage1_coco19/body3DScene_00000003.json"])
@pytest.mark.parametrize(
    "text",
    ["", "[1, 2]", "{}", '{"bodies": [{"id": 1}], "cameras": [{"name": "00_16"}]}', '{"bodies": 3, "cameras": 3}'],
)
def test_damaged_files_are_refused(capsys, tmp_path, take, name, text):
    write_sequence(tmp_path / "a", limbs_of(take))
    write_take(tmp_path / "a" / "take_00_16.npz", take)
    (tmp_path / "a" / name).write_text(text)
    assert Path(name).name in refusal(capsys, "panoptic", tmp_path)


def test_a_missing_calibration_is_refused(capsys, tmp_path, take):
    write_sequence(tmp_path / "a", limbs_of(take))
    write_take(tmp_path / "a" / "take_00_16.npz", take)
    (tmp_path / "a" / "calibration_a.json").unlink()
    assert "calibration_a.json" in refusal(capsys, "panoptic", tmp_path)
