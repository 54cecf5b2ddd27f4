"""How people move and stand: jitter, sliding feet, contacts, and feet in the floor.

Arrays are N people over T frames, camera frame, metres, with a mask (N, T) of the person-frames to measure.
"""

import numpy as np

from core_solver.evaluation.metrics import MILLIMETRES, Array, Mask, mean_or_none, usable, usable_joints
from core_solver.evaluation.truth import Scenery

_PENETRATION_M = 0.005


def jitter_paper(predicted: Array, true: Array, mask: Mask) -> float | None:
    """The paper's smoothness error: mean | |step of truth| - |step of prediction| | of joints (N, T, J, 3).

    Millimetres a frame. It compares lengths only and is blind to direction.
    """
    measured = _runs(usable_joints(mask, predicted, true), 2)
    steps = [np.linalg.norm(np.diff(joints, axis=1), axis=-1)[measured] for joints in (predicted, true)]
    return mean_or_none(np.abs(steps[0] - steps[1]) * MILLIMETRES)


def jitter_wham(predicted: Array, mask: Mask, frame_rate: float) -> float | None:
    """WHAM's jitter: mean length of the joints' third differences times frame rate cubed, over ten (10 m/s^3).

    Args:
        predicted: (N, T, J, 3).
        mask: (N, T).
        frame_rate: frames a second.
    """
    measured = _runs(usable_joints(mask, predicted), 4)
    jerks = np.linalg.norm(np.diff(predicted, n=3, axis=1), axis=-1)[measured]
    return mean_or_none(jerks * frame_rate**3 / 10)


def foot_skate(soles: Array, contacts: Mask, mask: Mask) -> float | None:
    """Millimetres a frame that vertices under a foot move while the true foot rests.

    Args:
        soles: (N, T, 2, S, 3) predicted vertices under the left and the right foot.
        contacts: (N, T, 2) true contacts; a step counts when both its frames are in contact.
        mask: (N, T).
    """
    measured = usable(mask, soles)
    resting = contacts & measured[..., None]
    steps = np.linalg.norm(np.diff(soles, axis=1), axis=-1)
    return mean_or_none(steps[resting[:, 1:] & resting[:, :-1]] * MILLIMETRES)


def penetration(vertices: Array, scenery: Scenery, mask: Mask) -> float | None:
    """Mean depth in millimetres of those vertices (N, T, P, 3) that lie more than 5 mm below the scene; 0 if none do.

    The mean runs over the penetrating vertices alone: `penetration_share` says how many they are.
    """
    heights = _heights(vertices, scenery, mask)
    if heights.size == 0:
        return None
    return mean_or_none(-heights[heights < -_PENETRATION_M] * MILLIMETRES) or 0.0


def penetration_share(vertices: Array, scenery: Scenery, mask: Mask) -> float | None:
    """Share of the vertices (N, T, P, 3) that lie more than 5 mm below the scene."""
    return mean_or_none(_heights(vertices, scenery, mask) < -_PENETRATION_M)


def contact_f1(predicted: Array, true: Mask, mask: Mask) -> float | None:
    """F1 score of contacts (N, T, 2), both feet together, predicted where the probability is above one half.

    None where neither truth nor prediction knows a contact.
    """
    claimed, real = predicted[mask] > 0.5, true[mask]
    hits, either = int((claimed & real).sum()), int(claimed.sum() + real.sum())
    return 2 * hits / either if either else None


def _heights(vertices: Array, scenery: Scenery, mask: Mask) -> Array:
    measured = usable(mask, vertices)
    points = vertices[measured]
    return scenery.height_above(points) if points.size else np.zeros(0)


def _runs(mask: Mask, length: int) -> Mask:
    """(N, T - length + 1, ...) from (N, T, ...): where `length` frames in a row are in the mask."""
    count = max(mask.shape[1] - length + 1, 0)
    runs = np.ones((len(mask), count, *mask.shape[2:]), bool)
    for shift in range(length):
        runs &= mask[:, shift : shift + count]
    return runs
