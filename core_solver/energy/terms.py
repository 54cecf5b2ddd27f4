"""One pure function for each energy term, named as in the paper. Camera frame, metres, pixels; torch throughout.

N people, T frames, K keypoints, P proxy vertices, S sole vertices of a foot. Each returns a scalar.
"""

import torch
from torch import Tensor

from core_solver.energy.kernels import charbonnier, geman_mcclure

CONTACT_RANGE_M = 0.20  # the paper's zeta: beyond this a sole is simply in the air


def joints(projected: Tensor, observed: Tensor, confidence: Tensor, size: Tensor, sigma: float) -> Tensor:
    """Reprojection error of the keypoints (paper eq. joints), robust and weighted by confidence.

    Args:
        projected: (N, T, K, 2) pixels.
        observed: (N, T, K, 2) pixels, undistorted.
        confidence: (N, T, K), 0 where there is no evidence.
        size: (N, T) extent of the person in pixels.
        sigma: deviation of a keypoint in person sizes.
    """
    residual = (projected - observed) / (sigma * size[..., None, None])
    return (confidence * charbonnier((residual**2).sum(-1))).sum()


def smpl(theta: Tensor, theta_hat: Tensor, weight: Tensor, sigma: float) -> Tensor:
    """Pose stays near the regressed or fitted pose (paper E_smpl), a smooth L1.

    Args:
        theta: (N, T, 24, 3) radians.
        theta_hat: (N, T, 24, 3) radians.
        weight: (N, T) trust in theta_hat.
        sigma: radians.
    """
    residual = ((theta - theta_hat) / sigma) ** 2
    return (weight[..., None] * charbonnier(residual.sum(-1))).sum()


def shape(betas: Tensor, betas_hat: Tensor) -> Tensor:
    """Shape stays near betas^ (paper E_smpl), a smooth L1.

    Args:
        betas: (N, 10).
        betas_hat: (N, 10).
    """
    return charbonnier((betas - betas_hat) ** 2).sum()


def stature(log_growth: Tensor, sigma: float) -> Tensor:
    """Betas change proportions and leave stature to the scale: otherwise the two drift against each other.

    Args:
        log_growth: (N,) log of the stature that betas give over that of betas^.
        sigma: deviation of the log.
    """
    return ((log_growth / sigma) ** 2).sum()


def height(log_heights: Tensor, mixture: Tensor) -> Tensor:
    """Prior on statures, the paper's E_scale for a world with children: minus twice the log of a mixture of normals.

    Args:
        log_heights: (N,) log metres.
        mixture: (C, 3) rows of share, mean and deviation of log stature; the first row is that of adults.

    Returns:
        (N,) costs, 0 for an average adult; a giant's grows with the square, a child's does not.
    """
    share, mean, sigma = mixture.T
    likelihood = share / sigma * torch.exp(-0.5 * ((log_heights[..., None] - mean) / sigma) ** 2)
    # Far from all components the exponentials vanish: the widest one's logarithm goes on.
    widest = torch.argmax(sigma)
    tail = torch.log(share[widest] / sigma[widest]) - 0.5 * ((log_heights - mean[widest]) / sigma[widest]) ** 2
    logs = torch.where(likelihood.sum(-1) > 1e-30, torch.log(likelihood.sum(-1).clamp_min(1e-30)), tail)
    peak = torch.log((share / sigma * torch.exp(-0.5 * ((mean[0] - mean) / sigma) ** 2)).sum())
    return 2 * (peak - logs)


def guard(change: Tensor, sigma: float | Tensor) -> Tensor:
    """What was found from lasting facts stays near: frames that err alike must not outvote them; beyond the paper.

    Args:
        change: any shape.
        sigma: deviations, in the units of the change.
    """
    return ((change / sigma) ** 2).sum()


def speed(translations: Tensor, seconds: Tensor, sigma: float) -> Tensor:
    """Squared root speed between consecutive frames (paper E_speed).

    Translations are given at unit scale, that is in body heights: a term in metres would shrink the whole scene.

    Args:
        translations: (N, T, 3) at unit scale.
        seconds: (T - 1,) between frames.
        sigma: per second.
    """
    velocity = (translations[:, 1:] - translations[:, :-1]) / (sigma * seconds[:, None])
    return (velocity**2).sum()


