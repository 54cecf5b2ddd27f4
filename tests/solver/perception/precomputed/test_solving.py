"""`--modalities`: from a synthetic clip's files to a take, without any network at hand."""

import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from core_solver import pipeline
from core_solver.errors import ModelError, UserError
from core_solver.optimise import pose_fit
from core_solver.perception.cache import observe, read_observations
from core_solver.perception.networks.declared import Declared
from core_solver.perception.precomputed import join
from core_solver.perception.precomputed.given import GivenModalities, open_modalities
from core_solver.perception.precomputed.join import Helpers, load_helpers
from core_solver.pipeline import SolveOptions, solve_video
from core_solver.progress import SilentProgress
from core_solver.tracking import UNCLAIMED, track_people
from core_solver.video import open_video
from tests.solver.body.synthetic import make_stick_body
from tests.solver.perception.precomputed.export import (
    CAMERA,
    FRAMES,
    HEIGHT,
    WIDTH,
    draw_video,
    write_alphapose,
    write_disparity,
    write_ids,
    write_romp,
)
from tests.solver.scenes import SyntheticClip, Walker, make_clip

BODY = make_stick_body()
LABELS = (WIDTH, HEIGHT)


class EmptyStore:
    """A store that holds no network, on a machine without internet."""

    def __init__(self, _folder: Path | None = None, *, offline: bool = False):
        pass

    def path(self, _name: str) -> Path | None:
        return None

    def files(self, _task: str) -> tuple[Path, ...]:
        return ()

    def require(self, name: str) -> Path:
        if name == "open-body":
            return Path(name)
        raise ModelError(f"{name} is not here")


@pytest.fixture(scope="module")
def couple() -> SyntheticClip:
    walkers = [Walker(1.0, (-0.8, 5), 0.5), Walker(0.95, (0.8, 6), -1.0)]
    return make_clip(BODY, walkers, frames=FRAMES, camera=CAMERA, noise_px=0.3)


@pytest.fixture
def video(tmp_path: Path) -> Path:
    return draw_video(tmp_path / "clip.avi")


@pytest.fixture
def folder(tmp_path: Path, couple: SyntheticClip) -> Path:
    """The layout of the authors' preprocessing."""
    folder = tmp_path / "given"
    write_alphapose(folder / "AlphaPose" / "alphapose-results.json", couple)
    write_romp(folder / "ROMP_Predictions", couple)
    write_disparity(folder / "DPT_large_monodepth", couple)
    write_ids(folder / "Mask2Former_Instances", couple, shuffled=True)
    return folder


def given(folder: Path, video: Path) -> GivenModalities:
    return open_modalities(folder, open_video(video), BODY)


def helpers(folder: Path, video: Path) -> Helpers:
    return load_helpers(EmptyStore(), None, (), "cpu", given(folder, video))  # type: ignore[arg-type]


def seen(folder: Path, video: Path, work: Path):
    return list(observe(open_video(video), helpers(folder, video), work, SilentProgress(), resume=False))


def modalities(folder: Path, video: Path, work: Path):
    return track_people(seen(folder, video, work), (WIDTH, HEIGHT), LABELS)


def test_the_authors_layout_becomes_the_solvers_input(folder: Path, video: Path, tmp_path: Path, couple) -> None:
    found = modalities(folder, video, tmp_path / "w")
    truth = couple.modalities
    assert len(found.tracks) == 2
    for track, true_track in zip(found.tracks, truth.tracks, strict=True):
        assert track.valid.all()
        np.testing.assert_allclose(track.keypoints[:, :17], true_track.keypoints[:, :17], atol=1e-3)
        assert (track.confidence[:, 17:] == 0).all()
        # The truth's landmarks carry an error of their own: 1 cm, and 5 cm along the view.
        error = np.linalg.norm(track.landmarks - true_track.landmarks, axis=-1)
        assert error.mean() < 0.07
        true_masks = np.stack([to_size(plane == true_track.id) for plane in truth.labels])
        own = found.labels == track.id
        assert (own & true_masks).sum() > 0.85 * (own | true_masks).sum()
    assert found.disparity is not None
    assert truth.disparity is not None
    for plane, true_plane in zip(found.disparity, truth.disparity, strict=True):
        # Scale and shift are free; steps at people's edges may be drawn a pixel away.
        assert np.corrcoef(plane.astype(float).ravel(), true_plane.astype(float).ravel())[0, 1] > 0.98


