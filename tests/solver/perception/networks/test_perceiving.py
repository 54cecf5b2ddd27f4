"""Declared networks beside the default ones, over a whole video."""

from pathlib import Path
from typing import Any, cast

import cv2
import numpy as np
import pytest

from core_solver.errors import ModelError
from core_solver.perception.blazepose import BlazePose, BodyLandmarks
from core_solver.perception.multipose import Pose
from core_solver.perception.networks import declared as declared_module
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS
from core_solver.perception.networks.merging import detect
from core_solver.perception.networks.people import Person
from core_solver.perception.observations import CroppedMask
from core_solver.perception.perceive import Networks, label_size, perceive, with_declared
from core_solver.perception.store import ModelStore
from core_solver.pipeline import seen_camera
from core_solver.progress import SilentProgress
from core_solver.video import open_video
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.networks.graphs import (
    declare,
    write_answers,
    write_answers_per_person,
    write_grey_network,
)
from tests.solver.perception.people import standing_body, standing_pose

PICTURE = (320, 480)
LABELS = label_size(*PICTURE)
PERSON = standing_pose(160, 30)


class Unused:
    """A default network that must not be asked."""

    path = Path("unused.onnx")

    def __call__(self, *_arguments: object) -> Any:
        raise AssertionError("a default network was asked")


class Agreeing:
    """BlazePose as it sees `standing_pose`, or nobody."""

    path = Path("blazepose.tflite")

    def __init__(self, presence: float = 1.0) -> None:
        self.presence = presence

    def __call__(self, _image: np.ndarray, pose: Pose) -> BodyLandmarks:
        body = standing_body(pose)
        return BodyLandmarks(**{**body.__dict__, "presence": self.presence})


class BodyStore(ModelStore):
    def require(self, name: str) -> Path:
        return self.models_dir / name


def draw_video(path: Path, frames: int = 3) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, PICTURE)
    for _ in range(frames):
        picture = np.zeros((PICTURE[1], PICTURE[0], 3), np.uint8)
        picture[:, 160:] = 200
        writer.write(picture)
    writer.release()
    return path


def halpe_points(pose: Pose) -> np.ndarray:
    """(26, 3) the pose's keypoints, feet below the ankles."""
    points = np.zeros((26, 3))
    points[:17] = np.column_stack([pose.keypoints, np.full(17, 0.9)])
    for place, ankle, shift in ((20, 15, (6, 14)), (21, 16, (-6, 14)), (24, 15, (-2, 8)), (25, 16, (2, 8))):
        points[place] = [*(pose.keypoints[ankle] + shift), 0.7]
    return points


def write_four_networks(folder: Path) -> list[Path]:
    """Pose, masks, depth and SMPL, all of which see PERSON in a picture that fills their input."""
    width, height = PICTURE
    picture = [1, 3, height, width]
    dets = np.array([[[*PERSON.box, 0.85]]])
    write_answers(folder / "rtmo.onnx", picture, dets=dets, keypoints=halpe_points(PERSON)[None, None])
    mask = np.zeros((1, 1, height, width))
    left, top, right, bottom = PERSON.box.astype(int)
    mask[..., top:bottom, left:right] = 1
    write_answers(folder / "ins.onnx", picture, dets=dets, labels=np.zeros((1, 1)), masks=mask)
    write_grey_network(folder / "depth.onnx", [64, 96], name="disparity")
    theta = np.zeros((24, 3))
    theta[0, 0] = np.pi
    write_answers_per_person(folder / "hmr.onnx", ["N", 3, 256, 256], pose=theta.ravel())
    size = {"input": [width, height]}
    return [
        declare(folder / "rtmo.toml", task="pose", decoder="rtmo", keypoints="halpe26", **size),
        declare(folder / "ins.toml", task="masks", decoder="rtmdet-ins", **size),
        declare(folder / "depth.toml", task="depth", decoder="disparity"),
        declare(folder / "hmr.toml", task="smpl", decoder="smpl", rotations="axis-angle"),
    ]


def networks_of(people: object, body: object) -> Networks:
    return Networks(cast("Any", people), cast("BlazePose", body), ())


