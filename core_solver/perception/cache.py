"""Observations on disk, so that an interrupted run can go on and long clips need little memory.

`NAME.work/observations/` holds `key.json`, which names the video, the frames, the networks and the given files, and
chunks of frames as plain numpy archives. A chunk appears whole or not at all.
"""

import errno
import hashlib
import json
import os
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.perception.onnx_weights import with_weights
from core_solver.perception.perceive import Networks, perceive
from core_solver.perception.precomputed.given import GivenModalities
from core_solver.perception.precomputed.join import Helpers, perceive_given
from core_solver.progress import Progress
from core_solver.video import VideoClip

_VERSION = 3  # raise when observations change their meaning
_CHUNK_FRAMES = 32
_PART_BYTES = 1 << 20
_FOLDER = "observations"
_KEY_FILE = "key.json"
_DAMAGED = (OSError, ValueError, KeyError, EOFError, IndexError, zipfile.BadZipFile)


@dataclass(frozen=True)
class Observations:
    """Observations in a folder; iterating reads one chunk after the other, as often as wanted.

    Attributes:
        folder: where they lie.
        frame_count: how many frames there are.
    """

    folder: Path
    frame_count: int

    def __len__(self) -> int:
        return self.frame_count

    def __iter__(self) -> Iterator[FrameObservations]:
        for number in range(chunk_count(self.frame_count)):
            yield from read_chunk(_chunk_path(self.folder, number))


def observe(
    clip: VideoClip, networks: Networks | Helpers, work: Path, progress: Progress, *, resume: bool
) -> Observations:
    """Observe a clip and keep the result.

    Args:
        clip: the video.
        networks: what to look with, or what is already known and what to look with at the rest.
        work: the take's work directory, made when missing; observations lie in its folder of that name.
        progress: shows one stage.
        resume: keep what an earlier run on the same video, frames, networks and given files has left.

    Raises:
        UserError: the folder cannot be written, or the disk is full.
        VideoError: a frame cannot be decoded.
        ModelError: the depth network does not fit.
    """
    given = networks.given if isinstance(networks, Helpers) else None
    key = observation_key(clip, networks.files_for(clip.width, clip.height), given)
    count, folder = len(clip.frame_list), work / _FOLDER
    try:
        _prepare(folder, key, resume=resume)
        missing = [n for n in range(chunk_count(count)) if not is_whole(_chunk_path(folder, n), clip, n)]
        if len(missing) < chunk_count(count):
            progress.note(f"{chunk_count(count) - len(missing)} of {chunk_count(count)} parts are kept")
        _fill(clip, networks, folder, progress, missing)
    except OSError as error:
        raise UserError(_explain(folder, error)) from error
    return Observations(folder, count)


def read_observations(work: Path) -> Observations:
    """The finished observations in a take's work directory.

    Raises:
        UserError: there are none, or they are not finished.
    """
    folder = work / _FOLDER
    try:
        count = int(json.loads((folder / _KEY_FILE).read_text())["frame_count"])
    except _DAMAGED as error:
        raise UserError(f"no observations in {folder}: run solve first") from error
    if not all(_chunk_path(folder, n).is_file() for n in range(chunk_count(count))):
        raise UserError(f"the observations in {folder} are not finished: run solve again with --resume")
    return Observations(folder, count)


def observation_key(clip: VideoClip, files: Sequence[Path], given: GivenModalities | None = None) -> str:
    """JSON that changes with anything that changes the observations.

    Args:
        clip: the video.
        files: networks, declarations and bodies in their order of use; what counts is what they hold, and what files
            beside them hold of their weights.
        given: what need not be computed.
    """
    known = {} if given is None else {"modalities": _fingerprint(given)}
    return json.dumps(
        {
            "version": _VERSION,
            "video": {"name": clip.path.name, "size": clip.path.stat().st_size, "parts": _parts(clip.path)},
            "frame_count": len(clip.frame_list),
            "first_frame": clip.frame_list[0].index,
            "every": clip.every,
            "rotation": clip.rotation,
            "networks": [{"name": file.name, "sha256": _content(file)} for file in with_weights(files)],
            **known,
        },
        indent=1,
    )


