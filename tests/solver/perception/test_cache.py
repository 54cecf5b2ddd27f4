"""Observations written, read, resumed and damaged; the networks are replaced by a counter."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.perception import cache
from core_solver.perception.cache import observation_key, observe, read_chunk, read_observations, write_chunk
from core_solver.perception.observations import CroppedMask, FrameObservations
from core_solver.progress import SilentProgress
from core_solver.video import VideoClip, open_video
from tests.solver.perception.people import random_observations
from tests.solver.test_video import write_video

FRAMES = 70  # two whole chunks and a part


def same(a: FrameObservations, b: FrameObservations) -> bool:
    def arrays(o: FrameObservations) -> list:
        people = [
            x
            for d in o.detections
            for x in (d.score, d.box, d.keypoints, d.confidence, d.landmarks, d.appearance, d.mask.top, d.mask.left,
                      d.mask.values)
        ]  # fmt: skip
        return [*people, np.zeros(0) if o.disparity is None else o.disparity]

    pairs = list(zip(arrays(a), arrays(b), strict=True))
    return a.frame == b.frame and all(np.array_equal(x, y) for x, y in pairs)


class CountingNetworks:
    """Stands for the networks: remembers which frames were looked at, and may break off."""

    def __init__(self, model: Path) -> None:
        self.model = model
        self.looked: list[int] = []
        self.break_at: int | None = None

    def files_for(self, _width: int, _height: int) -> tuple[Path, ...]:
        return (self.model,)

    def perceive(self, clip: VideoClip, _networks, _progress, positions):
        for position in positions:
            if position == self.break_at:
                raise KeyboardInterrupt
            self.looked.append(position)
            yield made_up(clip, position)


def made_up(clip: VideoClip, position: int) -> FrameObservations:
    made = random_observations(np.random.default_rng(position), 0, position % 4)
    return FrameObservations(clip.frame_list[position], made.detections, made.disparity)


@pytest.fixture
def clip(tmp_path: Path) -> VideoClip:
    return open_video(write_video(tmp_path / "clip.avi", frames=FRAMES))


@pytest.fixture
def networks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> CountingNetworks:
    model = tmp_path / "model.onnx"
    model.write_bytes(b"weights")
    networks = CountingNetworks(model)
    monkeypatch.setattr(cache, "perceive", networks.perceive)
    return networks


def run(clip: VideoClip, networks: CountingNetworks, work: Path, resume: bool = True) -> list[FrameObservations]:
    return list(observe(clip, networks, work, SilentProgress(), resume=resume))  # type: ignore[arg-type]


def is_all_there(clip: VideoClip, seen: list[FrameObservations]) -> bool:
    return len(seen) == FRAMES and all(same(o, made_up(clip, p)) for p, o in enumerate(seen))


@pytest.mark.parametrize("people", [[0, 0], [3, 0, 1], [0]])
@pytest.mark.parametrize("depth", [True, False])
def test_a_chunk_comes_back_as_written(tmp_path: Path, people: list[int], depth: bool) -> None:
    rng = np.random.default_rng(7)
    written = [random_observations(rng, i, n, depth) for i, n in enumerate(people)]
    write_chunk(tmp_path / "a.npz", written)
    read = read_chunk(tmp_path / "a.npz")
    assert len(read) == len(written)
    assert all(same(a, b) for a, b in zip(written, read, strict=True))
    assert [p.name for p in tmp_path.iterdir()] == ["a.npz"]


def test_identities_and_unclaimed_places_come_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    written = [random_observations(rng, i, 2) for i in range(3)]
    first, second = written[1].detections
    places = (CroppedMask(3, 4, np.full((2, 5), 255, np.uint8)), CroppedMask(0, 0, np.full((1, 1), 255, np.uint8)))
    first = replace(first, identity=0, regressed=True)
    written[1] = replace(written[1], detections=(first, second), unclaimed=places)
    write_chunk(tmp_path / "a.npz", written)
    read = read_chunk(tmp_path / "a.npz")
    assert [d.identity for o in read for d in o.detections] == [None, None, 0, None, None, None]
    assert [d.regressed for o in read for d in o.detections] == [False, False, True, False, False, False]
    assert [len(o.unclaimed) for o in read] == [0, 2, 0]
    for found, place in zip(read[1].unclaimed, places, strict=True):
        assert (found.top, found.left) == (place.top, place.left)
        assert np.array_equal(found.values, place.values)


def test_observations_of_the_first_version_can_still_be_read(tmp_path: Path) -> None:
    written = [random_observations(np.random.default_rng(3), 0, 2)]
    write_chunk(tmp_path / "a.npz", written)
    with np.load(tmp_path / "a.npz") as archive:
        old = {
            n: archive[n] for n in archive.files if n not in ("identity", "regressed") and not n.startswith("unclaimed")
        }
    np.savez(tmp_path / "a.npz", **old)
    (read,) = read_chunk(tmp_path / "a.npz")
    assert same(read, written[0])
    assert read.unclaimed == ()


def test_observations_can_be_read_twice_and_later(clip: VideoClip, networks, tmp_path: Path) -> None:
    kept = observe(clip, networks, tmp_path / "w", SilentProgress(), resume=False)
    assert len(kept) == FRAMES
    assert is_all_there(clip, list(kept))
    assert is_all_there(clip, list(kept))
    assert is_all_there(clip, list(read_observations(tmp_path / "w")))


def test_an_interrupted_run_goes_on_where_it_was(clip: VideoClip, networks, tmp_path: Path) -> None:
    networks.break_at = 50
    with pytest.raises(KeyboardInterrupt):
        run(clip, networks, tmp_path / "w")
    with pytest.raises(UserError, match="not finished"):
        read_observations(tmp_path / "w")
    networks.break_at, networks.looked = None, []
    assert is_all_there(clip, run(clip, networks, tmp_path / "w"))
    assert networks.looked == list(range(32, FRAMES))
    networks.looked = []
    assert is_all_there(clip, run(clip, networks, tmp_path / "w"))
    assert networks.looked == []


def test_without_resume_everything_is_new(clip: VideoClip, networks, tmp_path: Path) -> None:
    run(clip, networks, tmp_path / "w")
    networks.looked = []
    run(clip, networks, tmp_path / "w", resume=False)
    assert networks.looked == list(range(FRAMES))


@pytest.mark.parametrize("keep", [0, 100, 0.5, 0.99])
def test_a_damaged_chunk_is_made_again(clip: VideoClip, networks, tmp_path: Path, keep: float) -> None:
    run(clip, networks, tmp_path / "w")
    chunk = tmp_path / "w" / "observations" / "00001.npz"
    whole = chunk.read_bytes()
    chunk.write_bytes(whole[: int(keep * len(whole)) if keep < 1 else int(keep)])
    networks.looked = []
    assert is_all_there(clip, run(clip, networks, tmp_path / "w"))
    assert networks.looked == list(range(32, 64))


def test_a_flipped_bit_is_noticed(clip: VideoClip, networks, tmp_path: Path) -> None:
    run(clip, networks, tmp_path / "w")
    chunk = tmp_path / "w" / "observations" / "00000.npz"
    damaged = bytearray(chunk.read_bytes())
    damaged[len(damaged) // 3] ^= 0x10
    chunk.write_bytes(damaged)
    networks.looked = []
    assert is_all_there(clip, run(clip, networks, tmp_path / "w"))
    assert networks.looked == list(range(32))


def test_another_video_range_or_network_starts_anew(clip: VideoClip, networks, tmp_path: Path) -> None:
    work = tmp_path / "w"
    run(clip, networks, work)
    networks.looked = []
    half = open_video(clip.path, every=2)
    assert len(run(half, networks, work)) == FRAMES // 2
    assert networks.looked == list(range(FRAMES // 2))
    networks.looked = []
    networks.model.write_bytes(b"other weights")
    run(half, networks, work)
    assert networks.looked == list(range(FRAMES // 2))
    networks.looked = []
    write_video(clip.path, frames=FRAMES, rate=30)
    changed = open_video(clip.path)
    assert len(run(changed, networks, work)) == FRAMES
    assert networks.looked == list(range(FRAMES))


def test_a_copied_video_is_the_same_and_a_changed_one_is_not(clip: VideoClip, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "_PART_BYTES", 64)  # the test's video is shorter than one part
    key = observation_key(clip, [])
    content = clip.path.read_bytes()
    os.utime(clip.path, (1, 1))
    assert observation_key(clip, []) == key
    for place in (0, len(content) // 2, len(content) - 1):
        changed = bytearray(content)
        changed[place] ^= 1
        clip.path.write_bytes(changed)
        assert observation_key(clip, []) != key, place


def test_networks_of_one_file_name_are_told_apart(clip: VideoClip, tmp_path: Path) -> None:
    files = [tmp_path / folder / name for folder in ("masks", "depth") for name in ("model.toml", "model.onnx")]
    for file in files:
        file.parent.mkdir(exist_ok=True)
        file.write_bytes(file.as_posix().encode())
    keys = {observation_key(clip, files), observation_key(clip, files[:2]), observation_key(clip, files[2:])}
    for file in files:
        file.write_bytes(b"changed")
        keys.add(observation_key(clip, files))
    assert len(keys) == 3 + len(files)
    assert observation_key(clip, files) in keys


def test_a_place_that_cannot_be_written_is_named(clip: VideoClip, networks, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(UserError, match="choose another output path"):
        run(clip, networks, tmp_path / "file")


def test_a_full_disk_is_named_and_leaves_no_half_chunk(
    clip: VideoClip, networks, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_args, **_kwargs):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(cache.np, "savez_compressed", full)
    with pytest.raises(UserError, match="disk is full"):
        run(clip, networks, tmp_path / "w")
    assert [p.name for p in (tmp_path / "w" / "observations").iterdir()] == ["key.json"]


def test_no_observations_are_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no observations"):
        read_observations(tmp_path)
