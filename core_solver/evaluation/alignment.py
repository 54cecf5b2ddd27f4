"""Joint errors after people's tracks are laid over the truth: alone in chunks of a clip, or all people together.

Joints are (N, T, J, 3) metres with a mask (N, T); rows are the same person in prediction and truth. Joints that are not
finite are left out one by one, and frames that have none are no frames of a chunk. The usual code fits
a scale too and so hides a wrong one: every measure here is told whether it may.
"""

from collections.abc import Iterator

import numpy as np

from core_solver.evaluation.metrics import MILLIMETRES, Array, Mask, mean_or_none, usable_joints
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
    known = usable_joints(mask, predicted, true)
    measured = known.any(axis=-1)
    if not measured.any():
        return None
    return mean_or_none(
        _aligned(predicted[measured], true[measured], known[measured], slice(None), with_scale=with_scale)
    )


def _chunk_errors(predicted: Array, true: Array, mask: Mask, anchors: int, *, with_scale: bool) -> float | None:
    known = usable_joints(mask, predicted, true)
    errors = [
        _aligned(p[frames], t[frames], k[frames], slice(anchors), with_scale=with_scale)
        for p, t, k in zip(predicted, true, known, strict=True)
        for frames in _chunks(np.flatnonzero(k.any(axis=-1)))
    ]
    return mean_or_none(np.concatenate(errors)) if errors else None


def _chunks(frames: np.ndarray) -> Iterator[np.ndarray]:
    """Runs of 100 measured frames; a shorter rest goes with the last run, as in the usual code."""
    starts = list(range(0, max(len(frames) - CHUNK, 0) + 1, CHUNK))
    for start, stop in zip(starts, [*starts[1:], len(frames)], strict=True):
        if stop > start:
            yield frames[start:stop]


def _aligned(predicted: Array, true: Array, known: Mask, anchors: slice, *, with_scale: bool) -> Array:
    """Errors (K,) in millimetres of the known joints after the motion that fits those of the anchor frames best."""
    fixed = known[anchors]
    motion = fit_similarity(predicted[anchors][fixed], true[anchors][fixed], with_scale=with_scale)
    return np.linalg.norm(motion.apply(predicted[known]) - true[known], axis=-1) * MILLIMETRES
