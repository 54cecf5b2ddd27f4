"""The paper's energies in their own, unrobust forms: the measure for ours. Camera frame, metres, pixels; torch.

N people, T frames, K keypoints, V vertices. Each returns a scalar without the paper's lambda; equations are named as
there. Data terms skip frames in which a person was not seen.
"""

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from core_solver.energy.terms import CONTACT_RANGE_M

JOINT_GATE = 0.5
SMPL_VERTICES = 6890  # of the body that the paper's lambda for sums over vertices belongs to


@dataclass(frozen=True)
class PaperWeights:
    """The paper's lambdas. A weight of 0 switches its term off.

    Attributes:
        joints: 2D keypoints.
        silhouette: soft silhouette against the mask.
        depth: body depth against the depth map.
        smpl: pose and shape stay near theta^ and betas^.
        scale: both scale priors together.
        scale_each: the paper's lambda_scale, of each person's scale; their sum has weight 1.
        speed: root motion between frames.
        contact: lowest vertex on the scene.
        slip: that vertex rests while in contact.
        temporal: vertices move as their filtered selves.
    """

    joints: float = 1.0
    silhouette: float = 0.1
    depth: float = 0.05
    smpl: float = 0.002
    scale: float = 1.0
    scale_each: float = 0.0001
    speed: float = 0.05
    contact: float = 0.001
    slip: float = 0.01
    temporal: float = 0.002

    @staticmethod
    def terms() -> tuple[str, ...]:
        """Names of the weights that switch a term."""
        return tuple(field.name for field in fields(PaperWeights) if field.name != "scale_each")


def depth(body_log_depth: Tensor, scene_log_depth: Tensor, seen: Tensor) -> Tensor:
    """Squared difference of mean log depths (eq. energydepth).

    Args:
        body_log_depth: (N, T) M of the rasterised body over the pixels that the visible body and its mask share.
        scene_log_depth: (N, T) M of the depth map over the same pixels.
        seen: (N, T), 0 where they share none.
    """
    return (seen * (body_log_depth - scene_log_depth) ** 2).sum()


def joints(projected: Tensor, observed: Tensor, confidence: Tensor, image_size: tuple[int, int]) -> Tensor:
    """Squared reprojection error in shares of the image's width and height, gated at confidence 0.5 (eq. joints).

    Args:
        projected: (N, T, K, 2) pixels.
        observed: (N, T, K, 2) pixels, undistorted.
        confidence: (N, T, K), 0 where there is no evidence.
        image_size: (width, height) pixels.
    """
    residual = (projected - observed) / projected.new_tensor(image_size)
    return ((confidence > JOINT_GATE)[..., None] * residual**2).sum()


def silhouette(wrong: Tensor, visible: Tensor) -> Tensor:
    """Soft silhouettes S against masks Omega: the mean of (S - Omega)^2 over the visible pixels (eq. silhouette).

    Args:
        wrong: (N, T) sum of (S - Omega)^2 over the pixels in which no other person hides this one.
        visible: (N, T) how many these are.
    """
    return (wrong / visible.clamp_min(1)).sum()


def smpl(theta: Tensor, theta_hat: Tensor, betas: Tensor, betas_hat: Tensor, seen: Tensor) -> Tensor:
    """L1 distance to the regressed pose and shape, the shape's counted in every frame (eq. of E_smpl).

    Args:
        theta: (N, T, 24, 3) radians.
        theta_hat: (N, T, 24, 3) radians.
        betas: (N, 10).
        betas_hat: (N, 10).
        seen: (N, T), 0 where there is no evidence.
    """
    pose = (theta - theta_hat).abs().sum((-1, -2))
    shape = (betas - betas_hat).abs().sum(-1)
    return (seen * (pose + shape[:, None])).sum()


def scale(scales: Tensor, weight_each: float) -> Tensor:
    """Each person's scale near 1, and their average too (eq. of E_scale); once a clip.

    Args:
        scales: (N,).
        weight_each: lambda_scale.
    """
    return weight_each * ((scales - 1) ** 2).sum() + (scales - 1).sum() ** 2


def speed(gamma: Tensor) -> Tensor:
    """Squared root motion between consecutive frames (eq. of E_speed); gamma (N, T, 3) metres."""
    return ((gamma[:, 1:] - gamma[:, :-1]) ** 2).sum()


def lowest(vertices: Tensor) -> Tensor:
    """V^{y+}: (N, T) index of the lowest of (N, T, V, 3) vertices, gravity being the camera's y axis."""
    return vertices[..., 1].argmax(-1)


def is_touching(points: Tensor, nearest: Tensor) -> Tensor:
    """zeta: (...) bool, whether points (..., 3) are within 20 cm of their nearest scene points, in the L1 norm."""
    return (points - nearest).abs().sum(-1) < CONTACT_RANGE_M


def contact(points: Tensor, nearest: Tensor) -> Tensor:
    """L1 distance of lowest vertices to the scene, where below 20 cm (eq. of E_contact).

    Args:
        points: (N, T, 3) metres, each person's lowest vertex.
        nearest: (N, T, 3) metres, the scene point nearest to it.
    """
    return (is_touching(points, nearest) * (points - nearest).abs().sum(-1)).sum()


def slip(vertices: Tensor, rows: Tensor, touching: Tensor) -> Tensor:
    """L1 motion of a lowest vertex to the next frame, while the person is in contact in both (eq. of E_slip).

    Args:
        vertices: (N, T, V, 3) metres.
        rows: (N, T) from `lowest`: the vertex of frame t is the one followed to frame t + 1.
        touching: (N, T) bool.
    """
    index = rows[:, :-1, None, None].expand(-1, -1, 1, 3)
    moved = (torch.gather(vertices[:, 1:], 2, index) - torch.gather(vertices[:, :-1], 2, index)).abs().sum((-1, -2))
    return (touching[:, 1:] * touching[:, :-1] * moved).sum()


def temporal(vertices: Tensor, filtered: Tensor) -> Tensor:
    """Vertex velocities follow those of the one-euro-filtered vertices (eq. temporal).

    The paper sums over SMPL's 6890 vertices: other meshes' sums are brought to as many.

    Args:
        vertices: (N, T, V, 3) metres.
        filtered: (N, T, V, 3) metres.
    """
    difference = vertices - filtered
    change = difference[:, 1:] - difference[:, :-1]
    return (change**2).sum() * (SMPL_VERTICES / vertices.shape[2])
