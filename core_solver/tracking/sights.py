"""One person seen once, and the measures by which two sights are compared. Pixels, seconds."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES, keypoint_index
from core_solver.perception.observations import CroppedMask, Detection, FrameObservations

Array = NDArray[np.float64]

_TORSO = [keypoint_index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "hip")]
_DUPLICATE_DISTANCE = 0.06  # of a person's size: two readings of one body agree better, two neighbours do not
_CONFIDENT = 0.2
_LOOKS_WITHOUT_MASK = 0.2
_MIN_SHARED_KEYPOINTS = 5


def _other_side(name: str) -> str:
    return name.replace("left_", "RIGHT_").replace("right_", "left_").replace("RIGHT_", "right_")


OTHER_SIDE = np.array([keypoint_index(_other_side(name)) for name in KEYPOINT_NAMES])
"""For each keypoint the one on the other side of the body."""


@dataclass(frozen=True, eq=False)
class Sight:
    """A detection and where it stands in the clip.

    Attributes:
        row: frame of the take.
        time: seconds.
        detection: what was seen.
        centre: (2,) middle of the torso; legs swing and boxes shrink behind furniture, torsos do neither.
        size: longer side of the box, the yardstick of every gate.
        looks: in [0, 1], how far the appearance can be trusted: without a mask it also shows what stands in front; 0
            where there is none.
    """

    row: int
    time: float
    detection: Detection
    centre: Array
    size: float
    looks: float


@dataclass(frozen=True, eq=False)
class FrameSights:
    """The different people of one frame.

    Attributes:
        sights: one a person, in an order that does not depend on the detector's.
        masks: of all detections, duplicates too: a better reading's mask may come from the worse one.
    """

    sights: tuple[Sight, ...]
    masks: tuple[CroppedMask, ...]


def frame_sights(observations: FrameObservations, row: int) -> FrameSights:
    """The people of a frame, each once."""
    detections = sorted(observations.detections, key=_canonical_key)
    sights = [_sight(d, row, observations.frame.time) for d in detections]
    return FrameSights(tuple(_without_duplicates(sights)), tuple(d.mask for d in detections))


def stacked(sights: Sequence[Sight], name: str) -> Array:
    """One field of the sights' detections, as (n, ...) float64."""
    return np.stack([getattr(sight.detection, name) for sight in sights]).astype(float)


def body_distances(
    keypoints_a: Array, confidence_a: Array, keypoints_b: Array, confidence_b: Array
) -> tuple[Array, Array]:
    """Mean distance of the keypoints two bodies share, weighted by both confidences, in pixels.

    Networks now and then take a person's front for the back: the same body then agrees only with its sides exchanged.

    Args:
        keypoints_a: (n, 25, 2).
        confidence_a: (n, 25).
        keypoints_b: (m, 25, 2).
        confidence_b: (m, 25).

    Returns:
        Distances as they are and with the sides of b exchanged, each (n, m); NaN where too few keypoints are shared.
    """
    direct = _keypoint_distances(keypoints_a, confidence_a, keypoints_b, confidence_b)
    exchanged = _keypoint_distances(keypoints_a, confidence_a, keypoints_b[:, OTHER_SIDE], confidence_b[:, OTHER_SIDE])
    return direct, exchanged


def box_overlaps(boxes_a: Array, boxes_b: Array) -> Array:
    """Intersection over union (n, m) of boxes (n, 4) and (m, 4)."""
    low = np.maximum(boxes_a[:, None, :2], boxes_b[None, :, :2])
    high = np.minimum(boxes_a[:, None, 2:], boxes_b[None, :, 2:])
    common = np.clip(high - low, 0, None).prod(-1)
    area_a, area_b = ((b[:, 2:] - b[:, :2]).prod(-1) for b in (boxes_a, boxes_b))
    union = area_a[:, None] + area_b[None] - common
    return common / np.where(union > 0, union, 1)


def _keypoint_distances(keypoints_a: Array, confidence_a: Array, keypoints_b: Array, confidence_b: Array) -> Array:
    apart = np.linalg.norm(keypoints_a[:, None] - keypoints_b[None], axis=-1)
    weight = confidence_a[:, None] * confidence_b[None]
    shared = ((confidence_a[:, None] > _CONFIDENT) & (confidence_b[None] > _CONFIDENT)).sum(-1)
    total = weight.sum(-1)
    mean = (apart * weight).sum(-1) / np.where(total > 0, total, 1)
    return np.where(shared >= _MIN_SHARED_KEYPOINTS, mean, np.nan)


def _canonical_key(detection: Detection) -> tuple[float, ...]:
    return (*map(float, detection.box), float(detection.score), *map(float, np.ravel(detection.keypoints)))


def _sight(detection: Detection, row: int, time: float) -> Sight:
    left, top, right, bottom = map(float, detection.box)
    weights = np.asarray(detection.confidence, float)[_TORSO]
    if weights.sum() > _CONFIDENT:
        centre = weights @ np.asarray(detection.keypoints, float)[_TORSO] / weights.sum()
    else:
        centre = np.array([left + right, top + bottom]) / 2
    looks = 1.0 if detection.mask.values.size else _LOOKS_WITHOUT_MASK
    looks *= float(np.any(detection.appearance))  # skeletons that other programs found come without clothes
    return Sight(row, float(time), detection, centre, max(right - left, bottom - top, 1.0), looks)


def _without_duplicates(sights: list[Sight]) -> list[Sight]:
    """Keep the best reading of every body: the surest one with the most keypoints.

    Two known identities are two people, however alike they stand, and go before what has none.
    """
    if len(sights) < 2:
        return sights
    keypoints, confidence = stacked(sights, "keypoints"), stacked(sights, "confidence")
    distance = np.fmin(*body_distances(keypoints, confidence, keypoints, confidence))
    sizes = np.array([s.size for s in sights])
    same = distance < _DUPLICATE_DISTANCE * np.minimum(sizes[:, None], sizes[None])
    same &= ~_known_apart([s.detection.identity for s in sights])
    worth = [s.detection.score * float(s.detection.confidence.sum()) for s in sights]
    kept: list[int] = []
    for candidate in sorted(range(len(sights)), key=lambda i: (sights[i].detection.identity is None, -worth[i])):
        if not same[candidate, kept].any():
            kept.append(candidate)
    return [sights[i] for i in sorted(kept)]


def _known_apart(identities: Sequence[int | None]) -> NDArray[np.bool_]:
    """(n, n) whether two are known to be different people."""
    numbers = np.array([-1 if i is None else i for i in identities])  # known ones are not negative
    known = numbers >= 0
    return known[:, None] & known[None] & (numbers[:, None] != numbers[None])
