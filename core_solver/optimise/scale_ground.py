"""Statures, ground and depth range together, before any pose is refined.

One camera cannot tell a near child from a far adult. What can: everybody stands on one ground, bodies balance over
their feet, people have human statures, and a depth network orders things. Few unknowns, so one robust fit does it.
"""

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

from core_solver.energy import terms
from core_solver.energy.residuals import saturated, softened
from core_solver.energy.weights import Weights
from core_solver.geometry import align_vectors, matrix_from_rotvec
from core_solver.scene.edges import UprightCues
from core_solver.scene.sampling import BodyDepth, FloorSamples

Array = NDArray[np.float64]

_GROUND_SIGMA = 0.02  # of the camera's height: how flat a floor is, and how well soles are found
_LEVEL_DIFFERENCE_M = 0.03  # between people side by side
_LEVEL_SLOPE = 0.03  # and for every metre between them: steps, kerbs and platforms are common
_OTHER_FLOOR = 6.0  # deviations at which a different floor is believed
_PIT = 1.05  # by which a floor below the common ground is less likely than one above: people climb on things
_BALANCE_SIGMA = math.radians(6)  # one person's mean lean in the estimated pose
_CUE_SIGMA = math.radians(0.5)  # of one upright edge
_HORIZON_SIGMA = math.radians(30)  # cameras are held roughly level
_FLOOR_SIGMA = 0.20  # log depth of a network on a floor
_SHALLOWEST = 3.0  # a scene's farthest point is about so many times as far away as its nearest, or more
_SHALLOW_SIGMA = 0.35  # of the log of that
_LOG_INVERSE_DEPTHS = (-math.log(1000.0), -math.log(0.05))  # a network's far end may be beyond all measure
_OTHER_SIZES = (0.75, 1.33)
_LOG_SIZES = (-5.0, 7.0)  # of scales, and of the camera's height in metres
_LIMITS = (200.0, 8.0)  # where residuals level off, in their deviations


@dataclass(frozen=True)
class ScaleProblem:
    """What the fit looks at; everything at unit scale, camera frame.

    Attributes:
        soles: (N, T, 2, 3) metres, mean sole point of each foot.
        planted: (N, T, 2) probability of being on the ground.
        balance: (N, 3) unit vectors from support to centre of mass, time-averaged; zeros when unknown.
        heights: (N,) statures in metres at unit scale.
        log_depth: (N, T) mean log depth of the visible vertices.
        body_depth: disparity under them.
        floor: disparity of the floor around feet.
        cues: what else in the scene tells where up is.
    """

    soles: Array
    planted: Array
    balance: Array
    heights: Array
    log_depth: Array
    body_depth: BodyDepth
    floor: FloorSamples
    cues: UprightCues | None = None


@dataclass(frozen=True)
class ScaleGround:
    """The answer.

    Attributes:
        scales: (N,) person scales.
        up: (3,) unit normal of the ground, camera frame.
        offset: metres; normal . x + offset = 0 on the ground.
        levels: (N,) metres by which each person's own floor lies above the common ground.
        inverse_far: 1 / z_far, 1/metres.
        inverse_gap: 1 / z_near - 1 / z_far, 1/metres.
    """

    scales: Array
    up: Array
    offset: float
    levels: Array
    inverse_far: float
    inverse_gap: float


