"""How far people, their joints, sizes and order in depth are from the truth.

All functions take N people over T frames in the camera frame, metres, with row n of prediction and truth the same
person (`match_people` brings them together), and a mask (N, T) of the person-frames to measure. Entries that are not
finite count as missing. Distances come back in millimetres, shares in [0, 1]; None where there is nothing to measure.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from core_solver.body.skeleton import joint_index
from core_solver.geometry import fit_similarity

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MILLIMETRES = 1000.0

# Joints that stand for MuPoTS-3D's first fourteen; its top of the head has no joint here and is stood for by the head.
MUPOTS_14 = tuple(
    joint_index(name)
    for name in (
        "head", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
        "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle",
    )
)  # fmt: skip

_ROOT_REACH_M = 0.25
PCK_REACH_M = 0.15
_EQUAL_DEPTH_M = 0.3
_FEWEST_TO_ALIGN = 3
_SAME_PERSON_ANGLE = 0.15  # radians between viewing rays beyond which two people are not the same


def usable(mask: Mask, *points: Array) -> Mask:
    """The mask (N, T) without the entries where any of the points (N, T, ..., 3) is not finite."""
    for array in points:
        mask = mask & np.isfinite(array).all(axis=tuple(range(2, array.ndim)))
    return mask


def usable_joints(mask: Mask, *points: Array) -> Mask:
    """The mask (N, T) for each joint: (N, T, J) without those that are not finite in any of the points (N, T, J, 3)."""
    joints = np.broadcast_to(mask[..., None], points[0].shape[:3])
    for array in points:
        joints = joints & np.isfinite(array).all(axis=-1)
    return joints


def mean_or_none(values: Array | Mask) -> float | None:
    """The mean of any number of values, None of none."""
    return float(values.mean()) if values.size else None


def first_to_last(valid: Mask) -> Mask:
    """(T,) from the first to the last True."""
    return np.logical_or.accumulate(valid) & np.logical_or.accumulate(valid[::-1])[::-1]


def match_people(predicted: Array, true: Array, found: Mask, present: Mask) -> NDArray[np.int64]:
    """Which predicted person is which true one: the assignment with the smallest mean angle between viewing rays.

    Angles are compared because depth, what the metrics judge, must not decide who is who.

    Args:
        predicted: (P, T, 3) roots.
        true: (N, T, 3) roots.
        found: (P, T) where there is a prediction.
        present: (N, T) where there is truth.

    Returns:
        (N,) index of the predicted person, -1 where nobody fits.
    """
    matches = np.full(len(true), -1)
    if len(predicted) == 0 or len(true) == 0:
        return matches
    common = usable(found, predicted)[None] & usable(present, true)[:, None]
    cosine = np.einsum("ntc,ptc->npt", _directions(true), _directions(predicted))
    angles = np.where(common, np.arccos(np.clip(cosine, -1, 1)), 0)
    mean = angles.sum(axis=-1) / np.maximum(common.sum(axis=-1), 1)
    cost = np.where(common.any(axis=-1), mean, np.pi)
    rows, columns = linear_sum_assignment(cost)
    close = cost[rows, columns] < _SAME_PERSON_ANGLE
    matches[rows[close]] = columns[close]
    return matches


def _directions(points: Array) -> Array:
    finite = np.nan_to_num(points)
    return finite / np.maximum(np.linalg.norm(finite, axis=-1, keepdims=True), 1e-9)


def root_errors(predicted: Array, true: Array, mask: Mask) -> Array:
    """Distances (N, T) in millimetres of roots (N, T, 3); NaN where not measured, for plots."""
    measured = usable(mask, predicted, true)
    return np.where(measured, np.linalg.norm(predicted - true, axis=-1) * MILLIMETRES, np.nan)


def mrpe(predicted: Array, true: Array, mask: Mask) -> float | None:
    """Mean root position error: absolute, millimetres, of roots (N, T, 3)."""
    measured = usable(mask, predicted, true)
    return mean_or_none(np.linalg.norm(predicted[measured] - true[measured], axis=-1) * MILLIMETRES)


def ap25_matched(predicted: Array, true: Array, mask: Mask) -> float | None:
    """The released program's "AP25": the share of matched roots (N, T, 3) within 250 mm.

    People who were not found cost nothing; `average_precision` is the measure of that name.
    """
    measured = usable(mask, predicted, true)
    return mean_or_none(np.linalg.norm(predicted[measured] - true[measured], axis=-1) < _ROOT_REACH_M)


def average_precision(predicted: Array, scores: Array, found: Mask, true: Array, present: Mask) -> float | None:
    """RootNet's average precision of roots at 250 mm; needs no matching and punishes missed and invented people.

    Detections of all frames are sorted by score; one is a true positive if the nearest root of its frame that is not
    taken yet lies within 250 mm. Frames without truth are left out.

    Args:
        predicted: (P, T, 3).
        scores: (P, T) higher is surer.
        found: (P, T).
        true: (N, T, 3).
        present: (N, T).
    """
    present = usable(present, true)
    found = usable(found, predicted) & present.any(axis=0)
    if not present.any():
        return None
    people, frames = np.nonzero(found)
    order = np.argsort(-scores[people, frames], kind="stable")
    unused = present.copy()
    hits = np.zeros(len(order), bool)
    for rank, (person, frame) in enumerate(zip(people[order], frames[order], strict=True)):
        distance = np.linalg.norm(true[:, frame] - predicted[person, frame], axis=-1)
        distance = np.where(unused[:, frame], distance, np.inf)
        nearest = int(np.argmin(distance))
        if distance[nearest] < _ROOT_REACH_M:
            hits[rank] = True
            unused[nearest, frame] = False
    precision = np.cumsum(hits) / np.arange(1, len(hits) + 1)
    # Recall grows by one person at each hit, so the area under the curve is the sum of the precisions there.
    return float(precision[hits].sum() / present.sum())


def match_in_picture(
    predicted: Array, true: Array, found: Mask, present: Mask, reach_px: float = np.inf
) -> NDArray[np.int64]:
    """Which predicted person is which true one: the assignment with the smallest mean distance in the image.

    It needs no common intrinsics, which a take without calibration does not have, and depth, what is judged, has no
    say.

    Args:
        predicted: (P, T, 2) roots in pixels.
        true: (N, T, 2) roots in pixels.
        found: (P, T) where there is a prediction.
        present: (N, T) where there is truth.
        reach_px: people farther apart than this on average are not the same.

    Returns:
        (N,) index of the predicted person, -1 where nobody fits.
    """
    matches = np.full(len(true), -1)
    if len(predicted) == 0 or len(true) == 0:
        return matches
    common = usable(found, predicted)[None] & usable(present, true)[:, None]
    distances = np.where(common, np.linalg.norm(true[:, None] - predicted[None], axis=-1), 0)
    mean = distances.sum(axis=-1) / np.maximum(common.sum(axis=-1), 1)
    fits = common.any(axis=-1) & (mean <= reach_px)
    # A pair that cannot be costs more than all others together, so that it never keeps a possible one from its place.
    rows, columns = linear_sum_assignment(np.where(fits, mean, 1 + mean[fits].sum()))
    matches[rows] = np.where(fits[rows, columns], columns, -1)
    return matches


def pair_distance(predicted: Array, true: Array, mask: Mask) -> float | None:
    """Mean error of the distances between people, each pair in each frame, roots (N, T, 3). Millimetres."""
    measured = usable(mask, predicted, true)
    first, second = np.triu_indices(len(true), k=1)
    both = measured[first] & measured[second]
    distances = [np.linalg.norm(points[first] - points[second], axis=-1)[both] for points in (predicted, true)]
    return mean_or_none(np.abs(distances[0] - distances[1]) * MILLIMETRES)


def known_errors(predicted: Array, true: Array, mask: Mask) -> Array:
    """Distances (K,) in metres of all joints (N, T, J, 3) that both sides know; nothing is aligned."""
    known = usable_joints(mask, predicted, true)
    return np.linalg.norm(predicted[known] - true[known], axis=-1)


def relative_errors(predicted: Array, true: Array, mask: Mask, root: int = 0) -> Array:
    """Joint errors (M, J) in metres of the M measured person-frames, both skeletons moved to their root joint."""
    measured = usable(mask, predicted, true)
    p, t = predicted[measured], true[measured]
    return np.linalg.norm((p - p[:, root, None]) - (t - t[:, root, None]), axis=-1)


def mpjpe(predicted: Array, true: Array, mask: Mask) -> float | None:
    """Mean error of joints (N, T, J, 3) relative to the root joint 0, the root itself included as is usual."""
    return mean_or_none(relative_errors(predicted, true, mask) * MILLIMETRES)


def pck3d(predicted: Array, true: Array, mask: Mask, joints: tuple[int, ...] = MUPOTS_14) -> float | None:
    """3DPCK as in the paper: share of the joints (N, T, 24, 3) within 150 mm relative to the root, unscaled."""
    return mean_or_none(relative_errors(predicted, true, mask)[:, list(joints)] < PCK_REACH_M)


def pa_mpjpe(predicted: Array, true: Array, mask: Mask) -> float | None:
    """Mean joint error after the best similarity (never a reflection) of each person in each frame.

    Joints that one side does not know are left out; fewer than three fix no similarity, and the frame is left out.
    """
    known = usable_joints(mask, predicted, true)
    enough = known.sum(axis=-1) >= _FEWEST_TO_ALIGN
    errors = [
        _similarity_errors(p[seen], t[seen])
        for p, t, seen in zip(predicted[enough], true[enough], known[enough], strict=True)
    ]
    return mean_or_none(np.concatenate(errors) * MILLIMETRES) if errors else None


def _similarity_errors(predicted: Array, true: Array) -> Array:
    return np.linalg.norm(fit_similarity(predicted, true, with_scale=True).apply(predicted) - true, axis=-1)


def height_error(predicted: Array, true: Array) -> float | None:
    """Mean relative error of statures (N,); people without a finite one are left out."""
    known = np.isfinite(predicted) & np.isfinite(true)
    return mean_or_none(np.abs(predicted[known] - true[known]) / true[known])


def depth_order(predicted: Array, true: Array, mask: Mask) -> float | None:
    """Share of the pairs of people whose order in depth is right, roots (N, T, 3).

    A pair is nearer, farther, or equal within 300 mm of z.
    """
    measured = usable(mask, predicted, true)
    first, second = np.triu_indices(len(true), k=1)
    both = measured[first] & measured[second]
    orders = [_order(points[first, :, 2] - points[second, :, 2]) for points in (predicted, true)]
    return mean_or_none((orders[0] == orders[1])[both])


def _order(difference: Array) -> Array:
    return np.where(np.abs(difference) < _EQUAL_DEPTH_M, 0, np.sign(difference))
