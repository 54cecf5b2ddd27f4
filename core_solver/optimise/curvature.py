"""Gauss-Newton curvature of one person's energy, block by block.

Every robust term rho(|r|^2) contributes 2 rho' J^T J. Only the curvature is approximated here: the gradient comes from
the energies themselves, so that an error in this file can slow the solve down but not lead it astray.

Unknowns of a frame: 72 angles, then 3 of translation. Unknowns of the border: log scale, 10 betas, 3 of the ground, log
focal length.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from core_solver.body.jacobian_torch import levers, point_jacobian, shape_jacobian
from core_solver.energy.weights import Weights
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.picture_terms import ContourTerms, contour_rest
from core_solver.optimise.posing import PointSet, Posed
from core_solver.optimise.variables import Variables

FRAME = 75
OWN = 11  # of the border: the person's log scale and betas
SHARED = 4  # of the border: ground and focal length
BORDER = OWN + SHARED

_ANGLES = 72
_SCALE, _BETAS, _GROUND, _FOCAL = 0, slice(1, OWN), slice(OWN, OWN + 3), OWN + 3


@dataclass(frozen=True)
class Curvature:
    """Half the second derivatives of one person's energy.

    Attributes:
        blocks: (T, 75, 75) within each frame.
        next: (T - 1, 75, 75) of frame t + 1 (rows) with frame t (columns).
        after_next: (T - 2,) of the translations of frames t + 2 and t, the same for each axis.
        sides: (T, 75, 15) of each frame with the border.
        corner: (15, 15) of the border.
    """

    blocks: Tensor
    next: Tensor
    after_next: Tensor
    sides: Tensor
    corner: Tensor


@dataclass(frozen=True)
class _Rows:
    """Weighted rows of a frame's Jacobian: (T, M, 75) and (T, M, 15)."""

    frame: Tensor
    border: Tensor


@dataclass(frozen=True)
class _Moving:
    """Points at unit scale, camera frame: (T, P, 3), their Jacobians (T, P, 3, 75) and with betas (T, P, 3, 10)."""

    points: Tensor
    frame: Tensor
    betas: Tensor


def person_curvature(energy: JointEnergy, v: Variables, n: int) -> Curvature:
    """Curvature of `energy.person(v, n)`."""
    with torch.no_grad():
        return _Assembly(energy, v, n).curvature()


