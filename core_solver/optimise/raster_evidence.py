"""What bodies cover in the picture: mean depths with their derivatives, and outlines beside the masks' edges."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.camera import Camera
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.masks import ideal_grids, raster_grid
from core_solver.optimise.picture_terms import ContourTerms, DepthTerms
from core_solver.optimise.posing import PointSet
from core_solver.optimise.variables import Variables, of_frames
from core_solver.raster import Contours, Pinhole, contours, depth_buffer, solve_terms, visibility
from core_solver.scene.sampling import BodyDepth, sample_bodies
from core_solver.tracking.tracks import Modalities

_REACH = 0.04  # of the grid's longer side: how far an outline looks for its mask's edge
_CHUNK = 64  # frames whose bodies are held at once
_FULL_TRUST_SHARE = 0.25  # of a body's pixels inside its mask


@dataclass(frozen=True)
class Grids:
    """The picture on the ideal camera's grid.

    Attributes:
        pinhole: the camera.
        pixel: (2,) footage pixels in a grid pixel, along u and v.
        labels: (T, H, W) uint8.
        disparity: (T, H, W) float16, None without.
    """

    pinhole: Pinhole
    pixel: tuple[float, float]
    labels: NDArray[np.uint8]
    disparity: NDArray[np.float16] | None


def read_grids(modalities: Modalities, camera: Camera, long_side: int) -> Grids:
    """Labels and disparity without distortion, at this resolution."""
    pinhole = raster_grid(camera, long_side)
    disparity = modalities.disparity
    return Grids(
        pinhole,
        (camera.width / pinhole.width, camera.height / pinhole.height),
        ideal_grids(modalities.labels, camera, pinhole),
        None if disparity is None else ideal_grids(disparity, camera, pinhole),
    )


def no_depth(v: Variables) -> DepthTerms:
    """No evidence of depth."""
    zero = torch.zeros_like(v.translation[..., 0])
    return DepthTerms(v, zero, zero[..., None].expand(-1, -1, 75), zero, zero[..., None].expand(-1, -1, 2), zero)


def find_contours(energy: JointEnergy, v: Variables, grids: Grids, ids: list[int], samples: int) -> ContourTerms:
    """Outlines of all bodies and where their masks end, in footage pixels."""
    reach = max(2, round(_REACH * max(grids.pinhole.width, grids.pinhole.height)))
    parts = [
        contours(
            _surfaces(energy, of_frames(v, frames)), energy.body.faces, grids.pinhole, grids.labels[frames], ids,
            samples, reach,
        )
        for frames in _chunks(v)
    ]  # fmt: skip

    def joined(name: str) -> NDArray:
        return np.swapaxes(np.concatenate([getattr(part, name) for part in parts]), 0, 1)

    found = Contours(*(joined(name) for name in ("face", "barycentric", "axis", "here", "target", "weight")))
    axis = found.axis.astype(np.int64)
    total = np.maximum(found.weight.sum(axis=-1, keepdims=True), 1e-9)
    share = (found.weight > 0).mean(axis=-1, keepdims=True)
    like = v.theta
    return ContourTerms(
        corners=torch.as_tensor(energy.body.faces[found.face].astype(np.int64), device=like.device),
        barycentric=torch.as_tensor(found.barycentric, dtype=like.dtype, device=like.device),
        axis=torch.as_tensor(axis, device=like.device),
        target=torch.as_tensor(found.target * np.array(grids.pixel)[axis], dtype=like.dtype, device=like.device),
        weight=torch.as_tensor(found.weight / total * share, dtype=like.dtype, device=like.device),
    )


def pixel_depth(energy: JointEnergy, v: Variables, grids: Grids, ids: list[int]) -> DepthTerms:
    """Mean log depths over every pixel that is body, mask and visible, as the paper defines them."""
    chunks = [_pixel_depth_of(energy, v, grids, ids, frames) for frames in _chunks(v)]
    body, rows, inverse, weight = (torch.cat(parts, 1) for parts in zip(*chunks, strict=True))
    return DepthTerms(v, body, rows, inverse[..., 0], inverse[..., 1:], weight)


def _pixel_depth_of(
    energy: JointEnergy, v: Variables, grids: Grids, ids: list[int], frames: slice
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    part, faces, like = of_frames(v, frames), energy.body.faces, v.theta
    surfaces = _surfaces(energy, part)
    terms = solve_terms(surfaces, faces, grids.pinhole, grids.labels[frames], ids)
    scene = _scene_means(surfaces, faces, grids, ids, part, frames)

    def tensor(values: NDArray) -> Tensor:
        return torch.as_tensor(np.swapaxes(values, 0, 1).copy(), dtype=like.dtype, device=like.device)

    gradient = tensor(terms.log_depth_gradient)
    rows = torch.stack([_row(energy, part, n, gradient[n]) for n in range(energy.people)])
    return tensor(terms.log_depth), rows, tensor(scene[0]), tensor(scene[1])


def _row(energy: JointEnergy, v: Variables, n: int, gradient: Tensor) -> Tensor:
    """(T, 75) of one person: frames do not see each other's angles, so one backward pass gives every frame's row."""
    leaves = v.leaves()
    turns, moves = torch.autograd.grad(
        (gradient * _metric(energy, leaves, n, energy.body.surface)[0]).sum(), [leaves.theta, leaves.translation]
    )
    return torch.cat([turns[n].flatten(1), moves[n]], -1)


def _scene_means(
    surfaces: NDArray[np.float32], faces: NDArray[np.int32], grids: Grids, ids: list[int], v: Variables, frames: slice
) -> tuple[NDArray, NDArray]:
    """M of the depth map with its two derivatives (T, N, 3), and the weight (T, N)."""
    assert grids.disparity is not None  # noqa: S101 - asked by the caller
    labels, disparity = grids.labels[frames], grids.disparity[frames]
    visible = visibility(surfaces, faces, grids.pinhole, labels, ids)
    far = torch.exp(v.log_inverse_far).cpu().double().numpy()
    gap = torch.exp(v.log_inverse_gap).cpu().double().numpy()
    count = len(surfaces)
    means, weight = np.zeros((*surfaces.shape[:2], 3)), np.zeros(surfaces.shape[:2])
    for n, label in enumerate(ids):
        drawn = depth_buffer(surfaces[:, n], faces, grids.pinhole)[1] >= 0
        frame, row, column = np.nonzero(drawn & (labels == label) & (visible[:, n] > 0))
        below = disparity[frame, row, column]
        known = np.isfinite(below)
        frame, below = frame[known], below[known]
        near = gap[frame] * below
        inverse = far[frame] + near
        pixels = np.bincount(frame, minlength=count)
        for field, values in enumerate((-np.log(inverse), -far[frame] / inverse, -near / inverse)):
            means[:, n, field] = np.bincount(frame, values, minlength=count) / np.maximum(pixels, 1)
        weight[:, n] = np.minimum(1, pixels / np.maximum(_FULL_TRUST_SHARE * drawn.sum(axis=(1, 2)), 1))
    return means, weight


def vertex_depth(
    energy: JointEnergy, v: Variables, evidence: Evidence, modalities: Modalities, camera: Camera
) -> DepthTerms:
    """The same means over the visible proxy vertices: cheaper, and nearly as good."""
    with torch.no_grad():
        proxy = torch.cat([_metric(energy, v, n, energy.body.proxy) for n in range(energy.people)])
    depth = sample_bodies(proxy.cpu().double().numpy(), evidence.valid, modalities, camera)
    people = [_depth_of_person(energy, v, n, depth) for n in range(energy.people)]
    body, rows, scene, scene_rows = (torch.cat(parts) for parts in zip(*people, strict=True))
    return DepthTerms(
        v, body, rows, scene, scene_rows, torch.as_tensor(depth.weight, dtype=body.dtype, device=body.device)
    )


def _depth_of_person(
    energy: JointEnergy, v: Variables, n: int, depth: BodyDepth
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """M of the body with its rows, and M of the depth map with its rows; leading dimension 1."""
    leaves = v.leaves()
    visible = torch.as_tensor(depth.visible[n : n + 1], dtype=v.theta.dtype, device=v.theta.device)
    disparity = torch.as_tensor(depth.disparity[n : n + 1], dtype=v.theta.dtype, device=v.theta.device)
    count = visible.sum(-1).clamp_min(1)
    points = _metric(energy, leaves, n, energy.body.proxy)
    body = (visible * torch.log(points[..., 2].clamp_min(0.05))).sum(-1) / count
    turns, moves = torch.autograd.grad(body.sum(), [leaves.theta, leaves.translation])
    far, gap = torch.exp(v.log_inverse_far)[None, :, None], torch.exp(v.log_inverse_gap)[None, :, None]
    inverse = far + gap * disparity
    scene = -(visible * torch.log(inverse)).sum(-1) / count
    far_row = -(visible * far / inverse).sum(-1) / count
    gap_row = -(visible * gap * disparity / inverse).sum(-1) / count
    rows = torch.cat([turns[n].flatten(1), moves[n]], -1)[None]
    return body.detach(), rows, scene, torch.stack([far_row, gap_row], -1)


def _metric(energy: JointEnergy, v: Variables, n: int, points: PointSet) -> Tensor:
    """(1, T, P, 3) metres, camera frame."""
    one = slice(n, n + 1)
    posed = energy.posed(v, n)
    return torch.exp(v.log_scale[n]) * (posed.skin(points, v.betas[one]) + v.translation[one, :, None])


def _surfaces(energy: JointEnergy, v: Variables) -> NDArray[np.float32]:
    """(T, N, V, 3) metres, camera frame."""
    with torch.no_grad():
        people = torch.cat([_metric(energy, v, n, energy.body.surface) for n in range(energy.people)])
        return np.ascontiguousarray(people.transpose(0, 1).cpu().float().numpy())


def _chunks(v: Variables) -> list[slice]:
    frames = v.theta.shape[1]
    return [slice(start, min(start + _CHUNK, frames)) for start in range(0, frames, _CHUNK)]
