"""Exact frames to label and disparity pictures with the errors of real networks."""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.evaluation.synthetic.noise import NoiseLevels, drifting, knot_shape, smooth_field
from core_solver.evaluation.synthetic.render import ExactFrame, Grids
from core_solver.perception.disparity import normalise, sharpen_edges

Array = NDArray[np.float64]

# Bumps along the longer side of the picture: of what errors of disparity have in common, half is left over a tenth.
_MASK_KNOTS, _RELIEF_KNOTS, _WAVE_KNOTS, _GRAIN_KNOTS = 40, 6, 8, 60
_LEAST_RANGE = 1e-3  # of inverse depth, per metre


@dataclass(frozen=True)
class Sight:
    """What of N people could be seen over T frames.

    Attributes:
        visible: (N, T) share of the body.
        kind: (N, T, 25) index into NoiseLevels.sure: seen, behind oneself, behind others, outside the picture.
    """

    visible: Array
    kind: NDArray[np.uint8]


@dataclass(frozen=True)
class Pictures:
    """Spoilt pictures over T frames.

    Attributes:
        labels: (T, h, w) uint8.
        disparity: (T, hd, wd) float16.
    """

    labels: NDArray[np.uint8]
    disparity: NDArray[np.float16]


def spoil_frames(
    frames: Iterable[ExactFrame], people: int, times: Array, grids: Grids, levels: NoiseLevels,
    rng: np.random.Generator,
) -> tuple[Pictures, Sight]:  # fmt: skip
    """Spoil exact frames one by one; only the spoilt ones are kept."""
    count = len(times)
    labels = np.zeros((count, *grids.labels[::-1]), np.uint8)
    disparity = np.zeros((count, *grids.disparity[::-1]), np.float16)
    visible, kind = np.zeros((people, count)), np.zeros((people, count, 25), np.uint8)
    outlines = drifting(rng, times, (2, *knot_shape(grids.labels, _MASK_KNOTS)), levels.mask_seconds)
    errors = _draw_errors(rng, times, people, grids.disparity, levels)
    for t, frame in enumerate(frames):
        labels[t] = _displaced(frame.labels, levels.mask_cells * outlines[t])
        disparity[t] = errors.spoil(t, frame)
        visible[:, t] = frame.visible
        kind[:, t] = np.select([~frame.inside, frame.hidden_by_others, frame.hidden_by_self], [3, 2, 1], 0)
    return Pictures(labels, disparity), Sight(visible, kind)


def _displaced(labels: NDArray[np.uint8], knots: Array) -> NDArray[np.uint8]:
    """Labels whose outlines wander: each cell takes the label of a place nearby."""
    height, width = labels.shape
    across, down = (smooth_field(axis, (width, height)) for axis in knots)
    columns, rows = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    moved = cv2.remap(labels, columns + across, rows + down, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(moved, np.uint8)


@dataclass(frozen=True)
class _DisparityErrors:
    """Errors of disparity over T frames, all in ranges of the picture's disparity.

    Attributes:
        scale: (T,) factor after normalising.
        shift: (T,) after normalising.
        person: (T, N).
        relief: (r, c) knots of the smooth error that stays.
        wave: (T, r, c) knots of the one that changes.
        grain: (T, r, c) knots of the finest.
        blur: standard deviation, pixels.
    """

    scale: Array
    shift: Array
    person: Array
    relief: Array
    wave: Array
    grain: Array
    blur: float

    def spoil(self, t: int, frame: ExactFrame) -> NDArray[np.float16]:
        inverse = (1 / frame.depth).astype(np.float32)
        size = (inverse.shape[1], inverse.shape[0])
        low, high = np.percentile(inverse, (1, 99))
        disparity = (inverse - low) / max(high - low, _LEAST_RANGE)
        whose = np.asarray(cv2.resize(frame.labels, size, interpolation=cv2.INTER_NEAREST), np.uint8)
        disparity += np.concatenate([[0.0], self.person[t]]).astype(np.float32)[whose]
        disparity += smooth_field(self.relief, size) + smooth_field(self.wave[t], size)
        disparity += smooth_field(self.grain[t], size)
        blurred = cv2.GaussianBlur(disparity, (0, 0), self.blur)
        seen = sharpen_edges(normalise(np.asarray(blurred, np.float32)))
        # Normalising would take these two errors away: they are what is seen of real pictures after it.
        return np.clip(self.scale[t] * seen + self.shift[t], 0, 1).astype(np.float16)


def _draw_errors(
    rng: np.random.Generator, times: Array, people: int, size: tuple[int, int], levels: NoiseLevels
) -> _DisparityErrors:
    coarse, fine = knot_shape(size, _WAVE_KNOTS), knot_shape(size, _GRAIN_KNOTS)
    affine = drifting(rng, times, (2,), levels.disparity_affine_seconds)
    person = levels.disparity_person * drifting(rng, times, (people,), levels.disparity_person_seconds)
    return _DisparityErrors(
        scale=np.exp(levels.disparity_scale * affine[:, 0]),
        shift=levels.disparity_shift * affine[:, 1],
        person=person + levels.disparity_person_bias * rng.normal(size=people),
        relief=levels.disparity_relief * rng.normal(size=knot_shape(size, _RELIEF_KNOTS)),
        wave=levels.disparity_wave * drifting(rng, times, coarse, levels.disparity_wave_seconds),
        grain=levels.disparity_grain * drifting(rng, times, fine, levels.disparity_wave_seconds),
        blur=levels.disparity_blur * max(size),
    )
