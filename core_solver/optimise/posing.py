"""Posing a whole clip of people at once, in torch."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.kinematics_torch import pose_joints
from core_solver.body.model import BodyModel


@dataclass(frozen=True)
class PointSet:
    """Body points that shape moves linearly and skinning carries along.

    Attributes:
        template: (P, 3) metres at betas = 0.
        directions: (P, 3, 10) metres per unit of beta.
        weights: (P, 24).
    """

    template: Tensor
    directions: Tensor
    weights: Tensor

    def rest(self, betas: Tensor) -> Tensor:
        """Rest points (N, P, 3) of betas (N, 10), metres."""
        return self.template + torch.einsum("pck,nk->npc", self.directions, betas)


@dataclass(frozen=True)
class TorchBody:
    """The parts of a body model the solver evaluates.

    Attributes:
        joints: the 24 joints; their weights are unused.
        keypoints: the 25 image keypoints.
        proxy: vertices for vertex terms.
        soles: rows of `proxy` under the left and the right foot, (2, S).
    """

    joints: PointSet
    keypoints: PointSet
    proxy: PointSet
    soles: Tensor


def torch_body(body: BodyModel, soles: Tensor, device: torch.device, dtype: torch.dtype = torch.float32) -> TorchBody:
    """The solver's view of a body model on a device."""

    def points(*arrays: NDArray[np.float64]) -> PointSet:
        return PointSet(*(torch.as_tensor(array, dtype=dtype, device=device) for array in arrays))

    keep = body.proxy
    return TorchBody(
        joints=points(body.joint_template, body.joint_directions, np.eye(24)),
        keypoints=points(body.keypoint_template, body.keypoint_directions, body.keypoint_weights),
        proxy=points(body.template[keep], body.shape_directions[keep], body.weights[keep]),
        soles=soles.to(device),
    )


@dataclass(frozen=True)
class Posed:
    """The frames of all joints of all people, from which any point set is skinned.

    Attributes:
        rotations: (N, T, 24, 3, 3).
        positions: (N, T, 24, 3) metres, root at its rest place.
        rest_joints: (N, 24, 3) metres.
    """

    rotations: Tensor
    positions: Tensor
    rest_joints: Tensor

    def skin(self, points: PointSet, betas: Tensor) -> Tensor:
        """Posed points (N, T, P, 3), metres: one matrix product a person for the whole clip."""
        rest = points.rest(betas)
        people, frames = self.positions.shape[:2]
        offsets = self.positions - (self.rotations @ self.rest_joints[:, None, :, :, None])[..., 0]
        # sum_j w_j (R_j v + o_j) = [w_j v, w_j] . [R_j^T; o_j]: coefficients (P, 96) serve all frames of a person.
        turned = (points.weights[:, :, None] * rest[:, :, None, :]).flatten(-2)
        coefficients = torch.cat([turned, points.weights.expand(people, -1, -1)], dim=-1)
        columns = torch.cat([self.rotations.transpose(-1, -2).flatten(2, 3), offsets], dim=-2)
        flat = columns.transpose(-1, -2).reshape(people, frames * 3, -1) @ coefficients.transpose(-1, -2)
        return flat.reshape(people, frames, 3, -1).transpose(-1, -2)


def pose(theta: Tensor, betas: Tensor, body: TorchBody) -> Posed:
    """Forward kinematics of theta (N, T, 24, 3) with betas (N, 10)."""
    rest = body.joints.rest(betas)
    rotations, positions = pose_joints(theta, rest[:, None])
    return Posed(rotations, positions, rest)
