"""3DPCK as MuPoTS-3D's own evaluation program computes it: matched in the image, bones of true length.

One frame at a time. Its 17 joints: top of the head, neck, right shoulder, elbow, wrist, the left three, right hip,
knee, ankle, the left three, pelvis, spine, head.
"""

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from core_solver.evaluation.metrics import Array, Mask, mean_or_none

PELVIS = 14
PARENTS = (1, 15, 1, 2, 3, 1, 5, 6, 14, 8, 9, 14, 11, 12, -1, 14, 1)
SCORED = 14  # the first fourteen joints count

_ORDER = (15, 1, 0, 16, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13)  # parents before children
_MATCHED_JOINTS = slice(1, 14)
_MATCH_PX = 40.0
_REACH_M = 0.15


class Mode(Enum):
    """Whether people whom nobody found count as wholly wrong or not at all."""

    ALL = "all"
    MATCHED = "matched"


def match_in_image(true: Array, visible: Mask, predicted: Array) -> NDArray[np.int64]:
    """Greedy matching of one frame: each true person in turn takes the free prediction with most joints nearby.

    A joint is nearby if it is visible and off by less than 40 pixels in both u and v.

    Args:
        true: (N, 17, 2) pixels.
        visible: (N, 17).
        predicted: (P, 17, 2) pixels.

    Returns:
        (N,) index of the prediction, -1 for nobody.
    """
    matches = np.full(len(true), -1)
    free = np.ones(len(predicted), bool)
    for person in range(len(true)):
        if not free.any():
            break
        near = (np.abs(predicted - true[person]) < _MATCH_PX).all(axis=-1) & visible[person]
        votes = np.where(free, near[:, _MATCHED_JOINTS].sum(axis=-1), 0)
        best = int(np.argmax(votes))
        if votes[best] > 0:
            matches[person], free[best] = best, False
    return matches


def rescale_bones(predicted: Array, true: Array) -> Array:
    """The predicted skeletons (..., 17, 3) with bones as long as the true ones, directions kept, pelvis in place."""
    rescaled = predicted.copy()
    for joint in _ORDER:
        parent = PARENTS[joint]
        bone = predicted[..., joint, :] - predicted[..., parent, :]
        length = np.linalg.norm(bone, axis=-1, keepdims=True)
        wanted = np.linalg.norm(true[..., joint, :] - true[..., parent, :], axis=-1, keepdims=True)
        rescaled[..., joint, :] = rescaled[..., parent, :] + bone * wanted / np.maximum(length, 1e-9)
    return rescaled


def official_hits(predicted: Array, true: Array, matches: NDArray[np.int64], mode: Mode) -> Mask:
    """Which joints of one frame are within 150 mm, relative to the pelvis and with true bone lengths.

    Args:
        predicted: (P, 17, 3) metres.
        true: (N, 17, 3) metres.
        matches: (N,) from `match_in_image`.
        mode: with `Mode.ALL` unmatched people count as misses, with `Mode.MATCHED` they are left out.

    Returns:
        (M, 14); the mean over all frames is the official 3DPCK.
    """
    matched = matches >= 0
    relative = true[matched] - true[matched][:, PELVIS, None]
    found = predicted[matches[matched]]
    found = rescale_bones(found - found[:, PELVIS, None], relative)
    hits = np.linalg.norm(found - relative, axis=-1)[:, :SCORED] < _REACH_M
    if mode is Mode.MATCHED:
        return hits
    all_hits = np.zeros((len(true), SCORED), bool)
    all_hits[matched] = hits
    return all_hits


@dataclass(frozen=True)
class OfficialScores:
    """3DPCK of a sequence.

    Attributes:
        all: missed people count as wholly wrong.
        matched: they are left out; None if nobody was matched.
    """

    all: float | None
    matched: float | None


def official_scores(
    true: Array, true_pixels: Array, present: Mask, predicted: Array, pixels: Array, found: Mask
) -> OfficialScores:
    """3DPCK of a whole sequence, matched in each frame anew.

    Args:
        true: (N, T, 17, 3) metres; the dataset's program compares with the skeletons of standard size.
        true_pixels: (N, T, 17, 2).
        present: (N, T) annotated.
        predicted: (P, T, 17, 3) metres.
        pixels: (P, T, 17, 2).
        found: (P, T).
    """
    hits: dict[Mode, list[Mask]] = {Mode.ALL: [], Mode.MATCHED: []}
    for frame in np.flatnonzero(present.any(axis=0)):
        here, seen = present[:, frame], found[:, frame]
        truth, guess = true[here, frame], predicted[seen, frame]
        # The program gives every annotated joint a vote, hidden ones too.
        votes = np.ones(truth.shape[:2], bool)
        matches = match_in_image(true_pixels[here, frame], votes, pixels[seen, frame])
        for mode, collected in hits.items():
            collected.append(official_hits(guess, truth, matches, mode))
    shares = {mode: mean_or_none(np.concatenate(each)) if each else None for mode, each in hits.items()}
    return OfficialScores(shares[Mode.ALL], shares[Mode.MATCHED])
