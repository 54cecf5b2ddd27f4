"""theta^: the body fitted to 3D landmarks and 2D keypoints within joint limits, at unit scale."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.limits import joint_limits
from core_solver.body.model import BodyModel
from core_solver.body.skeleton import KEYPOINT_NAMES, joint_index
from core_solver.camera import Camera
from core_solver.energy import terms
from core_solver.energy.kernels import charbonnier
from core_solver.energy.weights import ROOT_ACCELERATION
from core_solver.optimise.descent import descend
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.limb_pose import limb_pose
from core_solver.optimise.placement import place
from core_solver.optimise.posing import TorchBody, pose
from core_solver.optimise.root_motion import smooth_depths

Array = NDArray[np.float64]

ITERATIONS = 120

_LANDMARK_SIGMA_M = 0.04
_REPROJECTION_SIGMA = 0.03  # in person sizes
_LIMIT_SIGMA = 0.1  # radians beyond a limit
_ACCELERATION_SIGMA = 25.0  # m/s^2 of keypoints relative to the pelvis
_FILLED_TRUST = 0.05  # an interpolated landmark guides the pose of a frame without evidence, and nothing else

# Deviations from the rest pose of joints that keypoints hardly see, radians.
_QUIET_JOINTS = {
    "spine1": 0.25, "spine2": 0.2, "spine3": 0.2, "neck": 0.3, "head": 0.3, "left_collar": 0.2, "right_collar": 0.2,
    "left_wrist": 0.4, "right_wrist": 0.4, "left_hand": 0.1, "right_hand": 0.1, "left_foot": 0.2, "right_foot": 0.2,
    "left_ankle": 0.5, "right_ankle": 0.5,
}  # fmt: skip
# A crop network's depth of face points is worthless, and its hands are poor.
_LANDMARK_TRUST = {"nose": 0.5, "left_eye": 0.2, "right_eye": 0.2, "left_index": 0.3, "right_index": 0.3,
                   "left_pinky": 0.3, "right_pinky": 0.3}  # fmt: skip


@dataclass(frozen=True)
class PoseFit:
    """Pose and place of all people at unit scale.

    Attributes:
        theta: (N, T, 24, 3) radians.
        translation: (N, T, 3) added to the posed body before any scaling; metres of a body of neutral size.
        betas: (N, 10).
    """

    theta: Array
    translation: Array
    betas: Array


def fit_poses(
    evidence: Evidence,
    body: BodyModel,
    solver_body: TorchBody,
    camera: Camera,
    advance: Callable[[int], None] = lambda _steps: None,
    *,
    smooth: bool = True,
) -> PoseFit:
    """Fit all frames of all people at once.

    Args:
        evidence: tracks in solver units.
        body: the body model.
        solver_body: the same in torch; its device is used.
        camera: intrinsics; pixels of `evidence` are undistorted.
        advance: told after each of `ITERATIONS` steps.
        smooth: frames know of each other; without it each is fitted alone, as a per-frame regressor would.
    """
    people = len(evidence.valid)
    betas = np.tile(body.neutral_betas, (people, 1))
    rest_keypoints, rest_joints = body.rest_keypoints(body.neutral_betas), body.rest_joints(body.neutral_betas)
    first = np.stack([limb_pose(marks, rest_keypoints, rest_joints) for marks in evidence.landmarks])
    like = solver_body.keypoints.template

    def tensor(values: Array) -> Tensor:
        return torch.as_tensor(np.array(values), dtype=like.dtype, device=like.device)

    theta, fixed_betas = tensor(first), tensor(betas)
    problem = _Problem(evidence, camera, solver_body, fixed_betas, tensor, smooth=smooth)
    with torch.no_grad():
        points = problem.keypoints(theta).cpu().double().numpy()
    translation = tensor(place_clip(points, evidence, camera, smooth=smooth))

    def energy(_iteration: int) -> Tensor:
        return problem.energy(theta, translation)

    descend([(theta, 0.03), (translation, 0.03)], energy, ITERATIONS, advance)
    return PoseFit(theta.cpu().double().numpy(), translation.cpu().double().numpy(), betas)


def place_clip(points: Array, evidence: Evidence, camera: Camera, *, smooth: bool = True) -> Array:
    """Closed-form translations (N, T, 3) of posed keypoints (N, T, 25, 3), with depths smoothed along the clip."""
    rays = (evidence.pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    translations, good = place(points, rays, evidence.confidence)
    good &= evidence.valid
    centres = points.mean(axis=2)
    frames = np.arange(translations.shape[1])
    for person in range(len(translations)):
        known = np.flatnonzero(good[person])
        if len(known) == 0:
            # Nobody there to place: anywhere in front of the camera keeps the arithmetic finite.
            translations[person] = (0, 0, 5)
            continue
        body = centres[person] + translations[person]
        for axis in range(3):
            body[:, axis] = np.interp(frames, known, body[known, axis])
        # Keypoints fix the viewing ray well and the depth along it badly.
        depths = smooth_depths(body[:, 2], good[person], evidence.times) if smooth else body[:, 2].copy()
        translations[person] = body * (depths / body[:, 2])[:, None] - centres[person]
    return translations


class _Problem:
    """The pose fit's energy with its constants on the device."""

    def __init__(
        self, evidence: Evidence, camera: Camera, body: TorchBody, betas: Tensor, tensor: Callable[[Array], Tensor],
        *, smooth: bool,
    ) -> None:  # fmt: skip
        self._body, self._betas, self._smooth = body, betas, smooth
        self._focal, self._centre = tensor(np.array([camera.fx, camera.fy])), tensor(np.array([camera.cx, camera.cy]))
        self._pixels, self._confidence = tensor(evidence.pixels), tensor(evidence.confidence)
        self._size, self._seconds = tensor(evidence.size), tensor(evidence.seconds)
        landmarks = evidence.landmarks - evidence.landmarks.mean(axis=2, keepdims=True)
        self._landmarks = tensor(landmarks)
        trust: Array = np.array([_LANDMARK_TRUST.get(name, 1.0) for name in KEYPOINT_NAMES])
        seen = np.where(evidence.valid[..., None], 0.3 + 0.7 * evidence.confidence, _FILLED_TRUST)
        self._trust = tensor(trust * seen)
        lower, upper = joint_limits()
        self._lower, self._upper = tensor(np.nan_to_num(lower)), tensor(np.nan_to_num(upper))
        quiet = np.zeros(24)
        for name, sigma in _QUIET_JOINTS.items():
            quiet[joint_index(name)] = 1 / sigma**2
        self._quiet = tensor(quiet)

    def keypoints(self, theta: Tensor) -> Tensor:
        """Posed keypoints (N, T, 25, 3) at unit scale, before translation."""
        return pose(theta, self._betas, self._body).skin(self._body.keypoints, self._betas)

    def energy(self, theta: Tensor, translation: Tensor) -> Tensor:
        followed = pose(theta, self._betas, self._body).skin(self._body.followed, self._betas)
        points = followed[:, :, : len(KEYPOINT_NAMES)]
        return (
            self._landmark_term(points)
            + self._reprojection_term(points + translation[:, :, None])
            + self._anatomy_term(theta)
            + self._smoothness_term(followed)
            + self._root_term(translation)
        )

    def _landmark_term(self, points: Tensor) -> Tensor:
        centred = points - points.mean(dim=2, keepdim=True)
        # The landmarks' own size is arbitrary: one factor a person, in closed form.
        with torch.no_grad():
            weight = self._trust[..., None]
            overlap = (weight * centred * self._landmarks).sum((1, 2, 3))
            factor = overlap / (weight * self._landmarks**2).sum((1, 2, 3)).clamp_min(1e-9)
            factor = factor.clamp(0.5, 2.0)[:, None, None, None]
        residual = (centred - factor * self._landmarks) / _LANDMARK_SIGMA_M
        return (self._trust * charbonnier((residual**2).sum(-1))).sum()

    def _reprojection_term(self, points: Tensor) -> Tensor:
        projected = points[..., :2] / points[..., 2:].clamp_min(0.05) * self._focal + self._centre
        return terms.joints(projected, self._pixels, self._confidence, self._size, _REPROJECTION_SIGMA)

    def _anatomy_term(self, theta: Tensor) -> Tensor:
        inner = theta[:, :, 1:]
        beyond = (inner - self._upper[1:]).clamp_min(0) + (self._lower[1:] - inner).clamp_min(0)
        return ((beyond / _LIMIT_SIGMA) ** 2).sum() + (self._quiet[:, None] * theta**2).sum()

    def _smoothness_term(self, points: Tensor) -> Tensor:
        if points.shape[1] < 3 or not self._smooth:
            return points.sum() * 0
        velocity = (points[:, 1:] - points[:, :-1]) / self._seconds[:, None, None]
        middle = 0.5 * (self._seconds[1:] + self._seconds[:-1])
        acceleration = (velocity[:, 1:] - velocity[:, :-1]) / middle[:, None, None]
        return charbonnier(((acceleration / _ACCELERATION_SIGMA) ** 2).sum(-1)).sum()

    def _root_term(self, translation: Tensor) -> Tensor:
        if translation.shape[1] < 3 or not self._smooth:
            return translation.sum() * 0
        return terms.acceleration(translation, self._seconds, ROOT_ACCELERATION)
