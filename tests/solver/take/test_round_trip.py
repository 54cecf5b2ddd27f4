"""What is written comes back, to the last bit and with everything we do not know; writing is whole or not at all."""

import dataclasses
import errno
import io
import json
import os
import zipfile
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings

from core_solver.errors import TakeError
from core_solver.take import JOINT_NAMES, PARENTS, Take, read_take, write_take, writing
from tests.solver.take.random_takes import TAKES, assert_same_array, assert_same_take, random_take

# The table of the format, by hand: what other programs rely on.
PERSON_TABLE = {
    "theta": ("<f4", "T 24 3"), "gamma": ("<f4", "T 3"), "betas": ("<f4", "10"), "scale": ("<f4", ""),
    "valid": ("|b1", "T"), "confidence": ("<f4", "T 24"), "contacts": ("<f4", "T 2"), "rest_joints": ("<f4", "24 3"),
    "rest_vertices": ("<f4", "V 3"), "faces": ("<i4", "F 3"), "weight_joints": ("|u1", "V 4"),
    "weights": ("<f4", "V 4"),
}  # fmt: skip
SCENE_TABLE = {
    "points": ("<f4", "P 3"), "colors": ("|u1", "P 3"), "depth": ("<f4", "H W"), "z_near": ("<f4", "T"),
    "z_far": ("<f4", "T"),
}  # fmt: skip
LENGTHS = {"T": 7, "V": 6, "F": 5, "P": 11, "H": 3, "W": 4}
META_ENTRIES = {
    "format", "version", "frame_rate", "frame_range", "frame_step", "video", "camera", "gravity", "ground",
    "body_model", "body_licence", "joint_names", "parents", "people", "depth_source", "solver", "warnings",
}  # fmt: skip


def sized_take() -> Take:
    return random_take(1, frames=7, vertices=6, faces=5, points=11, depth_size=(3, 4))


