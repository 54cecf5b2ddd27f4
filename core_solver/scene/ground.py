"""Gravity and ground from everything that speaks of them: resting soles, the scene's floor, and bodies in balance.

The floor's plane and gravity are two things: people on a ramp stand upright on a slanting plane.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import GroundFrame

Array = NDArray[np.float64]

_FLOOR_COSINE = np.cos(np.radians(25))  # against the first guess, what faces up may be floor
_FLOOR_BAND = 0.1  # of the distance, about the first guess
_DEPTH_SIGMA = 0.02  # of the distance: how well a network's floor is a plane at best
_PATCH_M = 1.0
_PATCH_PER_HEIGHT = 0.5  # from a high camera floors are seen more coarsely
_FEWEST = 12  # points that make a patch
_TILT_BEST, _TILT_UNKNOWN = np.radians((1.0, 45.0))
_INVERSE_SHIFT = 0.02  # 1/metres by which a clip's depth range may be off: that tilts any plane
_PRIOR_TILT = np.radians(3)
_PRIOR_OFFSET = 0.1  # of the camera's height
_SOLE_SIGMA_M = 0.03
_PLACES = 12.0  # soles count as at most so many independent ones: each step is seen in many frames
_LEVEL_TILT = np.radians(2)  # of floors that are called level
_RAMP_TILT = np.radians(5)  # beyond that a plane is a ramp and says nothing about gravity
_ROUNDS = 20


@dataclass(frozen=True)
class GroundFit:
    """The ground with what is known about its quality.

    Attributes:
        ground: the plane people stand on, and gravity.
        tilt_sigma: radians, deviation of the plane's normal.
        cloud_tilt: radians between the scene's own plane and the result; NaN without a floor in the scene.
        cloud_sigma: radians, how well the scene's own plane is known: half of how its patches differ.
        inlier_share: of the scene's upward points near the ground that lie on the scene's own plane; 0 without.
    """

    ground: GroundFrame
    tilt_sigma: float
    cloud_tilt: float
    cloud_sigma: float
    inlier_share: float


@dataclass(frozen=True)
class CloudPlane:
    """A plane through the floor of a cloud.

    Attributes:
        slope: (2,) along the axes it was fitted in, against the first guess.
        covariance: (2, 2) of the slope.
        sigma: radians, without what the depth range may be off.
        inlier_share: of the points tried.
    """

    slope: Array
    covariance: Array
    sigma: float
    inlier_share: float


def fit_ground(
    prior: GroundFrame, soles: Array, rests: Array, points: Array | None = None, normals: Array | None = None
) -> GroundFit:
    """Ground plane and gravity by a robust fit to soles that rest and to the scene's floor.

    The plane is the compromise of three witnesses, each weighted by how well it knows: the soles by how well they lie
    in one plane, the scene by how flat its floor comes out and by how much a wrong depth range would tilt it, and the
    first guess by 3 degrees. Its height is that of the soles. Gravity follows the plane's normal as far as the plane is
    known well and level against the first guess; from a ramp it learns nothing.

    Args:
        prior: first guess, from balance and feet.
        soles: (M, 3) metres, lowest points of feet.
        rests: (M,) probability of resting on the ground.
        points: (P, 3) metres, static scene; None without.
        normals: (P, 3) unit normals of the points, NaN where unknown.

    Returns:
        The fit; the first guess itself where there is nothing to fit.
    """
    axes = _axes(prior.normal)
    cloud = None if points is None or normals is None else fit_cloud_plane(prior, points, normals)
    used = np.isfinite(soles).all(axis=1) & (rests > 0.5)
    slope, offset, covariance = _combine(prior, axes, soles[used], rests[used], cloud)
    tilted = prior.normal + axes @ slope
    length = float(np.linalg.norm(tilted))
    tilt_sigma = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    normal = tilted / length
    up = _gravity_up(-np.asarray(prior.gravity, float), normal, tilt_sigma)
    return GroundFit(
        GroundFrame(-up, normal, offset / length),
        tilt_sigma,
        cloud_tilt=float(np.linalg.norm(cloud.slope - slope)) if cloud else float("nan"),
        cloud_sigma=cloud.sigma if cloud else float(_TILT_UNKNOWN),
        inlier_share=cloud.inlier_share if cloud else 0.0,
    )


def fit_cloud_plane(prior: GroundFrame, points: Array, normals: Array) -> CloudPlane | None:
    """The plane of a scene's floor near a first guess: reweighted least squares, every patch of it counting alike.

    Args:
        prior: first guess.
        points: (P, 3) metres.
        normals: (P, 3).

    Returns:
        The plane; None when too little faces upward near the guess.
    """
    axes = _axes(prior.normal)
    distance = np.linalg.norm(points, axis=1)
    height = prior.height_above(points)
    with np.errstate(invalid="ignore"):
        floor = (normals @ prior.normal > _FLOOR_COSINE) & (np.abs(height) < _FLOOR_BAND * distance)
    if floor.sum() < _FEWEST:
        return None
    plan, height, sigma = points[floor] @ axes, height[floor], _DEPTH_SIGMA * distance[floor]
    size = max(_PATCH_M, _PATCH_PER_HEIGHT * prior.offset)
    patch = _patches(plan, size)
    evenly = 1 / np.bincount(patch)[patch]
    # height = level - slope . plan: a normal tilted towards x falls along x.
    design = np.concatenate([np.ones((len(plan), 1)), -plan], axis=1)
    answer = np.array([np.median(height), 0.0, 0.0])
    residual = np.zeros_like(height)
    for _ in range(_ROUNDS):
        residual = (height - design @ answer) / sigma
        weight = evenly / sigma**2 / (1 + (residual / 1.5) ** 2) ** 2
        answer = _solve(design, height, weight, np.diag([1e-9, 1e-9, 1e-9]) * weight.sum())[0]
    tilt = float(np.clip(_patch_tilt(plan, height, patch, answer[1:], size) / 2, _TILT_BEST, _TILT_UNKNOWN))
    # A shift of the inverse depth turns every plane into one that is tilted along the viewing direction.
    along = prior.offset * _INVERSE_SHIFT * axes[2]
    covariance = tilt**2 * np.eye(2) + np.outer(along, along)
    return CloudPlane(answer[1:], covariance, tilt, float((np.abs(residual) < 2).mean()))


def _axes(normal: Array) -> Array:
    """(3, 2) unit vectors in the plane."""
    side = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(normal, side)], axis=1)


def _patches(plan: Array, size: float) -> NDArray[np.int64]:
    """A number for each point's square of the plan."""
    column, row = np.floor((plan - plan.min(axis=0)) / size).astype(np.int64).T
    return np.unique((column << 32) + row, return_inverse=True)[1]


