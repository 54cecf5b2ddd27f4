"""Real people: what the networks have seen once is given back as files, and must be seen alike."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver.body import load_body
from core_solver.perception.cache import observe
from core_solver.perception.observations import FrameObservations
from core_solver.perception.perceive import label_size, load_networks, perceive
from core_solver.perception.precomputed.given import open_modalities
from core_solver.perception.precomputed.join import load_helpers
from core_solver.progress import SilentProgress
from core_solver.video import VideoClip, open_video

pytestmark = [pytest.mark.models, pytest.mark.shared]

SECONDS = 0.1


@pytest.fixture(scope="module")
def clip(shared_data: Path) -> VideoClip:
    return open_video(shared_data / "clips" / "lab_two_people_cam01.mp4", end_s=SECONDS)


@pytest.fixture(scope="module")
def seen(clip: VideoClip, models) -> list[FrameObservations]:
    return list(perceive(clip, load_networks(models, None), SilentProgress()))


def write_alphapose(file: Path, seen: list[FrameObservations]) -> None:
    file.parent.mkdir(parents=True)
    people = [
        {"image_id": f"{o.frame.index + 1}.jpg", "category_id": 1, "score": d.score,
         "keypoints": np.column_stack([d.keypoints, d.confidence])[:17].ravel().tolist()}
        for o in seen
        for d in o.detections
    ]  # fmt: skip
    file.write_text(json.dumps(people))


def write_ids(folder: Path, seen: list[FrameObservations], size: tuple[int, int], cells: tuple[int, int]) -> None:
    folder.mkdir(parents=True)
    for o in seen:
        ids = np.zeros(cells[::-1], np.uint8)
        for i, d in enumerate(o.detections, 1):
            rows, columns = d.mask.values.shape
            ids[d.mask.top : d.mask.top + rows, d.mask.left : d.mask.left + columns][d.mask.values > 127] = i
        picture = cv2.resize(ids, size, interpolation=cv2.INTER_NEAREST)
        assert cv2.imwrite(str(folder / f"{o.frame.index + 1:05d}.png"), picture)


@pytest.mark.parametrize("with_joints", [True, False])
def test_given_joints_or_masks_lead_to_the_same_people(clip, seen, models, tmp_path: Path, with_joints: bool) -> None:
    """Without joints the default networks find people, and the masks find them."""
    folder = tmp_path / "given"
    write_ids(folder / "masks", seen, (clip.width, clip.height), label_size(clip.width, clip.height))
    (folder / "modalities.toml").write_text("[masks]\nfirst = 1\nidentities = false\n")
    if with_joints:
        write_alphapose(folder / "joints" / "alphapose-results.json", seen)
    given = open_modalities(folder, clip, load_body(models.require("open-body")))
    helpers = load_helpers(models, None, (), "cpu", given)
    assert (helpers.people is None) == with_joints
    again = list(observe(clip, helpers, tmp_path / "w", SilentProgress(), resume=False))
    for before, after in zip(seen, again, strict=True):
        assert len(before.detections) == len(after.detections)
        for d, e in zip(before.detections, after.detections, strict=True):
            np.testing.assert_allclose(e.keypoints[:17], d.keypoints[:17], atol=0.01)
            assert np.linalg.norm(e.landmarks - d.landmarks, axis=1).mean() < 0.06
            assert float(e.appearance @ d.appearance) > 0.9
            cells = [np.count_nonzero(x.mask.values > 127) for x in (d, e)]
            assert cells[1] == pytest.approx(cells[0], rel=0.1)
