"""How far the solved bodies lie from what the networks saw in the picture, where the observations are still there."""

import zipfile
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from core_solver.body.skeleton import joint_index, keypoint_index
from core_solver.camera import Camera, camera_from_model
from core_solver.errors import UserError
from core_solver.footage import move_points
from core_solver.perception.observations import Detection, FrameObservations
from core_solver.preview.bodies import PosablePerson
from core_solver.take import Take

Array = NDArray[np.float64]

# Joints that are image keypoints too: a take knows no others of the keypoints.
_LIMBS = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
_JOINTS = [joint_index(name) for name in _LIMBS]
_KEYPOINTS = [keypoint_index(name) for name in _LIMBS]
_SEEN = 0.1  # confidence below which a keypoint says nothing
_SAME_PERSON = 0.5  # of the body's extent in the picture: a sight farther away is somebody else
_NEAREST = 0.05  # metres in front of the lens
_DAMAGED = (OSError, ValueError, KeyError, TypeError, EOFError, IndexError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True)
class Reprojection:
    """How far solved joints lie from the keypoints seen.

    Attributes:
        pixels: (N, T) mean distance over the twelve joints of the limbs, weighted with the keypoints' confidence; NaN
            where nobody was seen there.
        sizes: (N, T) extent of the solved limbs in the picture, pixels; NaN where they are not in front of the lens.
    """

    pixels: Array
    sizes: Array


def read_reprojection(take: Take, work: Path) -> Reprojection | str:
    """Compare a take with the observations in its work directory.

    Returns:
        The comparison, or a sentence that says why there is none.
    """
    from core_solver.perception.cache import read_observations  # noqa: PLC0415 - brings the networks' runtime along

    if not work.is_dir():
        return f"The folder {work.name} with what the networks saw does not lie beside the take."
    try:
        return measure_reprojection(take, read_observations(work))
    except (UserError, *_DAMAGED):
        return f"What the networks saw is damaged or not finished in {work.name}."


def measure_reprojection(take: Take, observations: Iterable[FrameObservations]) -> Reprojection | str:
    """Compare a take with observations of its video; frames are told by their number.

    A sight carries no identity here: in each frame sights and people are paired so that the sum of distances is least,
    and a person without a sight nearby has no error.
    """
    camera = camera_from_model(take.meta.camera)
    limbs = [PosablePerson(person).joints()[:, _JOINTS] for person in take.people]
    pixels = np.full((len(take.people), take.frame_count), np.nan)
    sizes = np.full_like(pixels, np.nan)
    found = 0
    for seen in observations:
        frame, rest = divmod(seen.frame.index - take.meta.first_frame, take.meta.frame_step)
        if rest or not 0 <= frame < take.frame_count:
            continue
        found += 1
        drawn = [_project(joints[frame], camera) for joints in limbs]
        sizes[:, frame] = [np.hypot(*np.ptp(points, axis=0)) for points in drawn]
        pixels[:, frame] = _frame_errors(drawn, _steadied(seen.detections, take, frame))
    if found == 0:
        return "What the networks saw beside the take belongs to other frames."
    valid = np.array([person.valid for person in take.people], bool).reshape(pixels.shape)
    return Reprojection(np.where(valid, pixels, np.nan), sizes)


def _steadied(detections: tuple[Detection, ...], take: Take, frame: int) -> tuple[Detection, ...]:
    """Sights of the raw video where the take's camera would have seen them."""
    if take.steadying is None:
        return detections
    to_first = take.steadying[frame]
    return tuple(replace(d, keypoints=move_points(to_first, d.keypoints).astype(np.float32)) for d in detections)


def _project(joints: Array, camera: Camera) -> Array:
    """(12, 2) pixels, all NaN for a body that is not in front of the lens."""
    if joints[:, 2].min() <= _NEAREST:
        return np.full((len(joints), 2), np.nan)
    return camera.project(joints)


def _frame_errors(drawn: list[Array], detections: tuple[Detection, ...]) -> Array:
    """(N,) pixels, NaN for people without a sight nearby."""
    errors = np.full(len(drawn), np.nan)
    if not drawn or not detections:
        return errors
    limits = np.array([_SAME_PERSON * np.hypot(*np.ptp(points, axis=0)) for points in drawn])
    distances = np.array([[_distance(points, sight) for sight in detections] for points in drawn])
    allowed = distances < limits[:, None]
    # Forbidden pairs cost more than all allowed ones together, so that no allowed pair is given up for them.
    forbidden = 1.0 + float(distances[allowed].sum())
    people, sights = linear_sum_assignment(np.where(allowed, distances, forbidden))
    fine = allowed[people, sights]
    errors[people[fine]] = distances[people[fine], sights[fine]]
    return errors


def _distance(points: Array, sight: Detection) -> float:
    """Mean distance in pixels, weighted with confidence; infinite where nothing can be compared."""
    weight = np.where(sight.confidence[_KEYPOINTS] > _SEEN, sight.confidence[_KEYPOINTS], 0).astype(float)
    if weight.sum() == 0 or not np.isfinite(points).all():
        return np.inf
    return float(np.average(np.linalg.norm(points - sight.keypoints[_KEYPOINTS], axis=1), weights=weight))
