"""The whole of perception, on the demo clip's real people and on pictures without any."""

from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver.perception.perceive import label_size, load_networks, look_at, perceive
from core_solver.progress import SilentProgress
from core_solver.video import open_video
from tests.solver.perception.people import demo_clip, first_frame
from tests.solver.perception.test_disparity import write_network

pytestmark = pytest.mark.models


class Counting(SilentProgress):
    """Remembers stages and steps."""

    def __init__(self) -> None:
        self.steps: list[tuple[str, int, int]] = []

    @contextmanager
    def stage(self, name: str, total: int):
        done = [0]

        def advance(steps: int) -> None:
            done[0] += steps

        yield advance
        self.steps.append((name, total, done[0]))


@pytest.fixture(scope="module")
def networks(models, tmp_path_factory: pytest.TempPathFactory):
    depth = write_network(tmp_path_factory.mktemp("depth") / "midas_tiny.onnx", [96, 64])
    return load_networks(models, depth)


def test_demo_frames_give_people_depth_and_progress(models, networks) -> None:
    clip = open_video(demo_clip(models), end_s=0.06)
    progress = Counting()
    seen = list(perceive(clip, networks, progress))
    assert [o.frame for o in seen] == list(clip.frame_list)
    assert [(total, done) for _, total, done in progress.steps] == [(len(clip.frame_list),) * 2]
    for o in seen:
        assert len(o.detections) == 3
        assert o.disparity is not None
        assert o.disparity.shape == (96, 64)
    again = list(perceive(clip, networks, progress, positions=[2]))
    assert again[0].frame == clip.frame_list[2]
    for a, b in zip(seen[2].detections, again[0].detections, strict=True):
        assert np.array_equal(a.keypoints, b.keypoints)
        assert np.array_equal(a.mask.values, b.mask.values)


def test_masks_cover_the_keypoints_and_not_the_neighbour(models, networks) -> None:
    picture = first_frame(models)
    detections = look_at(picture, networks.people(picture), networks.body)
    height, width = picture.shape[:2]
    across, down = label_size(width, height)
    masks = []
    for d in detections:
        mask = np.zeros((down, across), bool)
        rows, columns = d.mask.values.shape
        mask[d.mask.top : d.mask.top + rows, d.mask.left : d.mask.left + columns] = d.mask.values > 127
        masks.append(mask)
        torso = d.keypoints[[5, 6, 11, 12]].mean(axis=0) * (across / width, down / height)
        assert mask[int(torso[1]), int(torso[0])]
        area = (d.box[2] - d.box[0]) * (d.box[3] - d.box[1]) * (across / width) * (down / height)
        assert 0.15 < mask.sum() / area < 0.9
    for i, one in enumerate(masks):
        for other in masks[:i]:
            assert (one & other).sum() < 0.02 * min(one.sum(), other.sum())


def test_left_and_right_follow_the_mirror(models, networks) -> None:
    picture = first_frame(models)
    width = picture.shape[1]
    seen = look_at(picture, networks.people(picture), networks.body)
    flipped = np.ascontiguousarray(picture[:, ::-1])
    mirrored = look_at(flipped, networks.people(flipped), networks.body)
    for d in seen:
        hips = d.keypoints[[11, 12]]
        there = min(mirrored, key=lambda m: np.abs(m.keypoints[[12, 11]] * (-1, 1) + (width, 0) - hips).sum())
        np.testing.assert_allclose(there.keypoints[[12, 11]] * (-1, 1) + (width, 0), hips, atol=40)


def test_a_room_without_people_gives_empty_detections(networks, tmp_path: Path) -> None:
    path = tmp_path / "empty.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10, (320, 240))
    noise = np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8)
    for _ in range(3):
        writer.write(cv2.resize(noise, (320, 240), interpolation=cv2.INTER_CUBIC))
    writer.release()
    seen = list(perceive(open_video(path), networks, SilentProgress()))
    assert [o.detections for o in seen] == [()] * 3
