"""Joint errors after people's tracks are laid over the truth: alone in chunks of a clip, or all people together.

Joints are (N, T, J, 3) metres with a mask (N, T); rows are the same person in prediction and truth. The usual code fits
a scale too and so hides a wrong one: every measure here is told whether it may.
"""

from collections.abc import Iterator

import numpy as np

from core_solver.evaluation.metrics import MILLIMETRES, Array, Mask, mean_or_none, usable
from core_solver.geometry import fit_similarity

CHUNK = 100  # frames
_FIRST = 2  # frames that W-MPJPE aligns on


def w_mpjpe(predicted: Array, true: Array, mask: Mask, *, with_scale: bool) -> float | None:
    """World MPJPE: chunks of 100 frames, each person aligned on the chunk's first two frames. Millimetres."""
    return _chunk_errors(predicted, true, mask, _FIRST, with_scale=with_scale)


def wa_mpjpe(predicted: Array, true: Array, mask: Mask, *, with_scale: bool) -> float | None:
    """World-aligned MPJPE: chunks of 100 frames, each person aligned on the whole chunk. Millimetres."""
    return _chunk_errors(predicted, true, mask, CHUNK * 2, with_scale=with_scale)


def group_w(predicted: Array, true: Array, mask: Mask, *, with_scale: bool = False) -> float | None:
    """Mean joint error after one transform for all people and frames together: who stands where among the others."""
    measured = usable(mask, predicted, true)
    if not measured.any():
        return None
    return mean_or_none(_aligned(predicted[measured], true[measured], slice(None), with_scale=with_scale))


def _chunk_errors(predicted: Array, true: Array, mask: Mask, anchors: int, *, with_scale: bool) -> float | None:
    measured = usable(mask, predicted, true)
    errors = [
        _aligned(p[frames], t[frames], slice(anchors), with_scale=with_scale).ravel()
        for p, t, seen in zip(predicted, true, measured, strict=True)
        for frames in _chunks(np.flatnonzero(seen))
    ]
    return mean_or_none(np.concatenate(errors)) if errors else None


def _chunks(frames: np.ndarray) -> Iterator[np.ndarray]:
    """Runs of 100 measured frames; a shorter rest goes with the last run, as in the usual code."""
    starts = list(range(0, max(len(frames) - CHUNK, 0) + 1, CHUNK))
    for start, stop in zip(starts, [*starts[1:], len(frames)], strict=True):
        if stop > start:
            yield frames[start:stop]


def _aligned(predicted: Array, true: Array, anchors: slice, *, with_scale: bool) -> Array:
    """Errors (frames, J) in millimetres after the motion that fits the anchor frames best."""
    motion = fit_similarity(predicted[anchors].reshape(-1, 3), true[anchors].reshape(-1, 3), with_scale=with_scale)
    return np.linalg.norm(motion.apply(predicted) - true, axis=-1) * MILLIMETRES