def plain_read(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The file as a stranger reads it."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)
    return arrays, json.loads(arrays["meta"].tobytes().decode("utf-8"))


def names_in(folder: Path) -> list[str]:
    return sorted(entry.name for entry in folder.iterdir())


@settings(max_examples=40, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(TAKES)
def test_any_take_comes_back_bit_for_bit(tmp_path: Path, take: Take) -> None:
    write_take(tmp_path / "take.npz", take)
    assert_same_take(read_take(tmp_path / "take.npz"), take)


def test_keys_types_and_shapes_are_the_formats_table(tmp_path: Path) -> None:
    write_take(tmp_path / "take.npz", sized_take())
    arrays, _ = plain_read(tmp_path / "take.npz")
    table = {"times": ("<f8", "T")}
    table |= {f"people/{i}/{field}": row for i in range(2) for field, row in PERSON_TABLE.items()}
    table |= {f"scene/{field}": row for field, row in SCENE_TABLE.items()}
    found = {key: (array.dtype.str, array.shape) for key, array in arrays.items() if key != "meta"}
    wanted = {
        key: (kind, tuple(LENGTHS.get(n) or int(n) for n in shape.split())) for key, (kind, shape) in table.items()
    }
    assert found == wanted
    assert (arrays["meta"].dtype, arrays["meta"].ndim) == (np.uint8, 1)


def test_meta_says_what_the_format_promises(tmp_path: Path) -> None:
    take = sized_take()
    meta = dataclasses.replace(take.meta, first_frame=40, frame_step=3)
    write_take(tmp_path / "take.npz", dataclasses.replace(take, meta=meta))
    _, document = plain_read(tmp_path / "take.npz")
    assert set(document) == META_ENTRIES
    assert document["format"] == "scene-aware-mocap/take"
    assert document["version"] == 1
    assert document["frame_rate"] == [30000, 1001]
    assert document["frame_range"] == [40, 58]
    assert document["video"] == {"name": meta.video_name, "width": 1280, "height": 720}
    assert {k: document["camera"][k] for k in ("fx", "fy", "cx", "cy")} == {
        "fx": 901.5, "fy": 900.25, "cx": 641.0, "cy": 359.5,
    }  # fmt: skip
    assert document["camera"]["distortion"] == [-0.1, 0.02, 0.001, -0.002, 0.003]
    assert document["joint_names"] == list(JOINT_NAMES)
    assert document["parents"] == list(PARENTS)
    assert [(p["id"], p["name"]) for p in document["people"]] == [(3, "Zoë 3"), (13, "Zoë 13")]
    assert all(set(p) == {"id", "name", "height_m", "colour"} for p in document["people"])
    assert document["solver"] == {"preset": "fast", "version": "9.8.7", "settings": meta.settings}


def test_how_the_video_was_held_still_comes_back(tmp_path: Path) -> None:
    maps = np.random.default_rng(3).normal(size=(7, 3, 3))
    take = dataclasses.replace(sized_take(), steadying=maps)
    write_take(tmp_path / "take.npz", take)
    arrays, _ = plain_read(tmp_path / "take.npz")
    assert (arrays["steadying"].dtype.str, arrays["steadying"].shape) == ("<f8", (7, 3, 3))
    read = read_take(tmp_path / "take.npz")
    assert read.steadying is not None
    assert_same_array(read.steadying, maps)
    assert_same_take(read, take)
    write_take(tmp_path / "again.npz", read)
    assert_same_array(plain_read(tmp_path / "again.npz")[0]["steadying"], maps)


@pytest.mark.parametrize(
    ("maps", "complaint"),
    [
        (np.tile(np.eye(3), (6, 1, 1)), "shape"),
        (np.full((7, 3, 3), np.nan), "not finite"),
        (np.zeros((7, 3, 3)), "cannot be undone"),
    ],
)
def test_maps_that_hold_no_video_still_are_refused(tmp_path: Path, maps: np.ndarray, complaint: str) -> None:
    with pytest.raises(TakeError, match=f"steadying.*{complaint}"):
        write_take(tmp_path / "take.npz", dataclasses.replace(sized_take(), steadying=maps))
    write_take(tmp_path / "take.npz", sized_take())
    arrays, _ = plain_read(tmp_path / "take.npz")
    np.savez(tmp_path / "take.npz", **arrays, steadying=maps)  # pyright: ignore[reportArgumentType]
    with pytest.raises(TakeError, match=f"steadying.*{complaint}"):
        read_take(tmp_path / "take.npz")


def test_the_skeleton_is_smpls() -> None:
    assert len(JOINT_NAMES) == len(set(JOINT_NAMES)) == 24
    assert PARENTS == (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
    chain = ["left_hand"]
    while PARENTS[JOINT_NAMES.index(chain[-1])] >= 0:
        chain.append(JOINT_NAMES[PARENTS[JOINT_NAMES.index(chain[-1])]])
    assert chain == [
        "left_hand", "left_wrist", "left_elbow", "left_shoulder", "left_collar", "spine3", "spine2", "spine1", "pelvis",
    ]  # fmt: skip


def test_unknown_arrays_and_meta_entries_are_kept_on_rewrite(tmp_path: Path) -> None:
    write_take(tmp_path / "take.npz", random_take())
    arrays, document = plain_read(tmp_path / "take.npz")
    document["studio"] = {"room": [1, 2, "drei"]}
    arrays["meta"] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    arrays["people/0/fingers"] = np.arange(6, dtype=np.int16).reshape(2, 3)
    arrays["their/strings"] = np.array(["a", "bc"])
    np.savez(tmp_path / "foreign.npz", **arrays)  # pyright: ignore[reportArgumentType]
    write_take(tmp_path / "again.npz", read_take(tmp_path / "foreign.npz"))
    kept, kept_document = plain_read(tmp_path / "again.npz")
    assert kept_document == document
    for key in ("people/0/fingers", "their/strings"):
        assert_same_array(kept[key], arrays[key])


def test_wider_arrays_are_stored_in_the_files_types(tmp_path: Path) -> None:
    take = random_take()
    person = dataclasses.replace(
        take.people[0], theta=take.people[0].theta.astype(float), faces=take.people[0].faces.astype(np.int64)
    )
    write_take(tmp_path / "take.npz", dataclasses.replace(take, people=(person, take.people[1])))
    assert_same_take(read_take(tmp_path / "take.npz"), take)


def test_the_same_take_gives_the_same_bytes_at_any_time(tmp_path: Path) -> None:
    for name in ("one.npz", "two.npz"):
        write_take(tmp_path / name, random_take())
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()
    with zipfile.ZipFile(tmp_path / "one.npz") as archive:
        assert {entry.date_time for entry in archive.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_a_file_name_that_is_not_unicode_survives(tmp_path: Path) -> None:
    take = random_take()
    meta = dataclasses.replace(take.meta, video_name=os.fsdecode(b"clip-\xff.mp4"))
    write_take(tmp_path / "take.npz", dataclasses.replace(take, meta=meta))
    assert read_take(tmp_path / "take.npz").meta.video_name == meta.video_name


def test_whole_frame_rates_stay_exact(tmp_path: Path) -> None:
    take = random_take()
    for rate in (Fraction(25), Fraction(24000, 1001), Fraction(1, 3)):
        write_take(
            tmp_path / "take.npz", dataclasses.replace(take, meta=dataclasses.replace(take.meta, frame_rate=rate))
        )
        assert read_take(tmp_path / "take.npz").meta.frame_rate == rate


def test_missing_folders_are_made(tmp_path: Path) -> None:
    write_take(tmp_path / "a" / "b" / "take.npz", random_take())
    assert read_take(tmp_path / "a" / "b" / "take.npz").frame_count == 3


class FullDisk(io.FileIO):
    """A file on a disk with room for `room` bytes."""

    room = 0

    def write(self, data: Any) -> int:
        if self.tell() + len(data) > self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return super().write(data)


@pytest.fixture
def old_file(tmp_path: Path) -> Path:
    write_take(tmp_path / "take.npz", random_take(1))
    return tmp_path / "take.npz"


@pytest.mark.parametrize("room", [0, 100, 3000])
def test_a_full_disk_leaves_the_old_take_and_nothing_else(
    old_file: Path, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    before = old_file.read_bytes()
    assert len(before) > 3000
    monkeypatch.setattr(FullDisk, "room", room)
    monkeypatch.setattr(writing.os, "fdopen", FullDisk)
    with pytest.raises(TakeError, match=r"cannot write .*No space left.*free some space"):
        write_take(old_file, random_take(2))
    assert old_file.read_bytes() == before
    assert names_in(old_file.parent) == [old_file.name]


@pytest.mark.parametrize("step", ["fsync", "chmod", "replace"])
def test_a_failing_last_step_leaves_the_old_take_and_nothing_else(
    old_file: Path, monkeypatch: pytest.MonkeyPatch, step: str
) -> None:
    before = old_file.read_bytes()

    def fail(*_: Any) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(*((writing.os, "fsync", fail) if step == "fsync" else (Path, step, fail)))
    with pytest.raises(TakeError, match="cannot write"):
        write_take(old_file, random_take(2))
    assert old_file.read_bytes() == before
    assert names_in(old_file.parent) == [old_file.name]


def test_ctrl_c_while_writing_leaves_the_old_take_and_nothing_else(
    old_file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = old_file.read_bytes()

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(writing.os, "fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_take(old_file, random_take(2))
    assert old_file.read_bytes() == before
    assert names_in(old_file.parent) == [old_file.name]


def test_places_that_cannot_be_written_are_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(TakeError, match="cannot write"):
        write_take(tmp_path / "file" / "take.npz", random_take())
    with pytest.raises(TakeError, match="cannot write"):
        write_take(tmp_path / "folder.npz", random_take())
    assert names_in(tmp_path) == ["file", "folder.npz"]


def test_settings_that_are_not_json_are_refused_before_the_old_take_is_touched(old_file: Path) -> None:
    before, take = old_file.read_bytes(), random_take()
    for bad in (object(), float("nan")):
        meta = dataclasses.replace(take.meta, settings={"x": bad})
        with pytest.raises(TakeError, match="JSON"):
            write_take(old_file, dataclasses.replace(take, meta=meta))
    assert old_file.read_bytes() == before
    assert names_in(old_file.parent) == [old_file.name]
