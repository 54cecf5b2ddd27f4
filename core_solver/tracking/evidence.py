"""Is it a person? Judged over all sights together: a single score tells nothing about signs, coats and reflections."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import keypoint_index
from core_solver.tracking.sights import Sight, stacked
from core_solver.tracking.tracklets import Tracklet

Array = NDArray[np.float64]

MIN_FRAMES = 8

_MIN_SCORE = 0.15
_MIN_CONFIDENCE = 0.15
# A poster or a coat on a stand moves less over the clip, in sizes, the noise of its reading included.
_STATIC_MOTION = 0.03
_STILL_LIMBS = 0.03  # sizes that the liveliest fifth of the joints moves around the torso
_STATIC_SCORE = 0.35  # below, whatever stands still is nobody
_STILL_SCORE = 0.5  # below, whatever stands still without moving a limb is nobody either
_ALIVE_SECONDS = 3.0  # within which somebody alive moves something
_CONFIDENT = 0.2
_REFLECTED = 0.7  # of the sights
_FEET_TOGETHER = 0.25  # sizes between somebody's feet and those of their reflection

_HEAD = [keypoint_index(f"{side}_{part}") for side in ("left", "right") for part in ("eye", "ear")]
_HIPS = [keypoint_index("left_hip"), keypoint_index("right_hip")]
_ANKLES = [keypoint_index("left_ankle"), keypoint_index("right_ankle")]


def mean_score(tracklet: Tracklet) -> float:
    """Mean detection score over the sights."""
    return float(np.mean([s.detection.score for s in tracklet.sights]))


def real_people(tracklets: Sequence[Tracklet]) -> list[Tracklet]:
    """Those that show a person and no lamp post, coat on a stand, reflection or flicker."""
    alive = [t for t in tracklets if is_alive(t)]
    upright = {s.row: [] for t in alive for s in t.sights}
    for sight in (s for t in alive for s in t.sights):
        if not _is_upside_down(sight):
            upright[sight.row].append(sight)
    return [t for t in alive if not _is_reflection(t, upright)]


def is_alive(tracklet: Tracklet) -> bool:
    """Whether something is sure enough, or moves its place or its limbs."""
    score = mean_score(tracklet)
    confidence = float(np.mean([s.detection.confidence for s in tracklet.sights]))
    if score < _MIN_SCORE or confidence < _MIN_CONFIDENCE:
        return False
    if score >= _STILL_SCORE or len(tracklet.sights) < MIN_FRAMES or _motion(tracklet) > _STATIC_MOTION:
        return True
    if score < _STATIC_SCORE:
        return False
    seconds = tracklet.sights[-1].time - tracklet.sights[0].time
    return seconds < _ALIVE_SECONDS or _limb_motion(tracklet) > _STILL_LIMBS


def _spread(values: Array) -> Array:
    """Robust spread over the first axis."""
    return np.percentile(values, 90, axis=0) - np.percentile(values, 10, axis=0)


def _motion(tracklet: Tracklet) -> float:
    """Spread of the place over the sights, in sizes."""
    return float(np.linalg.norm(_spread(np.stack([s.centre for s in tracklet.sights])))) / tracklet.last.size


def _limb_motion(tracklet: Tracklet) -> float:
    """Spread around the torso of the joints that move most, in sizes."""
    sights = tracklet.sights
    around = stacked(sights, "keypoints") - np.stack([s.centre for s in sights])[:, None]
    seen = np.mean(stacked(sights, "confidence") > _CONFIDENT, axis=0) > 0.5
    if not seen.any():
        return 0.0
    return float(np.percentile(np.linalg.norm(_spread(around), axis=-1)[seen], 80)) / tracklet.last.size


def _is_upside_down(sight: Sight) -> bool:
    return bool(_middle(sight, _HEAD)[1] > _middle(sight, _HIPS)[1])


def _is_reflection(tracklet: Tracklet, upright: dict[int, list[Sight]]) -> bool:
    """Whether it hangs head down from somebody's feet nearly all the time: a wet street or a polished floor."""
    hanging = [_is_upside_down(s) and any(_stand_on(s, other) for other in upright[s.row]) for s in tracklet.sights]
    return float(np.mean(hanging)) > _REFLECTED


def _stand_on(image: Sight, person: Sight) -> bool:
    apart = np.linalg.norm(_middle(image, _ANKLES) - _middle(person, _ANKLES))
    return bool(apart < _FEET_TOGETHER * max(image.size, person.size))


def _middle(sight: Sight, keypoints: list[int]) -> Array:
    return sight.detection.keypoints[keypoints].astype(float).mean(axis=0)
