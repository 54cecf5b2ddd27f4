"""Looking at the picture again from where the bodies now stand: what they cover, where their feet rest."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.camera import Camera
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.picture_terms import PictureTerms
from core_solver.optimise.variables import Variables, pose_person
from core_solver.scene.contacts import contact_probability
from core_solver.scene.sampling import BodyDepth, sample_bodies
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Onlooker:
    """What looking needs besides the bodies.

    Attributes:
        modalities: masks and disparity.
        camera: intrinsics.
        evidence: tracks in solver units.
        still: (N, T, 2) probability that a foot rests in the picture.
        levels: (N,) metres by which each person's own floor lies above the common ground.
    """

    modalities: Modalities
    camera: Camera
    evidence: Evidence
    still: Array
    levels: Array

    def look(self, energy: JointEnergy, v: Variables) -> None:
        """Renew the raster terms, the contacts and the supports of an energy."""
        self.look_at_feet(energy, v)
        with torch.no_grad():
            spheres = [energy.spheres(v, n, pose_person(v, n, energy.body)) for n in range(energy.people)]
        energy.look(spheres=torch.cat(spheres))
        if self.modalities.disparity is not None:
            energy.look(picture=self._picture(energy, v))

    def look_at_feet(self, energy: JointEnergy, v: Variables) -> None:
        """Renew contacts and supports."""
        support = np.broadcast_to(self.levels[:, None, None], self.still.shape)
        heights, distance = foot_heights(energy, v)
        contacts = contact_probability(heights - support, self.still, distance) * self.evidence.valid[..., None]
        like = v.theta
        energy.look(
            contacts=torch.as_tensor(contacts, dtype=like.dtype, device=like.device),
            support=torch.as_tensor(support.copy(), dtype=like.dtype, device=like.device),
        )

    def _picture(self, energy: JointEnergy, v: Variables) -> PictureTerms:
        with torch.no_grad():
            proxy = torch.cat([_proxy(energy, v, n) for n in range(energy.people)])
        depth = sample_bodies(proxy.cpu().double().numpy(), self.evidence.valid, self.modalities, self.camera)
        people = [_depth_of_person(energy, v, n, depth) for n in range(energy.people)]
        body, rows, scene, scene_rows = (torch.cat(parts) for parts in zip(*people, strict=True))
        weight = torch.as_tensor(depth.weight, dtype=body.dtype, device=body.device)
        return PictureTerms(v, body, rows, scene, scene_rows, weight, None)


def foot_heights(energy: JointEnergy, v: Variables) -> tuple[Array, Array]:
    """Height of each foot's lowest point above the common ground (N, T, 2) and people's distance (N, T), metres."""
    with torch.no_grad():
        heights = torch.cat([energy.sole_heights(v, n, pose_person(v, n, energy.body)) for n in range(energy.people)])
        distance = torch.exp(v.log_scale)[:, None] * v.translation[..., 2]
    return heights.amin(-1).cpu().double().numpy(), distance.cpu().double().numpy()


def _proxy(energy: JointEnergy, v: Variables, n: int) -> Tensor:
    one = slice(n, n + 1)
    posed = pose_person(v, n, energy.body)
    points = posed.skin(energy.body.proxy, v.betas[one]) + v.translation[one, :, None]
    return torch.exp(v.log_scale[n]) * points


def _depth_of_person(
    energy: JointEnergy, v: Variables, n: int, depth: BodyDepth
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """M of the body with its rows, and M of the depth map with its rows; leading dimension 1."""
    leaves = v.leaves()
    visible = torch.as_tensor(depth.visible[n : n + 1], dtype=v.theta.dtype, device=v.theta.device)
    disparity = torch.as_tensor(depth.disparity[n : n + 1], dtype=v.theta.dtype, device=v.theta.device)
    count = visible.sum(-1).clamp_min(1)
    body = (visible * torch.log(_proxy(energy, leaves, n)[..., 2].clamp_min(0.05))).sum(-1) / count
    # Frames do not see each other's angles: one backward pass of the sum gives every frame's own row.
    turns, moves = torch.autograd.grad(body.sum(), [leaves.theta, leaves.translation])
    far, gap = torch.exp(v.log_inverse_far)[None, :, None], torch.exp(v.log_inverse_gap)[None, :, None]
    inverse = far + gap * disparity
    scene = -(visible * torch.log(inverse)).sum(-1) / count
    far_row = -(visible * far / inverse).sum(-1) / count
    gap_row = -(visible * gap * disparity / inverse).sum(-1) / count
    rows = torch.cat([turns[n].flatten(1), moves[n]], -1)[None]
    return body.detach(), rows, scene, torch.stack([far_row, gap_row], -1)