def fit_scale_ground(problem: ScaleProblem, weights: Weights) -> ScaleGround:
    """Solve for the ground plane, all statures and the clip's depth range.

    Args:
        problem: evidence at unit scale.
        weights: deviations of statures and depth.

    Returns:
        The robust least-squares solution; with no planted foot the ground follows from balance alone.
    """
    start_up = mean_up(problem.balance)
    frame = align_vectors([0.0, 1.0, 0.0], start_up)
    has_depth = bool(problem.body_depth.mean_disparity.any())
    people = len(problem.heights)
    level_sigma = _level_sigma(problem.soles)

    def unpack(x: Array) -> ScaleGround:
        up = frame @ matrix_from_rotvec([x[0], 0.0, x[1]]) @ [0.0, 1.0, 0.0]
        scales, levels, depth_range = np.split(x[3:], [people, 2 * people])
        far, gap = np.exp(np.clip(depth_range, *_LOG_INVERSE_DEPTHS)) if has_depth else (0.01, 0.5)
        # A step too far must be a bad answer, not an overflow.
        sizes = np.exp(np.clip(np.concatenate([x[2:3], scales]), *_LOG_SIZES))
        return ScaleGround(sizes[1:], up, float(sizes[0]), levels, float(far), float(gap))

    def residuals(x: Array, limit: float) -> Array:
        answer = unpack(x)
        parts = [
            _ground_residuals(problem, answer, weights, limit),
            _balance_residuals(problem, answer),
            _cue_residuals(problem, answer),
            np.array([math.acos(float(np.clip(-answer.up[1], -1, 1))) / _HORIZON_SIGMA]),
            # Somebody on a roof may be as high as they are.
            np.where(answer.levels < 0, _PIT, 1.0) * saturated(answer.levels / level_sigma, _OTHER_FLOOR),
        ]
        if has_depth:
            parts += [_depth_residuals(problem, answer, weights), _floor_residuals(problem, answer, weights, limit)]
            parts.append(_range_residual(answer))
        # Statures have their own distribution: a giant must not be excused as an outlier.
        return np.concatenate([softened(np.concatenate(parts)), _height_residuals(problem, answer, weights)])

    def fit(x: Array, limits: tuple[float, ...]) -> tuple[float, Array]:
        cost = math.inf
        for limit in limits:
            solution = least_squares(residuals, x, args=(limit,), x_scale="jac", max_nfev=100)
            cost, x = float(solution.cost), solution.x
        return cost, x

    depth_start = _depth_start(problem) if has_depth else []
    solutions = []
    for scales, levels, camera_height in _starts(problem, start_up, weights):
        x = np.concatenate([[0.0, 0.0, math.log(camera_height)], np.log(scales), levels, depth_start])
        # First everybody is pulled into place from however far, then what does not belong there lets go; or, where the
        # beginning is nearly right, at once.
        solutions += [fit(x, _LIMITS), fit(x, _LIMITS[-1:])]
    best = min(solutions, key=lambda s: s[0])[1]
    # The picture is the same at every size of the world: a family may be taken for a group of giants.
    others = [_resized(best, people, factor) for factor in _OTHER_SIZES]
    others.append(_on_lowest_floor(best, people))
    solutions += [fit(x, _LIMITS[-1:]) for x in others]
    return unpack(min(solutions, key=lambda s: s[0])[1])


def _resized(x: Array, people: int, factor: float) -> Array:
    """The unknowns of the same scene in another size."""
    grown = x.copy()
    grown[2 : 3 + people] += math.log(factor)
    grown[3 + people : 3 + 2 * people] *= factor
    grown[3 + 2 * people :] -= math.log(factor)
    return grown


def _on_lowest_floor(x: Array, people: int) -> Array:
    """The unknowns of the same scene with its ground where the lowest person stands."""
    lowered = x.copy()
    levels = lowered[3 + people : 3 + 2 * people]
    lowered[2] = math.log(max(math.exp(min(x[2], _LOG_SIZES[1])) - levels.min(), 0.1))
    levels -= levels.min()
    return lowered


def _starts(problem: ScaleProblem, up: Array, weights: Weights) -> list[tuple[Array, Array, float]]:
    """Two beginnings as scales, levels and camera height: all on one floor, and each of average height on their own."""
    people = len(problem.heights)
    below = [
        float(np.median(sole_depths[planted])) if (planted := trust > 0.5).any() else 1.6
        for sole_depths, trust in zip(-(problem.soles @ up), problem.planted, strict=True)
    ]
    common = float(np.clip(np.median(below), 0.2, 100))
    scales = weights.height_mean_m / problem.heights
    own = scales * np.array(below)
    camera_height = float(np.clip(np.median(own), 0.2, 100))
    return [(np.ones(people), np.zeros(people), common), (scales, camera_height - own, camera_height)]


def mean_up(balance: Array) -> Array:
    """Unit vector (3,) that people's bearings (N, 3) agree on; the camera's own up where nobody's is known."""
    known = balance[np.linalg.norm(balance, axis=1) > 0.5]
    total = known.sum(axis=0)
    length = float(np.linalg.norm(total))
    return total / length if length > 1e-6 else np.array([0.0, -1.0, 0.0])


def _depth_start(problem: ScaleProblem) -> list[float]:
    seen = problem.body_depth.weight > 0
    inverse = np.exp(-problem.log_depth[seen])
    disparity = problem.body_depth.mean_disparity[seen]
    slope, level = np.polyfit(disparity, inverse, 1) if np.ptp(disparity) > 0.05 else (0.0, 0.0)
    nearest = float(np.median(inverse) / max(float(np.median(disparity)), 0.05))
    return [math.log(max(level, 0.01)), math.log(slope if slope > 0.05 * nearest else nearest)]