def test_declared_networks_alone_see_a_video(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(declared_module, "load_body", lambda _path: make_stick_body())
    tomls = write_four_networks(tmp_path)
    networks = with_declared(networks_of(Unused(), Unused()), tomls, BodyStore(tmp_path), "cpu")
    files = networks.files_for(*PICTURE)
    assert set(tomls) <= set(files)
    assert {"rtmo.onnx", "ins.onnx", "depth.onnx", "hmr.onnx", "open-body"} <= {file.name for file in files}
    depth = networks.open_disparity(*PICTURE)
    assert depth is not None
    assert depth.path.name == "depth.onnx"
    seen = list(perceive(open_video(draw_video(tmp_path / "clip.avi")), networks, SilentProgress()))
    assert len(seen) == 3
    for observed in seen:
        assert observed.disparity is not None
        assert observed.disparity.shape == (64, 96)
        assert observed.disparity[:, :40].max() < observed.disparity[:, 60:].min()
        (one,) = observed.detections
        assert one.score == pytest.approx(0.85)
        np.testing.assert_allclose(one.keypoints[:17], PERSON.keypoints, atol=1e-3)
        np.testing.assert_allclose(one.keypoints[20], PERSON.keypoints[16] + (-6, 14), atol=1e-3)
        np.testing.assert_allclose(one.confidence[:17], 0.9, atol=1e-6)
        np.testing.assert_allclose(one.confidence[17:21], 0.7, atol=1e-6)
        assert (one.confidence[21:] == 0).all()
        assert one.landmarks[0, 1] < -0.5
        assert one.landmarks[17, 1] > 0.5
        assert one.box[3] == pytest.approx(PERSON.keypoints[:, 1].max() + 14, abs=1e-3)
        expected = (PERSON.box[2:] - PERSON.box[:2]) * np.array(LABELS) / PICTURE
        np.testing.assert_allclose(one.mask.values.shape[::-1], expected, atol=2)
        assert np.linalg.norm(one.appearance) == pytest.approx(1, abs=1e-5)


def test_without_declarations_nothing_changes() -> None:
    networks = networks_of(Unused(), Unused())
    assert with_declared(networks, (), ModelStore(), "auto") is networks
    assert networks.files_for(*PICTURE) == (Unused.path, Unused.path)
    assert networks.open_disparity(*PICTURE) is None
    assert networks.declared.field_of_view([np.zeros((8, 8, 3), np.uint8)]) is None


IMAGE = np.full((PICTURE[1], PICTURE[0], 3), 90, np.uint8)


def seen_by(person: Person, presence: float = 1.0):
    return detect(person, IMAGE, cast("BlazePose", Agreeing(presence)), PICTURE, LABELS)


def test_blazepose_gives_what_a_declared_set_lacks() -> None:
    moved = PERSON.keypoints + 4
    named = KEYPOINT_SETS["coco17"].named(moved, np.linspace(0.1, 0.9, 17))
    found = seen_by(Person(PERSON).with_keypoints(named))
    assert found is not None
    np.testing.assert_allclose(found.keypoints[:17], moved, atol=1e-4)
    np.testing.assert_allclose(found.confidence[:17], np.linspace(0.1, 0.9, 17), atol=1e-6)
    assert (found.confidence[17:] > 0.5).all()
    # Hands and feet follow the pose on which BlazePose looked.
    body = standing_body(Person(PERSON).with_keypoints(named).pose)
    np.testing.assert_allclose(found.keypoints[17:], body.keypoints[17:], atol=1e-3)
    assert found.mask.values.size > 0


def test_declared_masks_and_landmarks_take_the_place() -> None:
    mask = CroppedMask(3, 4, np.full((50, 40), 255, np.uint8))
    landmarks = np.random.default_rng(0).normal(size=(25, 3)).astype(np.float32)
    found = seen_by(Person(PERSON, mask=mask))
    assert found is not None
    assert found.mask is mask
    assert not found.regressed
    assert not np.array_equal(found.landmarks, landmarks)
    found = seen_by(Person(PERSON, landmarks=landmarks))
    assert found is not None
    assert found.landmarks is landmarks
    assert found.regressed
    assert found.mask.values.size > 0


def test_keypoints_outside_the_picture_are_unseen() -> None:
    points = PERSON.keypoints.copy()
    points[15] = (200, 600)
    named = KEYPOINT_SETS["coco17"].named(points, np.ones(17))
    found = seen_by(Person(PERSON).with_keypoints(named))
    assert found is not None
    assert found.confidence[15] == 0
    assert (found.confidence[:15] == 1).all()
    assert found.box[3] <= PICTURE[1]


def test_somebody_whom_blazepose_does_not_see_stays_if_the_declared_networks_say_enough() -> None:
    mask = CroppedMask(3, 4, np.full((50, 40), 255, np.uint8))
    landmarks = np.ones((25, 3), np.float32)
    pose = Pose(0.2, PERSON.box, PERSON.keypoints, PERSON.confidence)  # too unsure to be believed alone
    assert seen_by(Person(pose), presence=0.1) is None
    found = seen_by(Person(pose, mask=mask, landmarks=landmarks), presence=0.1)
    assert found is not None
    np.testing.assert_allclose(found.confidence[:17], pose.confidence)
    assert (found.confidence[17:] == 0).all()
    assert found.regressed


def test_a_name_that_is_nothing(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="no network declaration nothing: give a TOML file, or one of"):
        with_declared(networks_of(Unused(), Unused()), ["nothing"], ModelStore(tmp_path), "cpu")


def test_the_field_of_view_that_a_network_sees_is_the_cameras(tmp_path: Path) -> None:
    # 96 pixels of focal length over a 96 pixels wide input: the width is seen under 53.1 degrees.
    write_answers(
        tmp_path / "pro.onnx",
        [1, 3, 64, 96],
        predicted_depth=np.full((1, 64, 96), 3.0),
        focallength_px=np.array([96.0]),
    )
    toml = declare(tmp_path / "pro.toml", task="depth", decoder="metric-depth")
    networks = with_declared(networks_of(Unused(), Unused()), [toml], ModelStore(tmp_path), "cpu")
    clip = open_video(draw_video(tmp_path / "clip.avi"))
    seen = seen_camera(networks, clip, SilentProgress())
    assert seen is not None
    assert seen.camera.fx == pytest.approx(PICTURE[0], rel=1e-6)
    assert seen.camera.source == "field of view seen by the depth network"
    write_grey_network(tmp_path / "silent.onnx", [64, 96])
    silent = declare(tmp_path / "silent.toml", task="depth", decoder="metric-depth")
    networks = with_declared(networks_of(Unused(), Unused()), [silent], ModelStore(tmp_path), "cpu")
    assert seen_camera(networks, clip, SilentProgress()) is None
