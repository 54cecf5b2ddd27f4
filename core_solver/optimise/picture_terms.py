"""Depth and silhouette as the solver uses them: linear about the poses of the last look at the picture.

The area in which a body and its mask disagree is the L1 norm of the distance between their contours. That gives the
silhouette a Gauss-Newton form: every sample of the body's contour is drawn along an image axis to the mask's edge.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from core_solver.optimise.posing import Posed, TorchBody
from core_solver.optimise.variables import Variables


@dataclass(frozen=True)
class ContourTerms:
    """Samples of the bodies' contours; people, frames and S samples.

    Attributes:
        corners: (N, T, S, 3) surface vertices of the triangle a sample lies in.
        barycentric: (N, T, S, 3).
        axis: (N, T, S) int64, 0 where the sample moves along u, 1 along v.
        target: (N, T, S) pixels, where the mask's edge is.
        weight: (N, T, S) share of the contour a sample stands for; sums to about 1, 0 where there is no evidence.
    """

    corners: Tensor
    barycentric: Tensor
    axis: Tensor
    target: Tensor
    weight: Tensor


@dataclass(frozen=True)
class DepthTerms:
    """Mean log depths, linear about the variables `at`.

    Attributes:
        at: where the bodies were when the picture was looked at.
        body: (N, T) M of the bodies.
        body_rows: (N, T, 75) its derivative with respect to theta and translation.
        scene: (N, T) M of the depth map at the same pixels.
        scene_rows: (N, T, 2) its derivative with respect to log_inverse_far and log_inverse_gap.
        weight: (N, T), 0 where body and mask do not meet.
    """

    at: Variables
    body: Tensor
    body_rows: Tensor
    scene: Tensor
    scene_rows: Tensor
    weight: Tensor

    def log_depths(self, v: Variables, n: int) -> tuple[Tensor, Tensor]:
        """M (1, T) of one person's body and of the depth map, metres, linear in the variables."""
        one = slice(n, n + 1)
        moved = torch.cat(
            [(v.theta[one] - self.at.theta[one]).flatten(2), v.translation[one] - self.at.translation[one]], -1
        )
        body = self.body[one] + (self.body_rows[one] * moved).sum(-1) + (v.log_scale[n] - self.at.log_scale[n])
        ranges = torch.stack(
            [v.log_inverse_far - self.at.log_inverse_far, v.log_inverse_gap - self.at.log_inverse_gap], -1
        )
        return body, self.scene[one] + (self.scene_rows[one] * ranges).sum(-1)


@dataclass(frozen=True)
class PictureTerms:
    """Raster terms of all people; outlines are None without the silhouette term."""

    depth: DepthTerms
    contours: ContourTerms | None


@dataclass(frozen=True)
class ContourRest:
    """Contour samples of one person in the rest pose.

    Attributes:
        rest: (T, S, 3) metres.
        directions: (T, S, 3, 10) metres per unit of beta.
        weights: (T, S, 24) skinning weights.
    """

    rest: Tensor
    directions: Tensor
    weights: Tensor


def contour_rest(contours: ContourTerms, body: TorchBody, betas: Tensor, n: int) -> ContourRest:
    """Where one person's contour samples lie on the rest body; betas (10,)."""
    corners, share = contours.corners[n], contours.barycentric[n]
    directions = (body.surface.directions[corners] * share[..., None, None]).sum(2)
    template = (body.surface.template[corners] * share[..., None]).sum(2)
    weights = (body.surface.weights[corners] * share[..., None]).sum(2)
    return ContourRest(template + directions @ betas, directions, weights)


def contour_points(contours: ContourTerms, body: TorchBody, v: Variables, n: int, posed: Posed) -> Tensor:
    """One person's posed contour samples (1, T, S, 3) at unit scale, camera frame."""
    sample = contour_rest(contours, body, v.betas[n], n)
    points = posed.skin_each(sample.rest[None], sample.weights[None])
    return points + v.translation[n : n + 1, :, None]
