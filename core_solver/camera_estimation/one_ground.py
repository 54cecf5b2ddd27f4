"""How well people fit into one world: upright, of human stature, on one ground before a camera held roughly level."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from core_solver.camera_estimation.bystanders import Bystanders
from core_solver.energy.residuals import saturated, softened
from core_solver.energy.weights import Weights
from core_solver.geometry import align_vectors

Array = NDArray[np.float64]

# Deviations, measured on synthetic clips with the errors of real networks.
_LEAN_SIGMA = math.radians(8)  # of one person's body towards or from the camera, as landmarks have it
_SIDEWAYS_BIAS = math.radians(2.2)  # of one person's direction in the picture, over the clip
_SIDEWAYS_SIGMA = math.radians(3)  # about that, in each part of the clip
_GROUND_SIGMA = 0.03  # of the camera's height
_ROLL_SIGMA = math.radians(5)  # of cameras
_PITCH_SIGMA = math.radians(30)
_LEVEL_SIGMA_M = 0.03  # between the floors of people side by side, and for every metre between them
_OTHER_FLOOR = 4.0  # deviations at which a different floor is believed
_LANDMARK_STATURE_M = 1.65  # of the average body that landmarks show
_LIMITS = (200.0, 3.0)  # first everybody is pulled into place, then who stands on a step lets go
_EVALUATIONS = 40
_EVALUATIONS_NEARBY = 15


@dataclass(frozen=True)
class Fit:
    """A world for one focal length.

    Attributes:
        cost: half the sum of squares of everything that does not fit.
        up: (3,) unit vector, camera frame.
        rest: (1 + 3 N,) log of the camera's height, log scales, floors in metres, sideways leans in radians.
    """

    cost: float
    up: Array
    rest: Array


def fit_world(people: Bystanders, near: Fit | None = None) -> Fit:
    """The best world.

    Args:
        people: through a lens of a given focal length.
        near: where to begin, such as the world of a similar focal length; None for a search of its own.
    """
    problem = _Problem(people)
    if near is not None:
        return problem.fit(near, _LIMITS[1:], _EVALUATIONS_NEARBY)
    return min((problem.fit(start, _LIMITS) for start in problem.starts()), key=lambda fit: fit.cost)


class _Problem:
    """Residuals over two slopes of up against the first guess, then `Fit.rest`."""

    def __init__(self, people: Bystanders) -> None:
        self._people = people
        self._count = len(people.soles)
        self._known = np.linalg.norm(people.balance, axis=1) > 0.5
        places = np.median(people.soles.mean(axis=2), axis=1)
        apart = np.linalg.norm(places - np.median(places, axis=0), axis=-1)
        self._level_sigma = _LEVEL_SIGMA_M * (1 + apart)
        self._weights = Weights()
        self._statures = np.array(self._weights.statures()).T

    def starts(self) -> list[Fit]:
        """All of average size, and as they must be sized to stand on one floor."""
        total = self._people.balance.sum(axis=0)
        length = float(np.linalg.norm(total))
        up = total / length if length > 0.1 else np.array([0.0, -1.0, 0.0])
        below = np.array(
            [
                float(np.median(-(soles @ up)[trust > 0.5])) if (trust > 0.5).any() else 1.6
                for soles, trust in zip(self._people.soles, self._people.planted, strict=True)
            ]
        )
        height = float(np.clip(np.median(below), 0.2, 100))
        sizes = np.clip(height / np.maximum(below, 0.1), 0.5, 1.3)
        return [
            Fit(math.inf, up, np.concatenate([[math.log(height)], np.log(scales), np.zeros(2 * self._count)]))
            for scales in (np.ones(self._count), sizes)
        ]

    def fit(self, start: Fit, limits: tuple[float, ...], evaluations: int = _EVALUATIONS) -> Fit:
        frame = align_vectors([0.0, 1.0, 0.0], start.up)
        x, cost = np.concatenate([np.zeros(2), start.rest]), math.inf
        for limit in limits:
            answer = least_squares(self._residuals, x, args=(frame, limit), x_scale="jac", max_nfev=evaluations)
            x, cost = answer.x, float(answer.cost)
        return Fit(cost, _up(frame, x), x[2:])

    def _residuals(self, x: Array, frame: Array, limit: float) -> Array:
        up = _up(frame, x)
        log_scales, floors, leans = np.split(x[3:], 3)
        # A step too far must be a bad answer, not an overflow.
        height, scales = math.exp(np.clip(x[2], -5, 7)), np.exp(np.clip(log_scales, -5, 5))
        doubtful = np.concatenate(
            [
                self._ground(up, height, scales, floors, limit),
                self._leaning(up),
                self._sideways(up, leans),
                [math.asin(np.clip(up[0], -1, 1)) / _ROLL_SIGMA, math.asin(np.clip(up[2], -1, 1)) / _PITCH_SIGMA],
                saturated(floors / self._level_sigma, _OTHER_FLOOR),
            ]
        )
        return np.concatenate([softened(doubtful), leans / _SIDEWAYS_BIAS, self._sizes(log_scales)])

    def _ground(self, up: Array, height: float, scales: Array, floors: Array, limit: float) -> Array:
        """Planted soles lie on their person's floor; of two feet only the lower one counts."""
        heights = scales[:, None, None] * (self._people.soles @ up) + height - floors[:, None, None]
        trust = self._people.planted * (heights < heights.min(axis=-1, keepdims=True) + 0.04)
        total = trust.sum(axis=(1, 2), keepdims=True)
        share = np.sqrt(self._weights.effective_samples * trust / np.maximum(total, 1e-9))
        return (share * limit * np.tanh(heights / (_GROUND_SIGMA * height * limit))).ravel()

    def _leaning(self, up: Array) -> Array:
        """Towards the camera or away from it, which only landmarks tell."""
        towards = self._people.towards[self._known]
        ahead = towards - (towards @ up)[:, None] * up
        length = np.sqrt((ahead**2).sum(axis=-1))
        return (self._people.balance[self._known] * ahead).sum(axis=-1) / np.maximum(length, 1e-9) / _LEAN_SIGMA

    def _sideways(self, up: Array, leans: Array) -> Array:
        """In the picture, where verticals converge when the camera looks down."""
        angle = np.arcsin(np.clip(self._people.sideways @ up, -1, 1)) - leans[:, None]
        return (np.sqrt(self._people.share) * angle / _SIDEWAYS_SIGMA).ravel()

    def _sizes(self, log_scales: Array) -> Array:
        """Statures of adults and of children; a mixture, so that a child costs little and a giant much."""
        share, mean, sigma = self._statures
        heights = log_scales[:, None] + math.log(_LANDMARK_STATURE_M)
        logs = np.logaddexp.reduce(np.log(share / sigma) - 0.5 * ((heights - mean) / sigma) ** 2, axis=-1)
        return np.sqrt(2 * np.maximum(np.log(share / sigma).max() - logs, 0))


def _up(frame: Array, x: Array) -> Array:
    """The first guess, tilted by two slopes."""
    tilted = frame @ np.array([x[0], 1.0, x[1]])
    return tilted / math.sqrt(tilted @ tilted)
