"""Posing a whole clip of people at once, in torch."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.kinematics_torch import pose_joints
from core_solver.body.model import BodyModel
from core_solver.body.proxy import farthest_points
from core_solver.body.skeleton import joint_index
from core_solver.body.spheres import body_spheres

_SOLE_POINTS = 4  # of each foot that the solver follows: heel, toe and both sides
_SOLE_THICKNESS_M = 0.03


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

    def joined(self, others: "PointSet") -> "PointSet":
        """These points and then others."""
        return PointSet(
            torch.cat([self.template, others.template]),
            torch.cat([self.directions, others.directions]),
            torch.cat([self.weights, others.weights]),
        )

    def rest(self, betas: Tensor) -> Tensor:
        """Rest points (N, P, 3) of betas (N, 10), metres."""
        return self.template + torch.einsum("pck,nk->npc", self.directions, betas)


@dataclass(frozen=True)
class TorchBody:
    """The parts of a body model the solver evaluates.

    Attributes:
        joints: the 24 joints, each carried by itself.
        keypoints: the 25 image keypoints.
        followed: points whose motion is smoothed: the keypoints, then the joints. A keypoint lies on the skin a few
            centimetres off its joint, which could flicker beneath it.
        proxy: vertices spread over the body.
        soles: first S points under the left foot, then S under the right.
        surface: the vertices of `faces`.
        spheres: (M) points inside the body.
        radii: (M,) metres.
        pairs: (Q, 2) spheres of one body that must not meet.
        faces: (F, 3) int32, on the CPU: triangles for the raster terms.
    """

    joints: PointSet
    keypoints: PointSet
    followed: PointSet
    proxy: PointSet
    soles: PointSet
    surface: PointSet
    spheres: PointSet
    radii: Tensor
    pairs: Tensor
    faces: NDArray[np.int32]


def torch_body(
    body: BodyModel,
    device: torch.device,
    dtype: torch.dtype = torch.float32,
    surface: tuple[NDArray[np.integer], NDArray[np.int32]] | None = None,
) -> TorchBody:
    """The solver's view of a body model on a device.

    Args:
        body: the body model.
        device: where the tensors lie.
        dtype: of the tensors.
        surface: vertices and triangles among them for the raster terms; the whole body if not given.
    """

    def points(*arrays: NDArray[np.float64]) -> PointSet:
        return PointSet(*(torch.as_tensor(array, dtype=dtype, device=device) for array in arrays))

    def vertices(rows: NDArray[np.integer]) -> PointSet:
        return points(body.template[rows], body.shape_directions[rows], body.weights[rows])

    joints = points(body.joint_template, body.joint_directions, np.eye(24))
    keypoints = points(body.keypoint_template, body.keypoint_directions, body.keypoint_weights)
    spheres = body_spheres(body)
    rows, faces = surface or (np.arange(len(body.template)), body.faces)
    return TorchBody(
        joints=joints,
        keypoints=keypoints,
        followed=keypoints.joined(joints),
        proxy=vertices(body.proxy),
        soles=vertices(body.proxy[sole_rows(body, _SOLE_POINTS)].ravel()),
        surface=vertices(rows),
        spheres=points(spheres.template, spheres.directions, spheres.weights),
        radii=torch.as_tensor(spheres.radii, dtype=dtype, device=device),
        pairs=torch.as_tensor(spheres.pairs, device=device),
        faces=np.ascontiguousarray(faces, np.int32),
    )


def sole_rows(body: BodyModel, most: int = 16) -> NDArray[np.int64]:
    """Rows of `body.proxy` under the left and the right foot, (2, S), the same number on both sides, spread evenly."""
    rest = body.rest_vertices(body.neutral_betas)[body.proxy]
    weights = body.weights[body.proxy]
    low = rest[:, 1] < rest[:, 1].min() + _SOLE_THICKNESS_M
    sides = []
    for side in ("left", "right"):
        feet = weights[:, [joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")]].sum(axis=1) > 0.5
        sides.append(np.flatnonzero(low & feet))
    count = min(most, *(len(rows) for rows in sides))
    if count == 0:
        raise ValueError("the body's proxy has no vertices under the feet")
    return np.stack([rows[farthest_points(rest[rows], [int(rest[rows, 2].argmin())], count)] for rows in sides])


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

    @property
    def offsets(self) -> Tensor:
        """(N, T, 24, 3) joint j carries a rest point v to R_j v + offset_j."""
        return self.positions - (self.rotations @ self.rest_joints[:, None, :, :, None])[..., 0]

    def skin_each(self, rest: Tensor, weights: Tensor) -> Tensor:
        """Posed points (N, T, P, 3) of other rest points (N, T, P, 3) and weights (N, T, P, 24) in every frame."""
        turns = (weights @ self.rotations.flatten(3)).unflatten(-1, (3, 3))
        return (turns @ rest[..., None])[..., 0] + weights @ self.offsets

    def skin(self, points: PointSet, betas: Tensor) -> Tensor:
        """Posed points (N, T, P, 3), metres: one matrix product a person for the whole clip."""
        rest = points.rest(betas)
        people, frames = self.positions.shape[:2]
        # sum_j w_j (R_j v + o_j) = [w_j v, w_j] . [R_j^T; o_j]: coefficients (P, 96) serve all frames of a person.
        turned = (points.weights[:, :, None] * rest[:, :, None, :]).flatten(-2)
        coefficients = torch.cat([turned, points.weights.expand(people, -1, -1)], dim=-1)
        columns = torch.cat([self.rotations.transpose(-1, -2).flatten(2, 3), self.offsets], dim=-2)
        flat = columns.transpose(-1, -2).reshape(people, frames * 3, -1) @ coefficients.transpose(-1, -2)
        return flat.reshape(people, frames, 3, -1).transpose(-1, -2)


def pose(theta: Tensor, betas: Tensor, body: TorchBody) -> Posed:
    """Forward kinematics of theta (N, T, 24, 3) with betas (N, 10)."""
    rest = body.joints.rest(betas)
    rotations, positions = pose_joints(theta, rest[:, None])
    return Posed(rotations, positions, rest)