def _patch_tilt(plan: Array, height: Array, patch: NDArray[np.int64], slope: Array, size: float) -> float:
    """Root mean square of the angles between patches of a floor and its plane: a network's floors have waves."""
    tilts = []
    for index in np.flatnonzero(np.bincount(patch) >= _FEWEST):
        mine = patch == index
        place = plan[mine] - plan[mine].mean(axis=0)
        if np.linalg.eigvalsh(np.cov(place.T))[0] > (0.1 * size) ** 2:
            tilts.append(np.linalg.lstsq(-place, height[mine] - height[mine].mean(), rcond=None)[0] - slope)
    # Of a single patch nobody knows how it lies in the floor.
    return float(np.sqrt(np.mean(np.square(tilts)) * 2)) if len(tilts) > 1 else float(_TILT_UNKNOWN)


def _combine(
    prior: GroundFrame, axes: Array, soles: Array, rests: Array, cloud: CloudPlane | None
) -> tuple[Array, float, Array]:
    """Slope (2,) against the first guess, offset of normal + axes @ slope, and covariance (2, 2) of the slope."""
    precision = np.zeros((3, 3))
    precision[:2, :2] = np.eye(2) / _PRIOR_TILT**2
    precision[2, 2] = 1 / (_PRIOR_OFFSET * prior.offset) ** 2
    pull = np.array([0.0, 0.0, prior.offset * precision[2, 2]])
    if cloud is not None:
        information = np.linalg.inv(cloud.covariance)
        precision[:2, :2] += information
        pull[:2] += information @ cloud.slope
    # A sole on the plane: normal . x + slope . (axes . x) + offset = 0.
    design = np.concatenate([soles @ axes, np.ones((len(soles), 1))], axis=1)
    height = -(soles @ prior.normal)
    each = rests * min(1.0, _PLACES / max(float(rests.sum()), 1e-9))
    answer, covariance = _solve(design, height, np.zeros(len(soles)), precision, pull)
    for _ in range(_ROUNDS if len(soles) else 0):
        residual = height - design @ answer
        sigma = max(_SOLE_SIGMA_M, 1.4826 * float(np.median(np.abs(residual))))
        weight = each / sigma**2 / (1 + (residual / (2 * sigma)) ** 2) ** 2
        answer, covariance = _solve(design, height, weight, precision, pull)
    return answer[:2], float(answer[2]), covariance[:2, :2]


def _solve(
    design: Array, target: Array, weight: Array, precision: Array, pull: Array | float = 0.0
) -> tuple[Array, Array]:
    """Weighted least squares with a prior: answer (3,) and covariance (3, 3)."""
    square = (design * weight[:, None]).T @ design + precision
    answer = np.linalg.solve(square, design.T @ (weight * target) + pull)
    return answer.astype(np.float64), np.linalg.inv(square).astype(np.float64)


def _gravity_up(up: Array, normal: Array, tilt_sigma: float) -> Array:
    """Against gravity: between the first guess and the ground's normal."""
    apart = float(np.arccos(np.clip(up @ normal, -1, 1)))
    known = _PRIOR_TILT**2 / (_PRIOR_TILT**2 + tilt_sigma**2 + _LEVEL_TILT**2)
    share = known / (1 + (apart / _RAMP_TILT) ** 4)
    mixed = (1 - share) * up + share * normal
    return mixed / np.linalg.norm(mixed)
