"""From a person's sights to arrays over the whole clip: gaps are filled smoothly and carry no evidence."""

import numpy as np
from numpy.typing import NDArray

from core_solver.tracking.evidence import mean_score
from core_solver.tracking.identities import Somebody
from core_solver.tracking.repair import outlier_factor, swap_flipped_sides
from core_solver.tracking.sights import stacked
from core_solver.tracking.tracklets import End, Tracklet, state_at_end, state_at_start
from core_solver.tracking.tracks import Track

Array = NDArray[np.float64]

_HALF = 0.5


def fill_track(somebody: Somebody, track_id: int, times: Array) -> Track:
    """Arrays over all frames of one person.

    Args:
        somebody: the sights and the name.
        track_id: positive.
        times: (T,) seconds.
    """
    person = somebody.tracklet
    rows = np.array([s.row for s in person.sights])
    sizes = np.array([s.size for s in person.sights])
    keypoints, landmarks = stacked(person.sights, "keypoints"), stacked(person.sights, "landmarks")
    seen_confidence = stacked(person.sights, "confidence")

    adjacent = _have_both_neighbours(rows)
    order = swap_flipped_sides(keypoints, seen_confidence, sizes, times[rows])
    keypoints = np.take_along_axis(keypoints, order[..., None], axis=1)
    landmarks = np.take_along_axis(landmarks, order[..., None], axis=1)
    seen_confidence = np.take_along_axis(seen_confidence, order, axis=1)
    seen_confidence *= outlier_factor(keypoints, sizes, adjacent)

    confidence = np.zeros((len(times), seen_confidence.shape[1]), np.float32)
    confidence[rows] = seen_confidence
    valid = np.zeros(len(times), bool)
    valid[rows] = True
    filled = _filled_keypoints(keypoints, person, rows, times)
    filled[rows] = keypoints  # exactly what was seen, without rounding
    regressed = np.array([s.detection.regressed for s in person.sights])
    landmarks, regressed = _known_landmarks(landmarks, regressed, rows, times)
    return Track(
        id=track_id,
        valid=valid,
        keypoints=filled.astype(np.float32),
        confidence=confidence,
        landmarks=landmarks.astype(np.float32),
        score=mean_score(person),
        name=somebody.name,
        regressed=regressed,
    )


def _known_landmarks(
    landmarks: Array, regressed: NDArray[np.bool_], rows: NDArray[np.int64], times: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """Landmarks (T, 25, 3), and (T,) whether they are regressed, from those of the n sights that have some.

    Zeros where no sight has. Between sights of both kinds the nearer one's kind counts.
    """
    known = np.isfinite(landmarks).all(axis=(1, 2))
    if not known.any():
        return np.zeros((len(times), *landmarks.shape[1:])), np.zeros(len(times), bool)
    rows = rows[known]
    return _held(landmarks[known], rows, times), _held(regressed[known].astype(float), rows, times) > _HALF


def _have_both_neighbours(rows: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(n,) whether the frames right before and right after each sight are sights too."""
    step = np.diff(rows, prepend=rows[0] - 9, append=rows[-1] + 9)
    return (step[:-1] == 1) & (step[1:] == 1)


def _filled_keypoints(keypoints: Array, person: Tracklet, rows: NDArray[np.int64], times: Array) -> Array:
    """Keypoints (T, 25, 2): in a gap the body glides on a cubic that keeps the motion of both its ends.

    Only the torso's path bends; how the limbs lie around it changes linearly. A slope for every keypoint would follow
    the noise of two single frames.
    """
    centres = np.stack([s.centre for s in person.sights])
    path = _held(centres, rows, times)
    for before in np.flatnonzero(np.diff(rows) > 1):
        gap = slice(rows[before] + 1, rows[before + 1])
        leaving = state_at_end(person.sights[: before + 1])
        returning = state_at_start(person.sights[before + 1 :])
        path[gap] = _glide(leaving, returning, times[gap])
    around = _held(keypoints - centres[:, None], rows, times)
    return path[:, None] + around


def _glide(leaving: End, returning: End, times: Array) -> Array:
    """Cubic Hermite curve (n, 2) between two ends."""
    start, stop = leaving.sight, returning.sight
    span = stop.time - start.time
    u = ((times - start.time) / span)[:, None]
    from_start = (1 + 2 * u) * start.centre + u * span * leaving.velocity
    from_stop = (3 - 2 * u) * stop.centre - (1 - u) * span * returning.velocity
    return (1 - u) ** 2 * from_start + u**2 * from_stop


def _held(values: Array, rows: NDArray[np.int64], times: Array) -> Array:
    """Values (n, ...) at `rows` to (T, ...): linear in the gaps, the nearest value outside."""
    flat = values.reshape(len(rows), -1)
    filled = np.stack([np.interp(times, times[rows], column) for column in flat.T], axis=-1)
    return filled.reshape(len(times), *values.shape[1:])