class _Assembly:
    def __init__(self, energy: JointEnergy, v: Variables, n: int) -> None:
        self._energy, self._v, self._n = energy, v, n
        self._posed = energy.posed(v, n)
        posed, joints = self._posed, energy.body.joints
        self._levers = levers(
            v.theta[n], posed.rotations[0], posed.positions[0], posed.rest_joints[0], joints.directions
        )
        body = energy.body
        self._followed, self._soles = self._carried(body.followed), self._carried(body.soles)

    @property
    def _weights(self) -> Weights:
        return self._energy.weights

    def curvature(self) -> Curvature:
        rows = [self._joint_rows(), *self._ground_rows(), *self._picture_rows()]
        frame, border = torch.cat([r.frame for r in rows], 1), torch.cat([r.border for r in rows], 1)
        blocks = frame.transpose(1, 2) @ frame
        sides = frame.transpose(1, 2) @ border
        flat = border.flatten(0, 1)
        corner = flat.T @ flat
        self._add_priors(blocks, corner)
        following, second = self._add_motion(blocks, sides, corner)
        return Curvature(blocks, following, second, sides, corner)

    def _carried(self, points: PointSet) -> _Moving:
        rest = points.rest(self._v.betas[self._n : self._n + 1])[0]
        return self._moving(rest, points.directions, points.weights)

    def _moving(self, rest: Tensor, directions: Tensor, weights: Tensor) -> _Moving:
        posed, frames = self._posed, len(self._levers.rotations)
        turned = point_jacobian(self._levers, rest, weights)
        each = Posed(posed.rotations, posed.positions, posed.rest_joints).skin_each(
            rest.expand(1, frames, -1, -1), weights.expand(1, frames, -1, -1)
        )[0]
        identity = torch.eye(3).to(turned).expand(*turned.shape[:2], 3, 3)
        points = each + self._v.translation[self._n][:, None]
        return _Moving(points, torch.cat([turned, identity], -1), shape_jacobian(self._levers, directions, weights))

    def _projected(self, moving: _Moving) -> tuple[Tensor, Tensor, Tensor]:
        """Rows of the projections: (T, P, 2, 75) pixels, (T, P, 2, 15), and the projections (T, P, 2)."""
        pixels = self._energy.project(self._v, moving.points)
        centre, z = self._energy.given.centre, moving.points[..., 2:].clamp_min(0.05)
        focal = (self._energy.given.focal * torch.exp(self._v.log_focal) / z)[..., None]
        slope = (moving.points[..., :2] / z)[..., None]

        def rows(jacobian: Tensor) -> Tensor:
            return focal * (jacobian[..., :2, :] - slope * jacobian[..., 2:, :])

        border = pixels.new_zeros(*pixels.shape, BORDER)
        border[..., _BETAS] = rows(moving.betas)
        if self._weights.focal_sigma > 0:
            border[..., _FOCAL] = pixels - centre
        return rows(moving.frame), border, pixels

    def _joint_rows(self) -> _Rows:
        w, given, n = self._weights, self._energy.given, self._n
        count = given.pixels.shape[2]
        frame, border, pixels = self._projected(_Moving(*(values[:, :count] for values in _fields(self._followed))))
        sigma = w.joints_sigma * given.size[n][:, None]
        residual = ((pixels - given.pixels[n]) / sigma[..., None]).square().sum(-1)
        weight = torch.sqrt(w.joints * given.confidence[n] * _charbonnier_slope(residual)) / sigma
        return _Rows(_weighted(frame, weight), _weighted(border, weight))

    def _ground_rows(self) -> list[_Rows]:
        motion, n, v, w = self._energy.motion, self._n, self._v, self._weights
        if motion.contacts is None or motion.support is None:
            return []
        sole_heights = self._energy.sole_heights(v, n, self._posed)[0]
        lowest, which = sole_heights.min(-1)
        count = sole_heights.shape[-1]
        index = which + torch.arange(2).to(which) * count
        chosen = _Moving(*(_take(values, index) for values in _fields(self._soles)))
        up, scale = self._energy.up(v), torch.exp(v.log_scale[n])
        heights, reach = (lowest - motion.support[n]) / scale, self._energy.reach(v, n)[0][:, None]
        near = (heights.abs() < reach).to(heights.dtype)
        contact = w.contact * motion.contacts[n] * near / w.contact_sigma**2
        contact = contact * _charbonnier_slope((heights / w.contact_sigma) ** 2)
        below = (heights.clamp_max(0) / reach) ** 2
        penetration = w.penetration * self._energy.given.valid[n][:, None] * (heights < 0) / (reach * (1 + below)) ** 2
        weight = torch.sqrt(contact + penetration)
        border = heights.new_zeros(*heights.shape, BORDER)
        border[..., _SCALE] = chosen.points @ up - heights
        border[..., _BETAS] = up @ chosen.betas
        distance = self._energy.given.offset * torch.exp(v.ground[2]) / scale
        tilts = chosen.points @ self._energy.given.up[1:].T
        border[..., _GROUND] = torch.cat([tilts, distance.expand(*heights.shape, 1)], -1)
        frame = up @ chosen.frame
        return [_Rows(frame * weight[..., None], border * weight[..., None])]

    def _picture_rows(self) -> list[_Rows]:
        picture, n, v, w = self._energy.motion.picture, self._n, self._v, self._weights
        if picture is None:
            return []
        body, scene = picture.depth.log_depths(v, n)
        weight = w.depth * (picture.depth.weight[n] * self._energy.given.per_clip[n]) / w.depth_sigma**2
        weight = torch.sqrt(weight * _charbonnier_slope(((body - scene)[0] / w.depth_sigma) ** 2))[:, None, None]
        border = weight.new_zeros(len(weight), 1, BORDER)
        border[..., _SCALE] = 1
        rows = [_Rows(picture.depth.body_rows[n][:, None] * weight, border * weight)]
        if picture.contours is not None and w.silhouette > 0:
            rows.append(self._contour_rows(picture.contours))
        return rows

    def _contour_rows(self, contours: ContourTerms) -> _Rows:
        n, v, w = self._n, self._v, self._weights
        sample = contour_rest(contours, self._energy.body, v.betas[n], n)
        frame, border, pixels = self._projected(self._moving(sample.rest, sample.directions, sample.weights))
        axis = contours.axis[n]
        along = torch.gather(pixels, -1, axis[..., None])[..., 0]
        sigma = w.silhouette_sigma * self._energy.given.size[n][:, None]
        residual = ((along - contours.target[n]) / sigma) ** 2
        weight = torch.sqrt(w.silhouette * contours.weight[n] * _charbonnier_slope(residual)) / sigma
        return _Rows(*(_pick(rows, axis) * weight[..., None] for rows in (frame, border)))

    def _add_priors(self, blocks: Tensor, corner: Tensor) -> None:
        w, given, n, v = self._weights, self._energy.given, self._n, self._v
        residual = ((v.theta[n] - given.theta_hat[n]) / w.theta_sigma).square().sum(-1)
        pose = w.smpl * given.theta_trust[n][:, None] * _charbonnier_slope(residual) / w.theta_sigma**2
        angles = torch.arange(_ANGLES)
        blocks[:, angles, angles] += pose.repeat_interleave(3, 1)
        own = torch.arange(1, OWN)
        corner[own, own] += w.betas * len(v.theta[n]) * _charbonnier_slope((v.betas[n] - given.betas_hat[n]) ** 2)
        height = corner.new_zeros(BORDER)
        height[_SCALE] = 1
        stature = given.height[1:] / (given.height[0] + given.height[1:] @ v.betas[n])
        height[_BETAS] = stature
        corner[_SCALE, _SCALE] += len(v.theta[n]) / w.guard_sigma**2
        corner += w.height * self._height_curvature() * torch.outer(height, height)
        corner[_BETAS, _BETAS] += w.betas * len(v.theta[n]) / w.stature_sigma**2 * torch.outer(stature, stature)

    def _height_curvature(self) -> Tensor:
        """Of the components of the mixture, as far as the person belongs to each."""
        log_height = self._energy.log_heights(self._v)[self._n]
        share, mean, sigma = log_height.new_tensor(self._weights.statures()).T
        logs = torch.log(share / sigma) - 0.5 * ((log_height - mean) / sigma) ** 2
        return (torch.softmax(logs, 0) / sigma**2).sum()

    def _add_motion(self, blocks: Tensor, sides: Tensor, corner: Tensor) -> tuple[Tensor, Tensor]:
        frames = len(blocks)
        following = blocks.new_zeros(max(frames - 1, 0), FRAME, FRAME)
        second = blocks.new_zeros(max(frames - 2, 0))
        if frames > 1:
            self._add_root_motion(blocks, following, second)
            self._add_point_motion(blocks, following, sides, corner)
        return following, second

    def _add_root_motion(self, blocks: Tensor, following: Tensor, second: Tensor) -> None:
        w, seconds = self._weights, self._energy.given.seconds
        place = torch.arange(_ANGLES, FRAME)
        stiffness = (w.speed / (w.speed_sigma * seconds) ** 2)[:, None]
        blocks[1:, place, place] += stiffness
        blocks[:-1, place, place] += stiffness
        following[:, place, place] -= stiffness
        if len(seconds) < 2:
            return
        translation = self._v.translation[self._n]
        middle = 0.5 * (seconds[1:] + seconds[:-1]) * w.acceleration_sigma
        rows = torch.stack([1 / seconds[:-1], -1 / seconds[:-1] - 1 / seconds[1:], 1 / seconds[1:]]) / middle
        stacked = torch.stack([translation[:-2], translation[1:-1], translation[2:]])
        change = (rows[..., None] * stacked).sum(0).square().sum(-1)
        weight = w.acceleration * _charbonnier_slope(change)
        for offset in range(3):
            inside = slice(offset, offset + len(change))
            blocks[inside, place, place] += (weight * rows[offset] ** 2)[:, None]
        following[:-1, place, place] += (weight * rows[0] * rows[1])[:, None]
        following[1:, place, place] += (weight * rows[1] * rows[2])[:, None]
        second += weight * rows[0] * rows[2]

    def _add_point_motion(self, blocks: Tensor, following: Tensor, sides: Tensor, corner: Tensor) -> None:
        """Temporal and slip: both tie the velocity of points between consecutive frames."""
        w, motion, n, seconds = self._weights, self._energy.motion, self._n, self._energy.given.seconds
        jacobians, shapes, weights = [], [], []
        if motion.filtered is not None and w.temporal > 0:
            points = self._followed.frame
            weight = w.temporal / (w.temporal_sigma * seconds) ** 2
            jacobians.append(points)
            shapes.append(self._followed.betas)
            weights.append(weight[:, None].expand(-1, points.shape[1]))
        if motion.contacts is not None and w.slip > 0:
            soles = self._soles
            count = soles.points.shape[1] // 2
            velocity = (soles.points[1:] - soles.points[:-1]) / (w.slip_sigma * seconds[:, None, None])
            both = (motion.contacts[n, 1:] * motion.contacts[n, :-1]).repeat_interleave(count, 1)
            weight = w.slip / count * both / (1 + velocity.square().sum(-1)) ** 2
            jacobians.append(soles.frame)
            shapes.append(soles.betas)
            weights.append(weight / (w.slip_sigma * seconds[:, None]) ** 2)
        if not jacobians:
            return
        jacobian = torch.cat(jacobians, 1)
        weight = torch.sqrt(torch.cat(weights, 1))[..., None, None]
        later, earlier = (jacobian[1:] * weight).flatten(1, 2), (jacobian[:-1] * weight).flatten(1, 2)
        blocks[1:] += later.transpose(1, 2) @ later
        blocks[:-1] += earlier.transpose(1, 2) @ earlier
        following -= later.transpose(1, 2) @ earlier
        # Where limbs swing, a longer one moves faster: shape is felt too.
        shape = torch.cat(shapes, 1)
        grown = ((shape[1:] - shape[:-1]) * weight).flatten(1, 2)
        sides[1:, :, _BETAS] += later.transpose(1, 2) @ grown
        sides[:-1, :, _BETAS] -= earlier.transpose(1, 2) @ grown
        flat = grown.flatten(0, 1)
        corner[_BETAS, _BETAS] += flat.T @ flat


def _fields(moving: _Moving) -> tuple[Tensor, Tensor, Tensor]:
    return moving.points, moving.frame, moving.betas


def _take(values: Tensor, index: Tensor) -> Tensor:
    """Rows `index` (T, 2) of values (T, P, ...)."""
    return values[torch.arange(len(values))[:, None].to(index), index]


def _pick(rows: Tensor, axis: Tensor) -> Tensor:
    """The u or the v row (T, S, C) of rows (T, S, 2, C)."""
    return torch.gather(rows, 2, axis[..., None, None].expand(-1, -1, 1, rows.shape[-1]))[:, :, 0]


def _weighted(rows: Tensor, weight: Tensor) -> Tensor:
    """(T, P, 2, C) rows times (T, P) weights as (T, 2 P, C)."""
    return (rows * weight[..., None, None]).flatten(1, 2)


def _charbonnier_slope(squared: Tensor) -> Tensor:
    """Derivative of the robust kernel with respect to the squared residual."""
    return torch.rsqrt(1 + squared)
