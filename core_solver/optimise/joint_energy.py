"""E_I and E_II of all people with their constants on the device: values by person, one coupling being the scene.

Raster terms are used as they are linearised about the poses of the last look at the picture (`PictureTerms`); all other
terms are exact.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.model import BodyModel
from core_solver.camera import Camera
from core_solver.energy import terms
from core_solver.energy.kernels import charbonnier
from core_solver.energy.weights import Weights
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.picture_terms import PictureTerms, contour_points
from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import Posed, TorchBody
from core_solver.optimise.scale_ground import ScaleGround
from core_solver.optimise.variables import Variables, pose_person

Array = NDArray[np.float64]

CONTACT_REACH = 0.03  # of the distance
DEPTH_RANGE_SIGMA = 0.05  # a frame's log z_near and z_far about the clip's: networks jitter that much

_FILLED_TRUST = 0.3  # theta^ of a frame without evidence keeps the motion plausible
_NEAREST_M = 0.05
_ARMS_LENGTH_M = 2.5  # of two people together


@dataclass(frozen=True)
class Given:
    """What the energies compare with, one row for each person; tensors on the device.

    Attributes:
        pixels: (N, T, 25, 2) undistorted.
        confidence: (N, T, 25).
        size: (N, T) pixels.
        valid: (N, T).
        seconds: (T - 1,).
        theta_hat: (N, T, 24, 3).
        theta_trust: (N, T).
        betas_hat: (N, 10).
        height: (11,) stature in metres is height[0] + height[1:] . betas.
        per_clip: (N, 1) what persists over a clip counts as a few measurements, whatever its length.
        focal: (2,) pixels.
        centre: (2,) pixels.
        up: (3, 3) rows: the first ground's normal and two axes on the ground.
        offset: () metres from the camera to the first ground.
        log_scale: (N,) the first scales.
    """

    pixels: Tensor
    confidence: Tensor
    size: Tensor
    valid: Tensor
    seconds: Tensor
    theta_hat: Tensor
    theta_trust: Tensor
    betas_hat: Tensor
    height: Tensor
    per_clip: Tensor
    focal: Tensor
    centre: Tensor
    up: Tensor
    offset: Tensor
    log_scale: Tensor


@dataclass(frozen=True)
class Motion:
    """What stage II and the looks between iterations add; None switches a term off.

    Attributes:
        contacts: (N, T, 2) probability that a foot stands on its support.
        support: (N, T, 2) metres by which each foot's support lies above the common ground.
        filtered: (N, T, P, 3) one-euro-filtered `TorchBody.followed` at unit scale.
        picture: raster terms.
        spheres: (N, T, M, 3) metres, camera frame: where everybody was at the last look.
    """

    contacts: Tensor | None = None
    support: Tensor | None = None
    filtered: Tensor | None = None
    picture: PictureTerms | None = None
    spheres: Tensor | None = None


class JointEnergy:
    """The energy of a clip; `motion` is replaced as the solve goes on."""

    def __init__(self, given: Given, body: TorchBody, weights: Weights) -> None:
        self.given, self.body, self.weights = given, body, weights
        self.motion = Motion()
        self._posed: dict[int, tuple[Variables, Posed]] = {}

    @property
    def people(self) -> int:
        """N."""
        return len(self.given.pixels)

    def look(self, **changes: Tensor | PictureTerms | None) -> None:
        """Use other contacts, support, filtered points or raster terms from now on."""
        self.motion = replace(self.motion, **changes)

    def value(self, v: Variables) -> float:
        """E at these variables."""
        with torch.no_grad():
            return float(self.shared(v)) + sum(float(self.person(v, n)) for n in range(self.people))

    def posed(self, v: Variables, n: int) -> Posed:
        """One person's posed joints; asked again about the same variables without gradients, the same answer."""
        if torch.is_grad_enabled():
            return pose_person(v, n, self.body)
        last = self._posed.get(n)
        if last is None or last[0] is not v:
            last = v, pose_person(v, n, self.body)
            self._posed[n] = last
        return last[1]

    def person(self, v: Variables, n: int) -> Tensor:
        """All terms of one person."""
        posed = self.posed(v, n)
        return torch.stack(list(self.person_terms(v, n, posed).values())).sum()

    def person_terms(self, v: Variables, n: int, posed: Posed) -> dict[str, Tensor]:
        """Each weighted term of one person, named as its weight."""
        one, w, g = slice(n, n + 1), self.weights, self.given
        shift = v.translation[one, :, None]
        followed = posed.skin(self.body.followed, v.betas[one]) + shift
        keypoints = followed[:, :, : g.pixels.shape[2]]
        result = {
            "joints": w.joints
            * terms.joints(self.project(v, keypoints), g.pixels[one], g.confidence[one], g.size[one], w.joints_sigma),
            "smpl": w.smpl * terms.smpl(v.theta[one], g.theta_hat[one], g.theta_trust[one], w.theta_sigma),
            "betas": w.betas * v.theta.shape[1] * self._shape(v, one),
            "guard": terms.guard(v.log_scale[one] - g.log_scale[one], w.guard_sigma) * v.theta.shape[1],
            "height": w.height * terms.height(self.log_heights(v)[one], v.betas.new_tensor(w.statures())).sum(),
        }
        if len(g.seconds):
            result["speed"] = w.speed * terms.speed(v.translation[one], g.seconds, w.speed_sigma)
        if len(g.seconds) > 1:
            result["acceleration"] = w.acceleration * terms.acceleration(
                v.translation[one], g.seconds, w.acceleration_sigma
            )
        result["collision"] = self._collision(v, n, posed)
        return result | self._ground_terms(v, n, posed) | self._motion_terms(followed, n) | self._picture(v, n, posed)

    def shared(self, v: Variables) -> Tensor:
        """Terms of the scene alone: the depth range's ties over time, the ground's and the focal length's priors."""
        w = self.weights
        ground = terms.guard(v.ground, v.ground.new_tensor([w.tilt_sigma, w.tilt_sigma, w.guard_sigma]))
        ground = ground * v.theta.shape[0] * v.theta.shape[1]
        focal = (v.log_focal / w.focal_sigma) ** 2 if w.focal_sigma > 0 else v.log_focal * 0
        ties = torch.stack([v.log_inverse_far, v.log_inverse_gap], -1) - v.log_range
        jitter = charbonnier((ties / DEPTH_RANGE_SIGMA) ** 2).sum() * self.given.per_clip.mean()
        return ground + focal + (w.depth > 0) * jitter

    def project(self, v: Variables, points: Tensor) -> Tensor:
        """Pixels (..., 2) of camera-frame points at any scale."""
        g = self.given
        focal = g.focal * torch.exp(v.log_focal) if self.weights.focal_sigma > 0 else g.focal
        return points[..., :2] / points[..., 2:].clamp_min(_NEAREST_M) * focal + g.centre

    def log_heights(self, v: Variables) -> Tensor:
        """(N,) log metres."""
        return self._log_stature(v.betas) + v.log_scale

    def _log_stature(self, betas: Tensor) -> Tensor:
        """(N,) log metres at unit scale."""
        return torch.log((self.given.height[0] + betas @ self.given.height[1:]).clamp_min(0.1))

    def _shape(self, v: Variables, one: slice) -> Tensor:
        betas, betas_hat = v.betas[one], self.given.betas_hat[one]
        growth = self._log_stature(betas) - self._log_stature(betas_hat)
        return terms.shape(betas, betas_hat) + terms.stature(growth, self.weights.stature_sigma)

    def up(self, v: Variables) -> Tensor:
        """(3,) unit normal of the ground."""
        normal, first, second = self.given.up
        tilted = normal + v.ground[0] * first + v.ground[1] * second
        return tilted / tilted.norm()

    def sole_heights(self, v: Variables, n: int, posed: Posed) -> Tensor:
        """(1, T, 2, S) height of each foot's sole points above the common ground, metres."""
        one = slice(n, n + 1)
        soles = posed.skin(self.body.soles, v.betas[one]) + v.translation[one, :, None]
        heights = torch.exp(v.log_scale[n]) * (soles @ self.up(v)) + self.given.offset * torch.exp(v.ground[2])
        return heights.unflatten(2, (2, -1))

    def reach(self, v: Variables, n: int) -> Tensor:
        """(1, T) how far from the ground a sole is still tied to it, at unit scale: far feet are known less well."""
        return (CONTACT_REACH * v.translation[n : n + 1, :, 2].detach()).clamp_min(terms.CONTACT_RANGE_M)

    def _ground_terms(self, v: Variables, n: int, posed: Posed) -> dict[str, Tensor]:
        contacts, support = self.motion.contacts, self.motion.support
        if contacts is None or support is None:
            return {}
        w, one = self.weights, slice(n, n + 1)
        # In bodies, not metres: contact must not be bought by shrinking the scene.
        lowest = (self.sole_heights(v, n, posed).amin(-1) - support[one]) / torch.exp(v.log_scale[n])
        reach = self.reach(v, n)
        return {
            "contact": w.contact * terms.contact(lowest, contacts[one], reach, w.contact_sigma),
            "penetration": w.penetration * terms.penetration(lowest, self.given.valid[one], reach),
            "slip": self._slip(v, n, posed, contacts[one]),
        }

    def _slip(self, v: Variables, n: int, posed: Posed, contacts: Tensor) -> Tensor:
        w, one = self.weights, slice(n, n + 1)
        if not len(self.given.seconds):
            return v.betas.new_zeros(())
        soles = posed.skin(self.body.soles, v.betas[one]) + v.translation[one, :, None]
        return w.slip * terms.slip(soles.unflatten(2, (2, -1)), contacts, self.given.seconds, w.slip_sigma)

    def _motion_terms(self, followed: Tensor, n: int) -> dict[str, Tensor]:
        if self.motion.filtered is None or not len(self.given.seconds):
            return {}
        w, filtered = self.weights, self.motion.filtered[n : n + 1]
        return {"temporal": w.temporal * terms.temporal(followed, filtered, self.given.seconds, w.temporal_sigma)}

    def spheres(self, v: Variables, n: int, posed: Posed) -> Tensor:
        """(1, T, M, 3) metres, camera frame: one person's spheres."""
        one = slice(n, n + 1)
        return torch.exp(v.log_scale[n]) * (posed.skin(self.body.spheres, v.betas[one]) + v.translation[one, :, None])

    def _collision(self, v: Variables, n: int, posed: Posed) -> Tensor:
        """A body with itself, and with the others where they were seen last."""
        w, others = self.weights, self.motion.spheres
        if w.collision == 0:
            return v.betas.new_zeros(())
        centres = self.spheres(v, n, posed)
        radii = self.body.radii * torch.exp(v.log_scale[n].detach())
        first, second = self.body.pairs.T
        apart = torch.cdist(centres, centres)[:, :, first, second]
        value = terms.collision(radii[first] + radii[second] - apart, w.collision_sigma)
        for other, there in enumerate(others if others is not None else ()):
            if other != n and self._may_meet(centres[0, :, 0], there[:, 0]):
                reach = radii[:, None] + self.body.radii * torch.exp(v.log_scale[other].detach())
                apart = torch.cdist(centres, there[None])
                value = value + terms.collision((reach - apart).flatten(2), w.collision_sigma)
        return w.collision * value

    @staticmethod
    def _may_meet(roots: Tensor, others: Tensor) -> bool:
        """Whether two people's roots (T, 3) ever come within arms' length of each other."""
        return bool(((roots - others).detach().square().sum(-1) < _ARMS_LENGTH_M**2).any())

    def _picture(self, v: Variables, n: int, posed: Posed) -> dict[str, Tensor]:
        picture = self.motion.picture
        if picture is None:
            return {}
        w, one = self.weights, slice(n, n + 1)
        body, scene = picture.depth.log_depths(v, n)
        weight = picture.depth.weight[one] * self.given.per_clip[one]
        result = {"depth": w.depth * terms.depth(body, scene, weight, w.depth_sigma)}
        if picture.contours is not None:
            points = contour_points(picture.contours, self.body, v, n, posed)
            along = torch.gather(self.project(v, points), -1, picture.contours.axis[one, ..., None])[..., 0]
            result["silhouette"] = w.silhouette * terms.silhouette(
                along, picture.contours.target[one], picture.contours.weight[one],
                w.silhouette_sigma * self.given.size[one],
            )  # fmt: skip
        return result


