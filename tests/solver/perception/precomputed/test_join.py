"""Given joints, and a stand-in for BlazePose for the rest."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core_solver.perception.blazepose import BodyLandmarks
from core_solver.perception.multipose import Pose
from core_solver.perception.precomputed.given import open_modalities
from core_solver.perception.precomputed.join import Helpers, perceive_given
from core_solver.progress import SilentProgress
from core_solver.video import open_video
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.people import standing_body, standing_pose
from tests.solver.perception.precomputed.export import draw_video

SIZE = (1000, 500)
POSES = [standing_pose(250, 50), standing_pose(700, 40)]


class Body:
    """Sees what `standing_body` makes of a pose, with landmarks; may see somebody else, or nobody."""

    path = Path("blazepose.tflite")

    def __init__(self) -> None:
        self.asked: list[Pose] = []
        self.presence, self.shift = 1.0, 0.0

    def __call__(self, _image: np.ndarray, pose: Pose) -> BodyLandmarks:
        self.asked.append(pose)
        # The file's joints stand where `standing_pose` has put them, so its hands and feet can be added.
        made = standing_body(replace(pose, keypoints=pose.keypoints + np.float32(self.shift)))
        return replace(made, presence=self.presence, landmarks=np.full((25, 3), 0.5, np.float32))


@pytest.fixture
def body() -> Body:
    return Body()


@pytest.fixture
def scene(tmp_path: Path):
    """A video and a folder with two people's joints in frames 0 and 2."""
    video = draw_video(tmp_path / "clip.avi", frames=3, size=SIZE)
    folder = tmp_path / "given"
    (folder / "joints").mkdir(parents=True)
    people = [
        {"image_id": t, "keypoints": np.column_stack([p.keypoints, p.confidence]).ravel().tolist(), "score": 0.7}
        for t in (0, 2)
        for p in POSES
    ]
    (folder / "joints" / "a.json").write_text(json.dumps(people))
    return folder, video


def look(scene, body: Body | None):
    folder, video = scene
    clip = open_video(video)
    given = open_modalities(folder, clip, make_stick_body())
    helpers = Helpers(given, None, body, ())  # type: ignore[arg-type]
    return list(perceive_given(clip, helpers, SilentProgress(), range(3)))


def test_blazepose_looks_at_given_people(scene, body: Body) -> None:
    first, second, third = look(scene, body)
    assert [len(o.detections) for o in (first, second, third)] == [2, 0, 2]
    assert len(body.asked) == 4
    for pose, asked, detection in zip(POSES, body.asked, first.detections, strict=False):
        np.testing.assert_allclose(asked.keypoints, pose.keypoints, atol=1e-3)
        np.testing.assert_allclose(detection.keypoints[:17], pose.keypoints, atol=1e-3)
        assert (detection.confidence[:17] == np.float32(0.8)).all(), "the file's word on its joints stands"
        assert (detection.confidence[17:] == 1).all(), "hands and feet come from BlazePose"
        assert (detection.landmarks == 0.5).all()
        assert detection.mask.values.size > 0
        assert detection.appearance.shape == (36,)
    assert first.unclaimed == ()
    assert first.disparity is None


@pytest.mark.parametrize(("presence", "shift"), [(0.1, 0.0), (1.0, 200.0)])
def test_who_blazepose_does_not_see_has_joints_only_and_is_no_background(scene, body: Body, presence, shift) -> None:
    body.presence, body.shift = presence, shift
    first, *_ = look(scene, body)
    for detection in first.detections:
        assert np.isnan(detection.landmarks).all()
        assert detection.mask.values.size == 0
        assert (detection.confidence[17:] == 0).all()
        assert detection.appearance.shape == (36,)
    assert len(first.unclaimed) == 2
    around = first.unclaimed[0]
    rows, columns = around.values.shape
    left, top, right, bottom = first.detections[0].box * (384 / 1000)
    assert abs(around.left - left) + abs(around.top - top) < 2
    assert abs(around.left + columns - right) + abs(around.top + rows - bottom) < 2


def test_openpose_frames_that_are_missing_are_unknown_altogether(tmp_path: Path, body: Body) -> None:
    video = draw_video(tmp_path / "clip.avi", frames=3, size=SIZE)
    folder = tmp_path / "given"
    (folder / "joints").mkdir(parents=True)
    for t in (0, 2):
        (folder / "joints" / f"c_{t}_keypoints.json").write_text(json.dumps({"people": []}))
    first, second, _ = look((folder, video), body)
    assert first.unclaimed == (), "a file without people says that nobody is there"
    (everything,) = second.unclaimed
    assert everything.values.shape == (192, 384)
    assert everything.values.all()


def test_given_smpl_poses_are_not_asked_for_again(scene, body: Body) -> None:
    folder, _ = scene
    (folder / "smpl").mkdir()
    (folder / "masks").mkdir()
    points = np.zeros((1, 24, 2))
    points[0, [16, 17, 18, 19, 20, 21, 1, 2, 4, 5, 7, 8]] = POSES[1].keypoints[5:17]
    theta = np.zeros((1, 72))
    theta[0, 0] = np.pi
    for t in (0, 1, 2):
        np.savez(folder / "smpl" / f"{t}.npz", smpl_thetas=theta, pj2d_org=points)
    masks = [{"image_id": t, "segmentation": {"size": [50, 100], "counts": [2500, 2500]}} for t in (0, 1, 2)]
    (folder / "masks" / "m.json").write_text(json.dumps(masks))
    first, second, _ = look(scene, body)
    assert len(body.asked) == 2, "once a frame: for the person without a pose"
    left, right = first.detections
    assert (left.landmarks == 0.5).all()
    assert right.landmarks[15, 1] > 0.5
    assert (left.regressed, right.regressed) == (False, True)
    assert abs(right.mask.left - 192) <= 2
    assert left.mask.values.size == 0
    assert len(first.unclaimed) == 1
    assert len(second.unclaimed) == 1, "a mask that holds nobody's joints"


def test_without_blazepose_there_are_gaps(scene) -> None:
    first, *_ = look(scene, None)
    assert all(np.isnan(d.landmarks).all() and d.mask.values.size == 0 for d in first.detections)
    assert all(np.isclose(np.linalg.norm(d.appearance), 1) for d in first.detections)