def acceleration(translations: Tensor, seconds: Tensor, sigma: float) -> Tensor:
    """Root acceleration, robust: beyond the paper, it tells a trembling depth from a real motion.

    Args:
        translations: (N, T, 3) at unit scale.
        seconds: (T - 1,) between frames.
        sigma: per second squared.
    """
    velocity = (translations[:, 1:] - translations[:, :-1]) / seconds[:, None]
    middle = 0.5 * (seconds[1:] + seconds[:-1])
    change = (velocity[:, 1:] - velocity[:, :-1]) / (sigma * middle[:, None])
    return charbonnier((change**2).sum(-1)).sum()


def depth(body_log_depth: Tensor, scene_log_depth: Tensor, weight: Tensor, sigma: float) -> Tensor:
    """Mean log depth of a body against that of the depth map in its mask (paper E_depth), robust.

    Args:
        body_log_depth: (N, T) M of the body: mean log depth of its visible vertices inside the mask.
        scene_log_depth: (N, T) M of the depth map at the same places.
        weight: (N, T), 0 where body and mask do not meet.
        sigma: deviation of the network's log depth.
    """
    return (weight * charbonnier(((body_log_depth - scene_log_depth) / sigma) ** 2)).sum()


def contact(sole_heights: Tensor, probability: Tensor, reach: Tensor, sigma: float) -> Tensor:
    """Soles in contact lie on the ground; a sole out of reach is not pulled (paper E_contact).

    Args:
        sole_heights: (N, T, 2) metres of each foot's lowest point above its support.
        probability: (N, T, 2) of being in contact.
        reach: (N, T) metres, `CONTACT_RANGE_M` or what far people's depth leaves open.
        sigma: metres.
    """
    near = (sole_heights.detach().abs() < reach[..., None]).to(sole_heights.dtype)
    return (probability * near * charbonnier((sole_heights / sigma) ** 2)).sum()


def penetration(sole_heights: Tensor, weight: Tensor, sigma: Tensor) -> Tensor:
    """No sole lies below the ground, whether it is in contact or not; beyond the paper.

    The pull fades far below, where the ground itself must be in doubt.

    Args:
        sole_heights: (N, T, 2) metres of each foot's lowest point above its support.
        weight: (N, T) evidence of the person in the frame.
        sigma: (N, T) metres within which the ground is trusted.
    """
    below = sole_heights.clamp_max(0) / sigma[..., None]
    return (weight[..., None] * geman_mcclure(below**2)).sum()


def slip(soles: Tensor, probability: Tensor, seconds: Tensor, sigma: float) -> Tensor:
    """Soles rest between consecutive frames while in contact in both (paper E_slip).

    Args:
        soles: (N, T, 2, S, 3) metres, sole vertices of the left and right foot.
        probability: (N, T, 2) of being in contact.
        seconds: (T - 1,) between frames.
        sigma: metres a second.
    """
    velocity = (soles[:, 1:] - soles[:, :-1]) / (sigma * seconds[:, None, None, None])
    both = probability[:, 1:] * probability[:, :-1]
    return (both[..., None] * geman_mcclure((velocity**2).sum(-1))).sum() / soles.shape[3]


def temporal(vertices: Tensor, filtered: Tensor, seconds: Tensor, sigma: float) -> Tensor:
    """Vertex velocities follow those of the one-euro-filtered vertices (paper eq. temporal).

    Args:
        vertices: (N, T, P, 3) metres.
        filtered: (N, T, P, 3) metres.
        seconds: (T - 1,) between frames.
        sigma: metres a second.
    """
    difference = vertices - filtered
    velocity = (difference[:, 1:] - difference[:, :-1]) / (sigma * seconds[:, None, None])
    return (velocity**2).sum()


def silhouette(along: Tensor, target: Tensor, weight: Tensor, sigma: Tensor) -> Tensor:
    """Distance between the contours of body and mask (paper E_silhouette in its Gauss-Newton form), robust.

    The area in which silhouette and mask disagree is the L1 norm of the distance of their contours.

    Args:
        along: (N, T, S) coordinate in pixels of contour samples, each along its own image axis.
        target: (N, T, S) where the mask's edge is on the same axis.
        weight: (N, T, S) share of the contour, sums to at most 1; 0 where there is no evidence.
        sigma: (N, T) pixels, deviation of a mask's edge.
    """
    return (weight * charbonnier(((along - target) / sigma[..., None]) ** 2)).sum()


def collision(overlap: Tensor, sigma: float) -> Tensor:
    """Bodies do not pass through each other or themselves; beyond the paper, and gentle: its pull fades when deep.

    Args:
        overlap: (N, T, Q) metres by which pairs of spheres overlap; negative apart.
        sigma: metres.
    """
    return geman_mcclure((overlap.clamp_min(0) / sigma) ** 2).sum()