def given_evidence(
    evidence: Evidence, fit: PoseFit, ground: ScaleGround, camera: Camera, body: BodyModel, solver_body: TorchBody,
    weights: Weights,
) -> Given:  # fmt: skip
    """Everything the energies compare with, on the solver's device."""
    like = solver_body.keypoints.template

    def tensor(values: NDArray) -> Tensor:
        return torch.as_tensor(np.array(values, dtype=np.float64), dtype=like.dtype, device=like.device)

    frames = np.maximum(evidence.valid.sum(axis=1, keepdims=True), 1)
    return Given(
        pixels=tensor(evidence.pixels),
        confidence=tensor(evidence.confidence),
        size=tensor(evidence.size),
        valid=tensor(evidence.valid),
        seconds=tensor(evidence.seconds),
        theta_hat=tensor(fit.theta),
        theta_trust=tensor(np.where(evidence.valid, 1.0, _FILLED_TRUST)),
        betas_hat=tensor(fit.betas),
        height=tensor(_linear_height(body)),
        per_clip=tensor(np.minimum(weights.effective_samples / frames, 1.0)),
        focal=tensor(np.array([camera.fx, camera.fy])),
        centre=tensor(np.array([camera.cx, camera.cy])),
        up=tensor(_axes(ground.up)),
        offset=tensor(np.array(ground.offset)),
        log_scale=tensor(np.log(ground.scales)),
    )


def _linear_height(body: BodyModel) -> Array:
    """Stature as a linear function of betas: the same vertices are highest and lowest for all people."""
    heights = body.rest_vertices(body.neutral_betas)[:, 1]
    crown, sole = int(np.argmax(heights)), int(np.argmin(heights))
    directions = body.shape_directions[crown, 1] - body.shape_directions[sole, 1]
    return np.concatenate([[body.template[crown, 1] - body.template[sole, 1]], directions])


def _axes(up: Array) -> Array:
    """(3, 3) rows: up and two unit vectors across it."""
    first = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return np.stack([up, first, np.cross(up, first)])
