"""What a solve is judged by, against the truth of a synthetic clip."""

import numpy as np

from core_solver.body import kinematics
from core_solver.body.model import BodyModel
from core_solver.optimise.solution import Solution
from tests.solver.scenes import SyntheticClip

Array = np.ndarray


def solved_joints(solution: Solution, body: BodyModel) -> Array:
    """(N, T, 24, 3) metres, camera frame."""
    return _posed(solution, body, lambda _betas, _rotations, positions, _rest: positions)


def solved_vertices(solution: Solution, body: BodyModel) -> Array:
    """(N, T, V, 3) metres, camera frame."""

    def vertices(betas, rotations, positions, rest):
        return kinematics.skin(body.rest_vertices(betas), body.weights, rotations, positions, rest)

    return _posed(solution, body, vertices)


def _posed(solution: Solution, body: BodyModel, points) -> Array:
    people = []
    for n, betas in enumerate(solution.betas):
        rest = body.rest_joints(betas)
        rotations, positions = kinematics.pose_joints(solution.theta[n], rest)
        metric = solution.scales[n] * points(betas, rotations, positions, rest)
        people.append(metric + solution.gamma[n][:, None])
    return np.stack(people)


def mpjpe(joints: Array, clip: SyntheticClip, scales: Array) -> Array:
    """(N, T) mean error of joints relative to the pelvis, at unit scale, metres."""
    found = (joints - joints[:, :, :1]) / scales[:, None, None, None]
    truth = (clip.joints - clip.joints[:, :, :1]) / clip.scales[:, None, None, None]
    return np.linalg.norm(found - truth, axis=-1).mean(axis=-1)


def jitter(joints: Array, rate: float = 25.0) -> float:
    """Mean third difference, m/s^3 / 10."""
    return float(np.linalg.norm(np.diff(joints, 3, axis=1), axis=-1).mean() * rate**3 / 10)


def all_finite(solution: Solution) -> bool:
    ground = solution.ground
    arrays = (
        solution.theta, solution.gamma, solution.betas, solution.scales, solution.confidence, solution.contacts,
        solution.inverse_far, solution.inverse_gap, ground.gravity, ground.normal, ground.offset,
    )  # fmt: skip
    return all(np.isfinite(array).all() for array in arrays)