def _ground_residuals(problem: ScaleProblem, answer: ScaleGround, weights: Weights, limit: float) -> Array:
    """Planted soles lie on the plane; a foot may hang above it, so only the lower foot of a frame counts fully."""
    heights = answer.scales[:, None, None] * (problem.soles @ answer.up) + answer.offset - answer.levels[:, None, None]
    lowest = heights.min(axis=-1, keepdims=True)
    trust = problem.planted * (heights < lowest + 0.04)
    total = trust.sum(axis=(1, 2), keepdims=True)
    share = np.sqrt(weights.effective_samples * trust / np.maximum(total, 1e-9))
    relative = heights / (_GROUND_SIGMA * _camera_heights(answer)[:, None, None])
    return (share * _bounded(relative, limit)).ravel()


def _camera_heights(answer: ScaleGround) -> Array:
    """(N,) metres above each person's own floor; never nothing, whatever the search tries."""
    return np.maximum(answer.offset - answer.levels, 0.02 * answer.offset)


def _bounded(residual: Array, limit: float) -> Array:
    """Large residuals level off: a jump or a chair must not drag the plane."""
    return limit * np.tanh(residual / limit)


def _level_sigma(soles: Array) -> Array:
    """How far each person's floor may lie from the others', metres: flat nearby, less so farther away."""
    places = np.median(soles.mean(axis=2), axis=1)
    apart = np.linalg.norm(places - np.median(places, axis=0), axis=-1)
    return _LEVEL_DIFFERENCE_M + _LEVEL_SLOPE * apart


def _height_residuals(problem: ScaleProblem, answer: ScaleGround, weights: Weights) -> Array:
    log_heights = torch.as_tensor(np.log(answer.scales * problem.heights))
    costs = terms.height(log_heights, log_heights.new_tensor(weights.statures())).clamp_min(0).numpy()
    return math.sqrt(weights.height) * np.sign(log_heights.numpy() - math.log(weights.height_mean_m)) * np.sqrt(costs)


def _balance_residuals(problem: ScaleProblem, answer: ScaleGround) -> Array:
    known = np.linalg.norm(problem.balance, axis=1) > 0.5
    across = np.cross(problem.balance[known], answer.up)
    return (across / _BALANCE_SIGMA).ravel()


def _cue_residuals(problem: ScaleProblem, answer: ScaleGround) -> Array:
    cues = problem.cues
    return np.zeros(0) if cues is None else np.sqrt(cues.weights) * (cues.normals @ answer.up) / _CUE_SIGMA


def _depth_residuals(problem: ScaleProblem, answer: ScaleGround, weights: Weights) -> Array:
    """One residual a person, so that whoever stands before a wall the network got wrong can be doubted whole."""
    inverse = answer.inverse_far + answer.inverse_gap * problem.body_depth.mean_disparity
    difference = problem.log_depth + np.log(answer.scales)[:, None] + np.log(inverse)
    weight = problem.body_depth.weight
    seen = weight.sum(axis=1)
    mean = (weight * difference).sum(axis=1) / np.maximum(seen, 1e-9)
    return math.sqrt(weights.depth * weights.effective_samples) * mean / weights.depth_sigma


def _range_residual(answer: ScaleGround) -> Array:
    """No scene is a wall: two people equally far away, one of whom the network got wrong, must not make it one."""
    reach = math.log1p(answer.inverse_gap / answer.inverse_far)
    return np.array([max(math.log(_SHALLOWEST) - reach, 0.0) / _SHALLOW_SIGMA])


def _floor_residuals(problem: ScaleProblem, answer: ScaleGround, weights: Weights, limit: float) -> Array:
    floor = problem.floor
    if len(floor.disparity) == 0:
        return np.zeros(0)
    slope = np.maximum(-(floor.rays @ answer.up), 1e-3)
    # Who stands on a roof has the roof about their feet.
    log_depth = np.log(_camera_heights(answer)[floor.people] / slope)
    difference = log_depth + np.log(answer.inverse_far + answer.inverse_gap * floor.disparity)
    share = math.sqrt(weights.depth * weights.effective_samples / len(difference))
    return share * _bounded(difference / _FLOOR_SIGMA, limit)
