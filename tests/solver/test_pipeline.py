"""The whole story with drawn videos; the networks are replaced at the pipeline's border, everything after is real."""

import errno
import json
import re
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from core_solver import pipeline
from core_solver.camera import Camera, camera_from_fov
from core_solver.errors import CameraError, UserError, VideoError
from core_solver.optimise import pose_fit, solve
from core_solver.optimise.threads import single_thread
from core_solver.perception.observations import CroppedMask, Detection, FrameObservations
from core_solver.pipeline import GROUND_PLANE_PRIOR, SolveOptions, solve_video
from core_solver.progress import SilentProgress
from core_solver.take import read_take
from core_solver.take import writing as take_writing
from tests.solver.body.synthetic import make_stick_body
from tests.solver.scenes import SyntheticClip, Walker, make_clip

WIDTH, HEIGHT, FRAMES = 320, 240, 12
BODY = make_stick_body()
CAMERA = camera_from_fov(WIDTH, HEIGHT, 60, "truth")
COUPLE = [Walker(1.0, (-0.8, 5), 0.5), Walker(0.95, (0.8, 6), -1.0)]


@dataclass(frozen=True)
class FakeDisparity:
    path: Path = Path("some-depth.onnx")


class FakeNetworks:
    def __init__(self, disparity: FakeDisparity | None):
        self.disparity = disparity

    def open_disparity(self, _width: int, _height: int) -> FakeDisparity | None:
        return self.disparity


class FakeStore:
    def __init__(self, _folder: Path | None = None, *, offline: bool = False):
        pass

    def require(self, name: str) -> Path:
        return Path(name)


class Notes(SilentProgress):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, message: str) -> None:
        self.notes.append(message)


def observations(clip: SyntheticClip, video, seen: int = FRAMES) -> Iterator[FrameObservations]:
    """What good networks would see of a synthetic clip, in the first `seen` frames."""
    disparity = clip.modalities.disparity
    for t, info in enumerate(video.frame_list):
        people = [detect(clip, index, t) for index in range(len(clip.modalities.tracks))] if t < seen else []
        yield FrameObservations(info, tuple(people), disparity[t] if disparity is not None else None)


def detect(clip: SyntheticClip, index: int, t: int) -> Detection:
    track = clip.modalities.tracks[index]
    keypoints = track.keypoints[t]
    mask = cv2.resize((clip.modalities.labels[t] == track.id).astype(np.uint8) * 255, (WIDTH, HEIGHT))
    clothes = np.zeros(36, np.float32)
    clothes[index] = 1
    box = np.concatenate([keypoints.min(axis=0) - 4, keypoints.max(axis=0) + 4]).astype(np.float32)
    return Detection(
        0.9, box, keypoints, track.confidence[t], track.landmarks[t], clothes, CroppedMask(0, 0, mask)
    )  # fmt: skip


def background(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return cv2.resize(rng.integers(30, 220, (40, 60, 3)).astype(np.uint8), (2 * WIDTH, 2 * HEIGHT))


def draw_video(path: Path, shift: float = 0.0, frames: int = FRAMES, *, shake: int = 0, turned: bool = False) -> Path:
    """A patterned wall, which drifts by `shift` pixels a frame when the camera moves and jumps when it shakes."""
    size = (HEIGHT, WIDTH) if turned else (WIDTH, HEIGHT)
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25.0, size)
    assert writer.isOpened()
    for t in range(frames):
        left = round(shift * t) + (shake if t % 3 == 1 else 0)
        picture = background()[:HEIGHT, left : left + WIDTH]
        writer.write(np.ascontiguousarray(np.rot90(picture) if turned else picture))
    writer.release()
    return path


@pytest.fixture(scope="module")
def couple() -> SyntheticClip:
    return make_clip(BODY, COUPLE, frames=FRAMES, camera=CAMERA, noise_px=0.3)


