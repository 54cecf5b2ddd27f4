"""Depth and disparity from PNG, NPZ, EXR and PFM files, as the normalised disparity that the solver takes."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.perception.disparity import normalise, sharpen_edges
from core_solver.perception.precomputed.exr import decode_exr
from core_solver.perception.precomputed.files import as_numbers, read_archive, read_bytes, read_png
from core_solver.perception.precomputed.numbering import frame_numbers
from core_solver.perception.precomputed.pfm import decode_pfm

Floats = NDArray[np.float32]

SUFFIXES = (".png", ".npz", ".exr", ".pfm")

_LONG_SIDE = 512  # of what is kept: no finer than networks give, and an hour of 1080p fits on a disk
_SMALLEST_SIDE = 8
_RANGE_FRAMES = 64  # metric depth's range over the clip is taken from this many frames, evenly spread
_RANGE_PERCENTILES = (0.1, 99.9)
_ARRAY_NAMES = ("disparity", "depth", "arr_0")


class DepthPlanes(Protocol):
    """Planes by frame number, read when they are wanted."""

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that the files speak of, as they count."""
        ...

    def read(self, number: int) -> Floats:
        """(h, w) as stored; NaN where nothing is known.

        Raises:
            UserError: the file is damaged.
        """
        ...


@dataclass(frozen=True)
class PlaneFiles:
    """One file a frame."""

    files: Mapping[int, Path]

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that there are files of."""
        return frozenset(self.files)

    def read(self, number: int) -> Floats:
        """The frame's file."""
        return read_plane(self.files[number])


@dataclass(frozen=True)
class PlaneStack:
    """All frames in one array (n, h, w), with the number of each."""

    planes: NDArray
    places: Mapping[int, int]

    @property
    def numbers(self) -> frozenset[int]:
        """The frames that there are planes of."""
        return frozenset(self.places)

    def read(self, number: int) -> Floats:
        """The frame's plane."""
        return self.planes[self.places[number]].astype(np.float32)


@dataclass(frozen=True)
class GivenDepth:
    """Depth of a clip.

    Attributes:
        planes: as stored.
        is_metric: depth, far = large, 0 where unknown; else disparity, near = large.
        low: inverse depth that becomes 0, for metric depth.
        high: inverse depth that becomes 1.
    """

    planes: DepthPlanes
    is_metric: bool
    low: float = 0.0
    high: float = 1.0

    @cached_property
    def shape(self) -> tuple[int, ...]:
        """(h, w) of what `read` gives for the first frame."""
        return self.read(min(self.planes.numbers)).shape

    def read(self, number: int) -> NDArray[np.float16]:
        """Normalised disparity (h, w) in [0, 1], near = large, NaN where unknown, edges sharpened.

        Disparity is stretched frame by frame, as a network's is; metric depth keeps one scale for the clip.
        """
        plane = _shrunk(self.planes.read(number))
        if self.is_metric:
            inverse = _inverse(plane)
            known = np.isfinite(inverse)
            disparity = np.clip((np.where(known, inverse, 0) - self.low) / (self.high - self.low), 0, 1)
        else:
            known = np.isfinite(plane)
            disparity = normalise(plane)
        return np.where(known, sharpen_edges(disparity.astype(np.float32)), np.nan).astype(np.float16)


def read_depth(path: Path, *, is_metric: bool) -> GivenDepth:
    """Depth from a folder with a file for each frame, or from one .npz for all.

    Args:
        path: the folder, or the archive, or a folder with one archive of a three-dimensional array.
        is_metric: what the files hold, unless an archive says so itself by the name of its array.

    Raises:
        UserError: nothing there, damaged, or of another kind.
    """
    files = [path] if path.is_file() else sorted(f for f in path.iterdir() if f.suffix.lower() in SUFFIXES)
    if not files:
        raise UserError(f"{path} holds no depth: put PNG, NPZ, EXR or PFM files there, with frame numbers in the names")
    kinds = {f.suffix.lower() for f in files}
    if len(kinds) > 1:
        raise UserError(f"{path} holds {' and '.join(sorted(kinds))} files: keep those of one kind")
    if kinds == {".npz"}:
        name, values, archive = _archive_array(files[0])
        is_metric = name == "depth" if name in ("depth", "disparity") else is_metric
        if values.ndim == 3 and len(files) == 1:
            return GivenDepth(_stack(values, archive.get("frames"), files[0]), is_metric)
    return GivenDepth(PlaneFiles(dict(zip(frame_numbers([f.name for f in files]), files, strict=True))), is_metric)