def _parts(video: Path) -> str:
    """A digest of a video's beginning, middle and end, which no copy changes; all of it may be hours long."""
    digest, size = hashlib.sha256(), video.stat().st_size
    with video.open("rb") as stream:
        for start in (0, size // 2, max(size - _PART_BYTES, 0)):
            stream.seek(start)
            digest.update(stream.read(_PART_BYTES))
    return digest.hexdigest()


def _content(file: Path) -> str:
    """A digest of a file, which may be too large for memory."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _fingerprint(given: GivenModalities) -> dict[str, str | int]:
    """A digest of the names, sizes and times of a folder's files, which may be many and large."""
    files = given.folder.files()
    stats = [(file.as_posix(), file.stat().st_size, file.stat().st_mtime_ns) for file in files]
    digest = hashlib.sha256(json.dumps([given.folder.path.as_posix(), stats]).encode()).hexdigest()
    return {"files": len(files), "digest": digest, "body": given.body.id}


def chunk_count(frame_count: int) -> int:
    """How many chunks hold this many frames."""
    return -(-frame_count // _CHUNK_FRAMES)


def chunk_positions(frame_count: int, number: int) -> range:
    """Positions in the clip's frame list that a chunk holds."""
    return range(number * _CHUNK_FRAMES, min((number + 1) * _CHUNK_FRAMES, frame_count))


def is_whole(path: Path, clip: VideoClip, number: int) -> bool:
    """Whether a chunk is there, undamaged, and holds the frames it should."""
    try:
        frames = tuple(o.frame for o in read_chunk(path))
    except _DAMAGED:
        return False
    return frames == tuple(clip.frame_list[p] for p in chunk_positions(len(clip.frame_list), number))


def write_chunk(path: Path, observations: Sequence[FrameObservations]) -> None:
    """Write some frames at once; the file appears whole or not at all."""
    people = [d for o in observations for d in o.detections]
    arrays = {
        "index": np.array([o.frame.index for o in observations], np.int64),
        "time": np.array([o.frame.time for o in observations], np.float64),
        "people": np.array([len(o.detections) for o in observations], np.int64),
        "score": np.array([d.score for d in people], np.float64),
        "identity": np.array([_NOBODY if d.identity is None else d.identity for d in people], np.int64),
        "regressed": np.array([d.regressed for d in people], bool),
        "unclaimed": np.array([len(o.unclaimed) for o in observations], np.int64),
    }
    arrays |= _packed("mask", [d.mask for d in people])
    arrays |= _packed("unclaimed", [mask for o in observations for mask in o.unclaimed])
    arrays |= {name: np.array([getattr(d, name) for d in people], np.float32) for name in _PER_PERSON}
    planes = [o.disparity for o in observations if o.disparity is not None]
    if len(planes) == len(observations):
        arrays["disparity"] = np.stack(planes)
    _write_atomically(path, arrays)


def read_chunk(path: Path) -> list[FrameObservations]:
    """The frames of a chunk, as written.

    Raises:
        OSError, ValueError, KeyError, EOFError, IndexError, BadZipFile: missing or damaged.
    """
    with np.load(path, allow_pickle=False) as archive:
        arrays = _completed({name: archive[name] for name in archive.files})
    count = len(arrays["index"])
    people = _split(_detections(arrays), arrays["people"])
    unclaimed = _split(_unpacked("unclaimed", arrays), arrays["unclaimed"])
    planes = arrays.get("disparity", [None] * count)
    return [
        FrameObservations(
            FrameInfo(int(arrays["index"][i]), float(arrays["time"][i])), people[i], planes[i], unclaimed[i]
        )
        for i in range(count)
    ]


_PER_PERSON = ("box", "keypoints", "confidence", "landmarks", "appearance")
_NOBODY = -1  # stands for an identity that is not known; known ones are not negative

_T = TypeVar("_T")


def _completed(arrays: dict[str, NDArray]) -> dict[str, NDArray]:
    """Arrays with what older versions did not keep: then no identity was known, and nothing regressed or unclaimed."""
    nothing = {
        "identity": np.full(len(arrays["score"]), _NOBODY),
        "regressed": np.zeros(len(arrays["score"]), bool),
        "unclaimed": np.zeros(len(arrays["index"]), np.int64),
        **_packed("unclaimed", ()),
    }
    return nothing | arrays


def _detections(arrays: dict[str, NDArray]) -> list[Detection]:
    return [
        Detection(
            score=float(arrays["score"][i]),
            mask=mask,
            identity=None if arrays["identity"][i] == _NOBODY else int(arrays["identity"][i]),
            regressed=bool(arrays["regressed"][i]),
            **{name: arrays[name][i] for name in _PER_PERSON},
        )
        for i, mask in enumerate(_unpacked("mask", arrays))
    ]


def _packed(name: str, masks: Sequence[CroppedMask]) -> dict[str, NDArray]:
    """Masks of any sizes as two arrays: where each lies, and all their values in a row."""
    return {
        f"{name}_place": np.array([(m.top, m.left, *m.values.shape) for m in masks], np.int64).reshape(-1, 4),
        f"{name}_values": np.concatenate([np.zeros(0, np.uint8), *(m.values.ravel() for m in masks)]),
    }


def _unpacked(name: str, arrays: dict[str, NDArray]) -> list[CroppedMask]:
    masks, start = [], 0
    for top, left, height, width in arrays[f"{name}_place"].tolist():
        values = arrays[f"{name}_values"][start : start + height * width].reshape(height, width)
        start += height * width
        masks.append(CroppedMask(top, left, values))
    return masks


def _split(items: Sequence[_T], counts: NDArray) -> list[tuple[_T, ...]]:
    """The items of each frame."""
    ends = np.cumsum(counts)
    if ends[-1] != len(items):
        raise ValueError("the chunk is damaged")
    return [tuple(items[end - count : end]) for count, end in zip(counts, ends, strict=True)]


def _prepare(folder: Path, key: str, *, resume: bool) -> None:
    """An empty folder with this key, or the one of an earlier run with the same key."""
    folder.mkdir(parents=True, exist_ok=True)
    key_file = folder / _KEY_FILE
    if resume and key_file.is_file() and key_file.read_text() == key:
        return
    for old in folder.glob("*.npz"):
        old.unlink()
    partial = key_file.with_suffix(".partial")
    partial.write_text(key)
    partial.replace(key_file)


def _fill(
    clip: VideoClip, networks: Networks | Helpers, folder: Path, progress: Progress, missing: Sequence[int]
) -> None:
    """Compute the missing chunks in one pass over the video."""
    positions = [p for n in missing for p in chunk_positions(len(clip.frame_list), n)]
    if not positions:
        return
    if isinstance(networks, Helpers):
        stream = perceive_given(clip, networks, progress, positions)
    else:
        stream = perceive(clip, networks, progress, positions)
    for number in missing:
        chunk = [next(stream) for _ in chunk_positions(len(clip.frame_list), number)]
        write_chunk(_chunk_path(folder, number), chunk)
    for _ in stream:  # lets the stage end
        pass


def _chunk_path(folder: Path, number: int) -> Path:
    return folder / f"{number:05d}.npz"


def _write_atomically(path: Path, arrays: dict[str, NDArray]) -> None:
    partial = path.with_suffix(".partial")
    try:
        with partial.open("wb") as file:
            np.savez_compressed(file, **arrays)  # type: ignore[arg-type]
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _explain(folder: Path, error: OSError) -> str:
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return f"the disk is full: make room for {folder} and run again with --resume"
    return f"cannot keep observations in {folder} ({error.strerror or error}): choose another output path"