class Stage:
    """The pipeline with networks that see `clip`, in a folder with a video and perhaps an old take."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch):
        self.folder, self._patch = folder, monkeypatch
        self.video, self.output, self.progress = draw_video(folder / "clip.avi"), folder / "take.npz", Notes()
        monkeypatch.setattr(pipeline, "ModelStore", FakeStore)
        monkeypatch.setattr(pipeline, "load_body", lambda _path: BODY)
        monkeypatch.setattr(pose_fit, "ITERATIONS", 20)

    def show(self, clip: SyntheticClip, seen: int = FRAMES) -> None:
        network = FakeDisparity() if clip.modalities.disparity is not None else None
        self._patch.setattr(pipeline, "load_networks", lambda _store, _depth: FakeNetworks(network))
        self._patch.setattr(pipeline, "observe", lambda video, *_rest, **_keywords: observations(clip, video, seen))

    def run(self, **options):
        return solve_video(SolveOptions(self.video, self.output, **{"fov_degrees": 60.0, **options}), self.progress)

    def files(self) -> dict[str, bytes]:
        return {p.name: p.read_bytes() for p in self.folder.iterdir() if p.is_file()}


@pytest.fixture
def stage(tmp_path, monkeypatch, couple) -> Stage:
    stage = Stage(tmp_path, monkeypatch)
    stage.show(couple)
    return stage


def test_a_video_becomes_a_take(stage, couple):
    take = stage.run()
    read = read_take(stage.output)
    assert [p.id for p in read.people] == [1, 2]
    assert read.frame_count == FRAMES
    np.testing.assert_allclose(read.times, np.arange(FRAMES) / 25, atol=1e-9)
    np.testing.assert_array_equal(read.people[0].theta, take.people[0].theta)
    assert read.meta.depth_source == "some-depth.onnx"
    assert read.meta.body_model == BODY.id
    assert (read.meta.camera.width, read.meta.camera.height) == (WIDTH, HEIGHT)
    assert read.meta.warnings == ()
    assert stage.progress.notes == []
    # The people stand where they stood: their joints fall upon the true pixels.
    for person, truth in zip(read.people, couple.joints, strict=True):
        joints = pelvis(person)
        assert np.abs(CAMERA.project(joints) - CAMERA.project(truth[:, 0])).max() < 12
    assert len(read.scene.points) > 1000
    # Mostly floor: the cloud lies on the ground and shows the video's colours.
    heights = read.scene.points @ np.array(read.meta.ground.normal) + read.meta.ground.offset
    assert (np.abs(heights) < 0.5).mean() > 0.4
    assert read.scene.colors.std() > 10


def pelvis(person) -> np.ndarray:
    return person.scale * person.rest_joints[0] + person.gamma


def test_only_the_takes_own_files_are_left(stage):
    stage.run()
    assert set(stage.files()) == {"clip.avi", "take.npz"}


def test_a_range_and_every_other_frame(stage):
    take = stage.run(start_s=0.079, every=2)
    assert take.meta.first_frame == 2
    assert take.meta.frame_step == 2
    np.testing.assert_allclose(take.times, np.arange(2, FRAMES, 2) / 25, atol=1e-9)
    assert take.meta.frame_rate == pytest.approx(12.5)


def test_settings_are_recorded_without_paths(stage):
    take = stage.run(people=1)
    assert len(take.people) == 1
    assert take.meta.settings["people"] == 1
    assert str(stage.folder) not in str(take.meta)


def test_the_cloud_has_as_many_points_as_wanted_at_most(stage):
    points = stage.run(points=500).scene.points
    assert 400 < len(points) <= 500
    assert stage.run().meta.settings["points"] == 200_000


def test_nobody_in_the_video(stage, couple):
    stage.show(couple, seen=0)
    with pytest.raises(VideoError, match=r"nobody was seen in clip\.avi.*--start and --end"):
        stage.run()
    assert not stage.output.exists()


def test_people_seen_too_briefly(stage, couple):
    stage.show(couple, seen=4)
    with pytest.raises(VideoError, match=r"people were seen too briefly in clip\.avi.*8 frames"):
        stage.run()
    assert not stage.output.exists()


def test_one_person_is_solved_and_the_prior_is_named(stage):
    stage.show(make_clip(BODY, COUPLE[:1], frames=FRAMES, camera=CAMERA))
    take = stage.run()
    assert len(take.people) == 1
    assert any("One person alone" in warning for warning in take.meta.warnings)


def test_the_ground_plane_stands_in_for_depth_and_says_so(stage):
    stage.show(make_clip(BODY, COUPLE, frames=FRAMES, camera=CAMERA, with_depth=False))
    take = stage.run()
    assert take.meta.depth_source == GROUND_PLANE_PRIOR == "ground-plane prior"
    assert any("prior" in warning for warning in take.meta.warnings)
    assert any("No depth network" in note for note in stage.progress.notes)
    heights = take.scene.points @ np.array(take.meta.ground.normal) + take.meta.ground.offset
    assert len(heights) > 1000
    assert np.abs(heights).max() < 0.01
    farthest = max(np.linalg.norm(person.gamma, axis=1).max() for person in take.people)
    assert take.scene.points[:, 2].max() <= 2.5 * farthest + 1e-3
    np.testing.assert_allclose(take.scene.z_near, np.nanmin(take.scene.depth), rtol=1e-5)
    np.testing.assert_allclose(take.scene.z_far, np.nanmax(take.scene.depth), rtol=1e-5)


def test_a_moving_camera_is_told_with_its_drift(stage):
    draw_video(stage.video, shift=4.0)
    take = stage.run()
    (warning,) = take.meta.warnings
    found = re.search(r"The camera moves: the background drifts by (\d+) pixels", warning)
    assert found
    # 4 pixels a frame over 11 frames: the last is 44 off, nine in ten are less than 40.
    assert 30 <= int(found[1]) <= 44
    assert warning in stage.progress.notes


def test_an_assumed_field_of_view_is_announced_and_recorded(stage):
    take = stage.run(fov_degrees=None)
    assert any("the field of view is estimated from the people" in note for note in stage.progress.notes)
    assert any("field of view is no calibration" in warning for warning in take.meta.warnings)
    source = r"estimated from the people( and the scene's edges)?, give or take \d+ %"
    assert re.fullmatch(source, take.meta.camera.source)
    fov = 2 * np.degrees(np.arctan(WIDTH / 2 / take.meta.camera.fx))
    assert 35 < fov < 85


def test_a_camera_file_is_used_as_it_is(stage):
    truth = Camera(WIDTH, HEIGHT, 300.0, 280.0, 161.0, 118.0, (-0.05, 0.01, 0.0, 0.001, 0.0))
    (stage.folder / "camera.json").write_text(json.dumps(asdict(truth)))
    take = stage.run(camera=str(stage.folder / "camera.json"), fov_degrees=None)
    found = take.meta.camera
    assert (found.fx, found.fy, found.cx, found.cy, found.distortion) == (
        truth.fx, truth.fy, truth.cx, truth.cy, truth.distortion,
    )  # fmt: skip
    assert "camera.json" in found.source


def test_camera_file_and_field_of_view_exclude_each_other(stage):
    with pytest.raises(CameraError, match="--camera and --fov exclude each other"):
        stage.run(camera="camera.json", fov_degrees=60.0)


def test_a_camera_file_of_another_shape_is_refused(stage):
    square = Camera(400, 400, 300.0, 300.0, 200.0, 200.0)
    (stage.folder / "camera.json").write_text(json.dumps(asdict(square)))
    with pytest.raises(CameraError, match=r"400x400 pixels but the video has 320x240"):
        stage.run(camera=str(stage.folder / "camera.json"), fov_degrees=None)
    assert not stage.output.exists()


@pytest.mark.parametrize("name", ["take.txt", "take", "take.npz.zip"])
def test_an_output_that_is_no_take_is_refused_before_any_work(stage, name):
    stage.output = stage.folder / name
    stage.video = stage.folder / "missing.avi"  # would be refused, too, but later
    with pytest.raises(UserError, match=r"ends in \.npz"):
        stage.run()


def test_a_folder_as_output_is_refused(stage):
    stage.output = stage.folder / "folder.npz"
    stage.output.mkdir()
    with pytest.raises(UserError, match=r"ends in \.npz"):
        stage.run()


def test_a_place_that_cannot_be_written_is_refused_before_any_work(stage):
    stage.output = stage.video / "take.npz"  # a file for a parent: not even root can write there
    stage.video = stage.folder / "missing.avi"
    with pytest.raises(UserError, match=r"cannot write to .*choose another place with -o"):
        stage.run()
    assert set(stage.files()) == {"clip.avi"}


def test_a_new_folder_is_made_for_the_take(stage):
    stage.output = stage.folder / "new" / "deeper" / "take.npz"
    stage.run()
    assert stage.output.is_file()


def fill_disk(*_arguments, **_keywords):
    raise OSError(errno.ENOSPC, "No space left on device")


def interrupt(*_arguments, **_keywords):
    raise KeyboardInterrupt


@pytest.mark.parametrize("place", [(take_writing.os, "fsync"), (take_writing.np.lib.format, "write_array")])
def test_a_full_disk_leaves_the_old_take(stage, monkeypatch, place):
    stage.output.write_bytes(b"the old take")
    before = stage.files()
    monkeypatch.setattr(*place, fill_disk)
    with pytest.raises(UserError, match="No space left on device; free some space"):
        stage.run()
    assert stage.files() == before


def test_a_disk_that_fills_while_writing_leaves_the_old_take(stage, monkeypatch):
    """The system's own refusal half-way through the file, instead of one that is acted."""
    resource = pytest.importorskip("resource")
    stage.output.write_bytes(b"the old take")
    before = stage.files()
    real_write = pipeline.write_take

    def write_with_little_room(path, take):
        limits = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
        try:
            real_write(path, take)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)

    monkeypatch.setattr(pipeline, "write_take", write_with_little_room)
    with pytest.raises(UserError, match="cannot write"):
        stage.run()
    assert stage.files() == before


