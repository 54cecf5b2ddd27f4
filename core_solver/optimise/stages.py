"""The two stages of the joint optimisation: scale and depth, then space-time coherence.

Variables are kept at unit scale: a person's points are s * (V(theta, betas) + g), so gamma = s * g. A change of s moves
the person along the viewing rays and leaves the picture unchanged, which takes the scale-depth valley out of the
problem.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.camera import Camera
from core_solver.energy import terms
from core_solver.energy.kernels import charbonnier
from core_solver.energy.weights import Weights
from core_solver.optimise.descent import descend
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import TorchBody, pose
from core_solver.optimise.scale_ground import ScaleGround
from core_solver.scene.sampling import BodyDepth

Array = NDArray[np.float64]

STAGE_ONE_ITERATIONS = 60
STAGE_TWO_ITERATIONS = 200

_DEPTH_RANGE_SIGMA = 0.05  # a frame's log z_near and z_far about the clip's: networks jitter that much
_CONTACT_REACH = 0.03  # of the distance
_FILLED_TRUST = 0.3  # theta^ of a frame without evidence keeps the motion plausible


@dataclass(frozen=True)
class Variables:
    """What is solved for, on the device.

    Attributes:
        theta: (N, T, 24, 3) radians.
        translation: (N, T, 3) at unit scale.
        betas: (N, 10).
        log_scale: (N,).
        log_inverse_far: (T,) log of 1 / z_far.
        log_inverse_gap: (T,) log of 1 / z_near - 1 / z_far: both positive, so 0 < z_near < z_far always holds.
    """

    theta: Tensor
    translation: Tensor
    betas: Tensor
    log_scale: Tensor
    log_inverse_far: Tensor
    log_inverse_gap: Tensor


@dataclass(frozen=True)
class Points:
    """Metric points of all people, camera frame.

    Attributes:
        keypoints: (N, T, 25, 3).
        proxy: (N, T, P, 3).
        joints: (N, T, 24, 3).
    """

    keypoints: Tensor
    proxy: Tensor
    joints: Tensor


def start_variables(fit: PoseFit, ground: ScaleGround, body: TorchBody) -> Variables:
    """Variables at the pose fit and the first scales."""
    like = body.keypoints.template

    def tensor(values: Array) -> Tensor:
        return torch.as_tensor(np.array(values), dtype=like.dtype, device=like.device)

    frames = fit.theta.shape[1]
    return Variables(
        tensor(fit.theta),
        tensor(fit.translation),
        tensor(fit.betas),
        tensor(np.log(ground.scales)),
        tensor(np.full(frames, math.log(ground.inverse_far))),
        tensor(np.full(frames, math.log(ground.inverse_gap))),
    )


def pose_points(variables: Variables, body: TorchBody) -> Points:
    """Metric keypoints, proxy vertices and joints."""
    posed = pose(variables.theta, variables.betas, body)
    shift, scale = variables.translation[:, :, None], torch.exp(variables.log_scale)[:, None, None, None]
    return Points(
        scale * (posed.skin(body.keypoints, variables.betas) + shift),
        scale * (posed.skin(body.proxy, variables.betas) + shift),
        scale * (posed.positions + shift),
    )


class JointEnergy:
    """E_I and E_II with their constants on the device."""

    def __init__(
        self, evidence: Evidence, fit: PoseFit, ground: ScaleGround, camera: Camera, body: TorchBody,
        heights: Array, weights: Weights,
    ) -> None:  # fmt: skip
        self._like = body.keypoints.template
        self._body, self._weights = body, weights
        self._focal = self._tensor(np.array([camera.fx, camera.fy]))
        self._centre = self._tensor(np.array([camera.cx, camera.cy]))
        self._pixels, self._confidence = self._tensor(evidence.pixels), self._tensor(evidence.confidence)
        self._size, self._seconds = self._tensor(evidence.size), self._tensor(evidence.seconds)
        self._theta_hat, self._betas_hat = self._tensor(fit.theta), self._tensor(fit.betas)
        self._valid = self._tensor(evidence.valid)
        self._theta_trust = self._tensor(np.where(evidence.valid, 1.0, _FILLED_TRUST))
        self._log_heights = self._tensor(np.log(heights))
        self._up = self._tensor(ground.up)
        self._offset = self._tensor(ground.offset - ground.levels)[:, None, None]
        self._log_range = self._tensor(np.log([ground.inverse_far, ground.inverse_gap]))
        # What persists over a clip counts as a few measurements, whatever its length.
        frames = np.maximum(evidence.valid.sum(axis=1, keepdims=True), 1)
        self._per_clip = self._tensor(np.minimum(weights.effective_samples / frames, 1.0))
        self._depth: BodyDepth | None = None
        self._contacts: Tensor | None = None
        self._filtered: Tensor | None = None

    def set_depth(self, depth: BodyDepth) -> None:
        """Use the disparity under these visible vertices."""
        self._depth = depth
        self._visible = self._tensor(depth.visible)
        self._disparity = self._tensor(depth.disparity)
        self._depth_weight = self._tensor(depth.weight)

    def set_contacts(self, probability: Array) -> None:
        """Use these (N, T, 2) contact probabilities."""
        self._contacts = self._tensor(probability)

    def set_filtered(self, filtered: Array) -> None:
        """Follow the velocities of these (N, T, P, 3) filtered vertices, metres."""
        self._filtered = self._tensor(filtered)

    def _tensor(self, values: NDArray) -> Tensor:
        return torch.as_tensor(np.array(values, dtype=np.float64), dtype=self._like.dtype, device=self._like.device)

    def stage_one(self, v: Variables) -> Tensor:
        """E_I, with soles held to the ground so that people keep one common scale."""
        points = pose_points(v, self._body)
        return self._image_terms(v, points) + self._scale_terms(v, points) + self._contact_term(points)

    def stage_two(self, v: Variables) -> Tensor:
        """E_I + E_II."""
        points = pose_points(v, self._body)
        # Scale guard: motion terms in metres would otherwise buy calm by shrinking people.
        scale = torch.exp(v.log_scale)[:, None, None, None]
        proxy = points.proxy * (scale.detach() / scale)
        return (
            self._image_terms(v, points)
            + self._scale_terms(v, points)
            + self._contact_term(points)
            + self._slip_term(proxy)
            + self._temporal_term(proxy)
        )

    def _image_terms(self, v: Variables, points: Points) -> Tensor:
        w = self._weights
        z = points.keypoints[..., 2:].clamp_min(0.05)
        projected = points.keypoints[..., :2] / z * self._focal + self._centre
        return w.joints * terms.joints(
            projected, self._pixels, self._confidence, self._size, w.joints_sigma
        ) + w.smpl * terms.smpl(v.theta, self._theta_hat, self._theta_trust, w.theta_sigma)

    def _scale_terms(self, v: Variables, points: Points) -> Tensor:
        w = self._weights
        energy = w.height * terms.height(
            self._log_heights + v.log_scale, math.log(w.height_mean_m), w.height_sigma, w.height_sigma_below
        )
        energy = energy + w.betas * terms.shape(v.betas, self._betas_hat) * v.theta.shape[1]
        if len(self._seconds):
            energy = energy + w.speed * terms.speed(v.translation, self._seconds, w.speed_sigma)
        if len(self._seconds) > 1:
            energy = energy + w.acceleration * terms.acceleration(v.translation, self._seconds, w.acceleration_sigma)
        if self._depth is not None:
            energy = energy + w.depth * self._depth_term(v, points)
        return energy

    def _depth_term(self, v: Variables, points: Points) -> Tensor:
        count = self._visible.sum(-1).clamp_min(1)
        body = (self._visible * torch.log(points.proxy[..., 2].clamp_min(0.05))).sum(-1) / count
        far, gap = torch.exp(v.log_inverse_far)[None, :, None], torch.exp(v.log_inverse_gap)[None, :, None]
        scene = -(self._visible * torch.log(far + gap * self._disparity)).sum(-1) / count
        ties = torch.stack([v.log_inverse_far, v.log_inverse_gap], -1) - self._log_range
        jitter = charbonnier((ties / _DEPTH_RANGE_SIGMA) ** 2).sum() * self._per_clip.mean()
        weight = self._depth_weight * self._per_clip
        return terms.depth(body, scene, weight, self._weights.depth_sigma) + jitter

    def sole_heights(self, proxy: Tensor) -> Tensor:
        """Height (N, T, 2) of each foot's lowest sole vertex above the person's own floor, metres."""
        return (self._soles(proxy) @ self._up).amin(-1) + self._offset

    def _soles(self, proxy: Tensor) -> Tensor:
        return proxy[:, :, self._body.soles]

    def _contact_term(self, points: Points) -> Tensor:
        if self._contacts is None:
            return points.proxy.sum() * 0
        w, heights = self._weights, self.sole_heights(points.proxy)
        # How well a far person's height above the ground is known grows with the distance.
        reach = (_CONTACT_REACH * points.joints[:, :, 0, 2].detach()).clamp_min(terms.CONTACT_RANGE_M)
        return w.contact * terms.contact(
            heights, self._contacts, reach, w.contact_sigma
        ) + w.penetration * terms.penetration(heights, self._valid, reach)

    def _slip_term(self, proxy: Tensor) -> Tensor:
        if self._contacts is None or not len(self._seconds):
            return proxy.sum() * 0
        soles, w = self._soles(proxy), self._weights
        return w.slip * terms.slip(soles, self._contacts, self._seconds, w.slip_sigma)

    def _temporal_term(self, proxy: Tensor) -> Tensor:
        if self._filtered is None or not len(self._seconds):
            return proxy.sum() * 0
        w = self._weights
        # As strong as 24 independent points: neighbouring vertices say the same thing.
        return w.temporal * 24 * terms.temporal(proxy, self._filtered, self._seconds, w.temporal_sigma)


def run_stage(
    variables: Variables,
    energy: Callable[[Variables], Tensor],
    iterations: int,
    advance: Callable[[int], None] = lambda _steps: None,
) -> float:
    """Minimise one stage's energy over all variables, in place; returns the last energy."""
    rates = [
        (variables.theta, 0.02),
        (variables.translation, 0.02),
        (variables.betas, 0.02),
        (variables.log_scale, 0.005),
        (variables.log_inverse_far, 0.01),
        (variables.log_inverse_gap, 0.01),
    ]
    return descend(rates, lambda _iteration: energy(variables), iterations, advance)
