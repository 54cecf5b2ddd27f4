"""What is solved for, and the body points it poses.

Variables are kept at unit scale: a person's points are s * (V(theta, betas) + g), so gamma = s * g. A change of s moves
the person along the viewing rays and leaves the picture unchanged, which takes the scale-depth valley out of the
problem; and motion measured at unit scale, that is in bodies instead of metres, cannot be calmed by shrinking people.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import Posed, TorchBody, pose
from core_solver.optimise.scale_ground import ScaleGround

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Variables:
    """What is solved for, on the device.

    Attributes:
        theta: (N, T, 24, 3) radians.
        translation: (N, T, 3) at unit scale.
        betas: (N, 10).
        log_scale: (N,).
        ground: (3,) tilts of the first ground's normal about two axes, radians, and log of its distance ratio.
        log_focal: () log of the focal length's ratio to the given one.
        log_inverse_far: (T,) log of 1 / z_far.
        log_inverse_gap: (T,) log of 1 / z_near - 1 / z_far: both positive, so 0 < z_near < z_far always holds.
        log_range: (2,) the clip's own log_inverse_far and log_inverse_gap, to which its frames' are tied.
    """

    theta: Tensor
    translation: Tensor
    betas: Tensor
    log_scale: Tensor
    ground: Tensor
    log_focal: Tensor
    log_inverse_far: Tensor
    log_inverse_gap: Tensor
    log_range: Tensor

    def leaves(self) -> "Variables":
        """Copies that collect gradients."""
        return Variables(*(getattr(self, f.name).detach().clone().requires_grad_() for f in fields(self)))


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
        theta=tensor(fit.theta),
        translation=tensor(fit.translation),
        betas=tensor(fit.betas),
        log_scale=tensor(np.log(ground.scales)),
        ground=tensor(np.zeros(3)),
        log_focal=tensor(np.zeros(())),
        log_inverse_far=tensor(np.full(frames, math.log(ground.inverse_far))),
        log_inverse_gap=tensor(np.full(frames, math.log(ground.inverse_gap))),
        log_range=tensor(np.log([ground.inverse_far, ground.inverse_gap])),
    )


def of_frames(v: Variables, frames: slice) -> Variables:
    """The variables of some frames alone."""
    return replace(
        v,
        theta=v.theta[:, frames],
        translation=v.translation[:, frames],
        log_inverse_far=v.log_inverse_far[frames],
        log_inverse_gap=v.log_inverse_gap[frames],
    )


def pose_person(variables: Variables, person: int, body: TorchBody) -> Posed:
    """One person's posed joints, at unit scale, before translation; the leading dimension stays."""
    one = slice(person, person + 1)
    return pose(variables.theta[one], variables.betas[one], body)


def pose_points(variables: Variables, body: TorchBody) -> Points:
    """Metric keypoints, proxy vertices and joints."""
    posed = pose(variables.theta, variables.betas, body)
    shift, scale = variables.translation[:, :, None], torch.exp(variables.log_scale)[:, None, None, None]
    return Points(
        scale * (posed.skin(body.keypoints, variables.betas) + shift),
        scale * (posed.skin(body.proxy, variables.betas) + shift),
        scale * (posed.positions + shift),
    )