@pytest.mark.parametrize("place", ["solve", "build_scene", "write_array"])
def test_an_interrupt_leaves_the_old_take_and_no_half_one(stage, monkeypatch, place):
    stage.output.write_bytes(b"the old take")
    before = stage.files()
    monkeypatch.setattr(take_writing.np.lib.format if place == "write_array" else pipeline, place, interrupt)
    with pytest.raises(KeyboardInterrupt):
        stage.run()
    assert stage.files() == before


def test_a_second_solve_replaces_the_take_and_is_equal_byte_by_byte(stage):
    stage.run()
    first = stage.output.read_bytes()
    stage.run()
    assert stage.output.read_bytes() == first


def test_the_thread_count_is_given_back():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        with single_thread():
            assert torch.get_num_threads() == 1
        assert torch.get_num_threads() == 2
        with pytest.raises(KeyboardInterrupt), single_thread():
            raise KeyboardInterrupt
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_the_solve_runs_on_one_thread(stage, monkeypatch):
    threads, real = [], solve.fit_poses

    def spy(*arguments, **options):
        threads.append(torch.get_num_threads())
        return real(*arguments, **options)

    monkeypatch.setattr(solve, "fit_poses", spy)
    stage.run()
    assert threads == [1]


def test_a_device_that_is_not_there(stage, monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(UserError, match="no CUDA device"):
        stage.run(device="cuda")
    assert pipeline.choose_device("auto") == "cpu"
    assert pipeline.choose_device("cpu") == "cpu"


def test_late_entrants_are_in_the_take_from_their_first_sight_on(stage, couple, monkeypatch):
    def late(video):
        for t, frame in enumerate(observations(couple, video)):
            yield replace(frame, detections=frame.detections if t >= 3 else frame.detections[:1])

    stage.show(couple)
    monkeypatch.setattr(pipeline, "observe", lambda video, *_rest, **_keywords: late(video))
    take = stage.run()
    assert len(take.people) == 2
    assert take.people[1].valid.tolist() == [False] * 3 + [True] * (FRAMES - 3)
    assert (take.people[1].confidence[:3] == 0).all()
    assert np.isfinite(take.people[1].gamma).all()