def to_size(mask: np.ndarray) -> np.ndarray:
    return cv2.resize(mask.astype(np.uint8), (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST).astype(bool)


def test_a_take_without_any_network(folder: Path, video: Path, couple, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pipeline, "ModelStore", EmptyStore)
    monkeypatch.setattr(pipeline, "load_body", lambda _path: BODY)
    monkeypatch.setattr(pose_fit, "ITERATIONS", 20)
    for gap in ("ROMP_Predictions/img_000003.npz", "DPT_large_monodepth/img_000005.png"):
        (folder / gap).unlink()
    output = folder.parent / "take.npz"
    take = solve_video(SolveOptions(video, output, fov_degrees=60.0, modalities=folder), SilentProgress())
    assert len(take.people) == 2
    assert take.meta.depth_source == "DPT_large_monodepth (precomputed)"
    assert take.meta.settings["modalities"] is True
    for person, truth in zip(take.people, couple.joints, strict=True):
        pelvis = person.scale * person.rest_joints[0] + person.gamma
        assert np.abs(CAMERA.project(pelvis) - CAMERA.project(truth[:, 0])).max() < 12


def test_a_missing_frame_is_a_gap_and_shifts_nothing(folder: Path, video: Path, tmp_path: Path, couple) -> None:
    for name in ("ROMP_Predictions/img_000004.npz", "DPT_large_monodepth/img_000004.png",
                 "Mask2Former_Instances/img_000004.png"):  # fmt: skip
        (folder / name).unlink()
    file = folder / "AlphaPose" / "alphapose-results.json"
    people = json.loads(file.read_text())
    file.write_text(json.dumps([p for p in people if p["image_id"] != "img_000006.jpg"]))
    frames = seen(folder, video, tmp_path / "w")
    found = track_people(frames, (WIDTH, HEIGHT), LABELS)
    first = found.tracks[0]
    assert first.valid.tolist() == [t != 6 for t in range(FRAMES)]
    np.testing.assert_allclose(first.keypoints[7, :17], couple.modalities.tracks[0].keypoints[7, :17], atol=1e-3)
    assert found.disparity is not None
    assert np.isnan(found.disparity[4].astype(float)).all()
    assert np.isfinite(found.disparity[5].astype(float)).all()
    # Without masks people's boxes are no background; without joints their masks are nobody's.
    assert all(np.isnan(d.landmarks).all() for d in frames[4].detections)
    assert not (found.labels[4] == 1).any()
    assert (found.labels[4] == UNCLAIMED).sum() > (found.labels[3] == 1).sum()
    assert (found.labels[6] == UNCLAIMED).sum() > 0.5 * (found.labels[5] == 1).sum()
    assert not np.isin(found.labels[6], (1, 2)).any()


@pytest.mark.parametrize("first", [0, 1, 1000])
def test_wherever_counting_starts(tmp_path: Path, video: Path, couple, first: int) -> None:
    folder = tmp_path / "given"
    write_alphapose(folder / "joints" / "a.json", couple, first=first)
    write_romp(folder / "smpl", couple, first=first)
    write_ids(folder / "masks", couple, first=first)
    write_disparity(folder / "disparity", couple, first=first)
    opened = given(folder, video)
    assert [f"counted from {first}." in note for note in opened.notes] == [True] * 4
    found = modalities(folder, video, tmp_path / "w")
    truth = couple.modalities.tracks[0]
    np.testing.assert_allclose(found.tracks[0].keypoints[3, :17], truth.keypoints[3, :17], atol=1e-3)


def test_a_guess_is_called_one_unless_others_settle_it(tmp_path: Path, video: Path, couple) -> None:
    folder = tmp_path / "given"
    file = write_alphapose(folder / "joints" / "a.json", couple)
    people = json.loads(file.read_text())
    file.write_text(json.dumps([p for p in people if p["image_id"] in ("img_000003.jpg", "img_000007.jpg")]))
    (note,) = given(folder, video).notes
    assert "2 frames, counted from 0 (a guess: `first` in modalities.toml settles it)" in note
    write_disparity(folder / "disparity", couple, first=1)
    notes = given(folder, video).notes
    assert [("counted from 1." in n, "guess" in n) for n in notes] == [(True, False)] * 2


def test_what_is_said_in_modalities_toml_goes_before(folder: Path, video: Path) -> None:
    (folder / "modalities.toml").write_text("[depth]\nfirst = 5\n")
    with pytest.raises(UserError, match=r"DPT_large_monodepth speaks of frames 0 to 11.*counted from 5"):
        given(folder, video)
    (folder / "modalities.toml").write_text('[depth]\nfirst = 0\nkind = "depth"\n[joints]\nidentities = false\n')
    opened = given(folder, video)
    assert opened.depth is not None
    assert opened.depth.is_metric
    assert opened.identities_from is None, "this program's masks number people anew in every picture"


def test_ids_of_masks_are_identities_where_joints_have_none(tmp_path: Path, video: Path, couple) -> None:
    folder = tmp_path / "given"
    write_alphapose(folder / "joints" / "a.json", couple)
    write_romp(folder / "smpl", couple)
    write_ids(folder / "masks", couple)
    (folder / "modalities.toml").write_text("[joints]\nidentities = false\n")
    frames = seen(folder, video, tmp_path / "w")
    assert all({d.identity for d in frame.detections} == {1, 2} for frame in frames)
    (folder / "modalities.toml").unlink()
    frames = seen(folder, video, tmp_path / "v")
    assert all({d.identity for d in frame.detections} == {11, 12} for frame in frames)


def test_joints_of_another_size_are_scaled_or_refused(tmp_path: Path, video: Path, couple) -> None:
    folder = tmp_path / "given"
    write_alphapose(folder / "joints" / "a.json", couple, scale=4.0)
    with pytest.raises(UserError, match=r"of the joints in joints lie outside the 320x240 video.*size"):
        given(folder, video)
    (folder / "modalities.toml").write_text(f"[joints]\nsize = [{4 * WIDTH}, {4 * HEIGHT}]\n")
    opened = given(folder, video)
    assert any("scaled from 1280x960 to 320x240" in note for note in opened.notes)
    people = opened.people_at(2)
    assert people is not None
    np.testing.assert_allclose(people[0].keypoints[:17], couple.modalities.tracks[0].keypoints[2, :17], atol=1e-3)
    (folder / "modalities.toml").write_text("[joints]\nsize = [1920, 1080]\n")
    with pytest.raises(UserError, match=r"joints is 1920x1080, the video 320x240.*stretch"):
        given(folder, video)


def test_pictures_of_another_shape_are_refused(folder: Path, tmp_path: Path) -> None:
    wide = draw_video(tmp_path / "wide.avi", size=(480, 240))
    with pytest.raises(UserError, match=r"DPT_large_monodepth is \d+x\d+, the video 480x240"):
        given(folder, wide)
    (folder / "modalities.toml").write_text("[depth]\nstretch = true\n")
    with pytest.raises(UserError, match="Mask2Former_Instances is 320x240, the video 480x240"):
        given(folder, wide)


def test_normalised_joints_are_refused(tmp_path: Path, video: Path, couple) -> None:
    write_alphapose(tmp_path / "given" / "joints" / "a.json", couple, scale=1 / WIDTH)
    with pytest.raises(UserError, match="not in pixels"):
        given(tmp_path / "given", video)


@pytest.mark.parametrize(
    ("task", "given_too", "complaint"),
    [
        ("finder", "AlphaPose", "already holds joints"),
        ("poses", "AlphaPose", "already holds joints"),
        ("bodies", "ROMP_Predictions", "already holds SMPL poses"),
        ("masks", "Mask2Former_Instances", "already holds masks"),
        ("depth", "DPT_large_monodepth", "already holds depth"),
        ("masks", "AlphaPose", "only depth can be used beside"),
    ],
)
def test_nothing_is_given_and_computed_at_once(folder, video, monkeypatch, task, given_too, complaint) -> None:
    for entry in list(folder.iterdir()):
        if entry.name != given_too:
            entry.rename(folder.parent / entry.name)
    monkeypatch.setattr(join, "open_declared", lambda *_arguments: Declared(**{task: object()}))
    with pytest.raises(UserError, match=complaint):
        load_helpers(EmptyStore(), None, ("own.toml",), "cpu", given(folder, video))  # type: ignore[arg-type]


def test_a_depth_file_beside_given_depth_is_refused(folder: Path, video: Path) -> None:
    with pytest.raises(UserError, match="already holds depth"):
        load_helpers(EmptyStore(), Path("midas.onnx"), (), "cpu", given(folder, video))  # type: ignore[arg-type]


@pytest.mark.parametrize("lacking", ["ROMP_Predictions", "Mask2Former_Instances", "AlphaPose"])
def test_a_network_for_what_is_lacking_must_be_there(folder: Path, video: Path, lacking: str) -> None:
    (folder / lacking).rename(folder / "elsewhere")
    with pytest.raises(ModelError, match="is not here"):
        helpers(folder, video)


def test_a_changed_file_is_noticed_when_a_run_goes_on(folder: Path, video: Path, tmp_path: Path) -> None:
    clip, work = open_video(video), tmp_path / "w"
    observe(clip, helpers(folder, video), work, SilentProgress(), resume=True)
    key = (work / "observations" / "key.json").read_text()
    chunk = next((work / "observations").glob("*.npz")).stat().st_mtime_ns
    observe(clip, helpers(folder, video), work, SilentProgress(), resume=True)
    assert next((work / "observations").glob("*.npz")).stat().st_mtime_ns == chunk
    os.utime(folder / "ROMP_Predictions" / "img_000003.npz", ns=(1, 1))
    observe(clip, helpers(folder, video), work, SilentProgress(), resume=True)
    assert (work / "observations" / "key.json").read_text() != key
    assert next((work / "observations").glob("*.npz")).stat().st_mtime_ns != chunk
    assert len(read_observations(work)) == FRAMES