def with_range(depth: GivenDepth, numbers: list[int]) -> GivenDepth:
    """Metric depth that knows its range over the clip, from frames evenly spread over these; disparity as it is.

    Raises:
        UserError: no depth anywhere.
    """
    if not depth.is_metric or not numbers:
        return depth
    spread = np.unique(np.linspace(0, len(numbers) - 1, _RANGE_FRAMES).astype(int))
    inverses = [_inverse(depth.planes.read(numbers[i]))[::4, ::4] for i in spread]
    known = np.concatenate([i[np.isfinite(i)] for i in inverses])
    if known.size == 0:
        raise UserError("the depth files hold no depth above 0 in this clip: give disparity or take them away")
    low, high = (float(p) for p in np.percentile(known, _RANGE_PERCENTILES))
    return replace(depth, low=low, high=max(high, low * (1 + 1e-6) + 1e-12))


def read_plane(file: Path) -> Floats:
    """One frame's plane (h, w) from a file; NaN for what is no number.

    Raises:
        UserError: damaged, or no picture of one value a pixel.
    """
    suffix = file.suffix.lower()
    if suffix == ".npz":
        plane = np.squeeze(_archive_array(file)[1])
    elif suffix == ".png":
        plane = _grey_levels(read_png(file), file)
    else:
        try:
            plane = (decode_exr if suffix == ".exr" else decode_pfm)(read_bytes(file))
        except ValueError as error:
            raise UserError(f"{file} cannot be read as depth: {error}") from error
    if plane.ndim != 2 or min(plane.shape) < _SMALLEST_SIDE:
        raise UserError(f"{file} is {plane.shape} and no picture of depth: one value a pixel is needed")
    with np.errstate(over="ignore", invalid="ignore"):
        plane = plane.astype(np.float32)
    return np.where(np.isfinite(plane), plane, np.nan).astype(np.float32)


def _grey_levels(picture: NDArray, file: Path) -> NDArray:
    if picture.ndim == 2:
        return picture
    if np.array_equal(picture[..., 0], picture[..., 1]) and np.array_equal(picture[..., 1], picture[..., 2]):
        return picture[..., 0]
    raise UserError(f"{file} is coloured: colours cannot be turned back into depth, save it as a grey 16-bit PNG")


def _archive_array(file: Path) -> tuple[str, NDArray, Mapping[str, NDArray]]:
    archive = read_archive(file)
    pictures = {name: array for name, array in archive.items() if array.ndim >= 2 and array.dtype.kind in "fiu"}
    name = next((n for n in _ARRAY_NAMES if n in pictures), None)
    if name is None and len(pictures) == 1:
        name = next(iter(pictures))
    if name is None:
        raise UserError(f"{file} holds no array that is called disparity or depth: name it so")
    return name, pictures[name], archive


def _stack(values: NDArray, frames: NDArray | None, file: Path) -> PlaneStack:
    if len(values) == 0 or min(values.shape[1:]) < _SMALLEST_SIDE:
        raise UserError(f"{file} holds {values.shape}: no pictures, or too small ones")
    numbers = np.arange(len(values)) if frames is None else as_numbers(frames, file, "frames").ravel()
    whole = np.isfinite(numbers).all() and np.array_equal(numbers, np.round(numbers))
    if not whole or len(numbers) != len(values) or len(np.unique(numbers)) != len(numbers):
        raise UserError(f'{file}: "frames" must be one whole number for each of the {len(values)} pictures')
    return PlaneStack(values, {int(number): place for place, number in enumerate(numbers)})


def _inverse(plane: Floats) -> Floats:
    return np.where(np.isfinite(plane) & (plane > 0), 1 / np.where(plane > 0, plane, 1), np.nan).astype(np.float32)


def _shrunk(plane: Floats) -> Floats:
    """At most `_LONG_SIDE` pixels long; taking single pixels keeps edges sharp and unknown ones apart."""
    height, width = plane.shape
    scale = _LONG_SIDE / max(height, width)
    if scale >= 1:
        return plane
    size = max(round(width * scale), 1), max(round(height * scale), 1)
    return cv2.resize(plane, size, interpolation=cv2.INTER_NEAREST)  # type: ignore[return-value]
