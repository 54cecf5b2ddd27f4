"""Playing captured motion with somebody else's body: feet that rest in the capture rest exactly, flat on the ground."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from core_solver.body.skeleton import keypoint_index
from core_solver.evaluation.synthetic.legs import bend_legs, highest_pelvis
from core_solver.evaluation.synthetic.perform import Performance
from core_solver.evaluation.synthetic.physique import SIDES, Physique
from core_solver.evaluation.synthetic.recording import Recording
from core_solver.geometry import matrix_from_rotvec
from core_solver.optimise.limb_pose import limb_pose

Array = NDArray[np.float64]

_LOW_M, _SLOW_M_S, _SHORTEST_S = 0.06, 0.45, 0.12  # of an adult's resting foot


@dataclass(frozen=True)
class Replay:
    """A recording put somewhere on the flat ground.

    Attributes:
        recording: what was captured.
        begin: seconds of the recording at which the clip begins.
        start: (x, y) world metres of the mid-hips in the first frame.
        turn: radians by which the recording is turned about the vertical.
    """

    recording: Recording
    begin: float
    start: tuple[float, float]
    turn: float

    def keypoints(self, person: Physique, times: Array) -> Array:
        """(T, 25, 3) world metres for a person's size; heights from an arbitrary zero."""
        points = person.leg * self.recording.at(self.begin + times)
        points = points @ matrix_from_rotvec([0.0, 0.0, self.turn]).T
        hips = points[0, _both("hip")].mean(axis=0)
        return points + np.append(np.array(self.start) - hips[:2], 0.0)

    def track(self, person: Physique, times: Array) -> Array:
        """(T, 2) where the mid-hips go."""
        return self.keypoints(person, times)[:, _both("hip"), :2].mean(axis=1)


def _both(part: str) -> list[int]:
    return [keypoint_index(f"{side}_{part}") for side in SIDES]


def replay(plan: Replay, person: Physique, times: Array) -> Performance:
    """Joint rotations of a replay; the floor is at height 0."""
    rate = 1 / float(np.median(np.diff(times))) if len(times) > 1 else 30.0
    points = gaussian_filter1d(plan.keypoints(person, times), 0.02 * rate, axis=0, mode="nearest")
    ankle = points[:, _both("ankle")]
    # Whoever captured this stood on a floor: feet at their lowest are flat on it.
    floor = np.quantile(ankle[..., 2], 0.05, axis=0) - person.ankle_height
    points[..., 2] -= floor.mean()
    ankle, heading, pitch = _rest_feet(points, person, times)
    foot = _foot_rotations(heading, pitch)
    ankle = _lift_out_of_floor(ankle, foot, person)
    rotations = matrix_from_rotvec(limb_pose(points, person.keypoints, person.joints))
    hips = points[:, _both("hip")].mean(axis=1)
    root = rotations[:, 0]
    to_pelvis = -np.mean([person.bone(f"{side}_hip", "pelvis") for side in SIDES], axis=0)
    wanted = hips + root @ to_pelvis
    height = highest_pelvis(wanted[:, :2], wanted[:, 2], ankle, root, person, rate)
    pelvis = np.column_stack([wanted[:, :2], height])
    bend_legs(rotations, pelvis, ankle, foot, np.zeros((len(times), 2)), person)
    return Performance(rotations, pelvis)


def _rest_feet(points: Array, person: Physique, times: Array) -> tuple[Array, Array, Array]:
    """Ankles (T, 2, 3), headings and heel rises (T, 2) in which resting feet do not move."""
    ankle, toe = points[:, _both("ankle")].copy(), points[:, _both("toe")]
    along = toe - ankle
    heading = np.unwrap(np.arctan2(along[..., 1], along[..., 0]), axis=0)
    slope = np.arctan2(along[..., 2], np.linalg.norm(along[..., :2], axis=-1))
    pitch = np.median(slope, axis=0) - slope
    for side in (0, 1):
        values = np.column_stack([ankle[:, side], heading[:, side], pitch[:, side]])
        rests = _resting(ankle[:, side], person.ankle_height[side], person.leg / 0.85, times)
        values += _corrections(values, rests, float(person.ankle_height[side]), times)
        ankle[:, side], heading[:, side], pitch[:, side] = values[:, :3], values[:, 3], values[:, 4]
    return ankle, heading, pitch


def _resting(ankle: Array, height: float, size: float, times: Array) -> list[slice]:
    """Spans of frames in which a foot is low and slow."""
    if len(times) < 3:
        return [slice(0, len(times))]
    speed = np.linalg.norm(np.gradient(ankle, times, axis=0), axis=1)
    still = (speed < _SLOW_M_S * size) & (ankle[:, 2] < height + _LOW_M * size)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], still, [0]])))
    spans = [slice(start, stop) for start, stop in zip(edges[::2], edges[1::2], strict=True)]
    return [span for span in spans if times[span.stop - 1] - times[span.start] >= _SHORTEST_S]


def _corrections(values: Array, rests: list[slice], height: float, times: Array) -> Array:
    """What to add to place, heading and heel rise (T, 5): constant values in every rest, smooth in between."""
    correction = np.zeros_like(values)
    known = np.zeros(len(values), bool)
    for span in rests:
        goal = values[span].mean(axis=0)
        goal[2], goal[4] = height, 0.0
        correction[span], known[span] = goal - values[span], True
    rows = np.flatnonzero(known)
    if len(rows) == 0:
        return correction
    for before, after in pairwise(rows):
        u = ((times[before:after] - times[before]) / (times[after] - times[before]))[:, None]
        s = u**3 * (10 - 15 * u + 6 * u**2)
        if after > before + 1:
            correction[before:after] = (1 - s) * correction[before] + s * correction[after]
    correction[: rows[0]], correction[rows[-1] :] = correction[rows[0]], correction[rows[-1]]
    return correction


def _foot_rotations(heading: Array, pitch: Array) -> Array:
    """(T, 2, 3, 3) from the rest axes (left, up, front): turned to the heading, toes down by the heel's rise."""
    cosine, sine, zero = np.cos(heading), np.sin(heading), np.zeros_like(heading)
    flat = np.stack([-sine, zero, cosine, cosine, zero, sine, zero, zero + 1, zero], axis=-1)
    turn = matrix_from_rotvec(pitch[..., None] * np.array([1.0, 0.0, 0.0]))
    return flat.reshape(*heading.shape, 3, 3) @ turn


def _lift_out_of_floor(ankle: Array, foot: Array, person: Physique) -> Array:
    """Raise feet whose heel or toes would be below the floor."""
    ends = np.stack([
        [[0.0, -height, -heel], [0.0, -height, toe]]
        for height, heel, toe in zip(person.ankle_height, person.heel, person.toe, strict=True)
    ])  # fmt: skip
    lowest = (np.einsum("tfij,fkj->tfki", foot, ends)[..., 2] + ankle[..., None, 2]).min(axis=-1)
    lifted = ankle.copy()
    lifted[..., 2] += np.maximum(-lowest, 0)
    return lifted
