"""The paper's two raster terms of a whole clip, evaluated a few frames at a time."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.camera import Camera
from core_solver.energy import paper as energy
from core_solver.raster import Pinhole, depth_buffer, fused, visibility
from core_solver.raster.soft import soft_silhouette
from core_solver.scene.sampling import sample_frames
from core_solver.tracking.tracks import UNCLAIMED, Modalities

Array = NDArray[np.float64]

_SOFTNESS = 1e-4  # PyTorch3D's sigma, in squares of half the shorter side
_NEAR_M, _FAR_M = 1.0, 30.0  # of a clip whose disparity tells nothing


@dataclass(frozen=True)
class DepthRange:
    """Each frame's near and far depth.

    Attributes:
        near: (T,) metres, > 0.
        far: (T,) metres, > near.
    """

    near: Tensor
    far: Tensor

    def inverse(self) -> tuple[Tensor, Tensor]:
        """(T,) 1 / z_far and (T,) 1 / z_near - 1 / z_far: inverse depth is linear in disparity (eq. inv_depth)."""
        return 1 / self.far, 1 / self.near - 1 / self.far


@dataclass(frozen=True)
class Picture:
    """Masks and disparity on the raster's grid, which is that of an ideal pinhole.

    Attributes:
        pinhole: the grid.
        faces: (F, 3) of the body.
        ids: labels of the people.
        valid: (N, T) where a person was seen.
        labels: (T, h, w) uint8, UNCLAIMED beyond the footage.
        disparity: (T, h, w) in [0, 1], NaN where unknown; None without.
    """

    pinhole: Pinhole
    faces: NDArray[np.int32]
    ids: tuple[int, ...]
    valid: NDArray[np.bool_]
    labels: NDArray[np.uint8]
    disparity: NDArray[np.float32] | None

    def frame_batches(self, size: int) -> Iterator[slice]:
        """Consecutive frames, `size` at a time."""
        for start in range(0, len(self.labels), size):
            yield slice(start, start + size)


def picture_on_grid(modalities: Modalities, camera: Camera, faces: NDArray[np.int32], longest: int) -> Picture:
    """Resample masks and disparity, without the lens's distortion, onto a grid of at most `longest` pixels a side."""
    scale = min(1.0, longest / max(camera.width, camera.height))
    pinhole = Pinhole.on_grid(camera, max(1, round(camera.width * scale)), max(1, round(camera.height * scale)))
    u, v = np.meshgrid(np.arange(pinhole.width) + 0.5, np.arange(pinhole.height) + 0.5)
    x, y = (u - pinhole.cx) / pinhole.fx, (v - pinhole.cy) / pinhole.fy
    pixels = camera.project(np.stack([x, y, np.ones_like(x)], -1))

    def resample(grids: NDArray, outside: float) -> NDArray:
        return np.stack([sample_frames(grids, np.array(t), pixels, camera, outside) for t in range(len(grids))])

    disparity = modalities.disparity
    return Picture(
        pinhole,
        faces,
        tuple(track.id for track in modalities.tracks),
        np.stack([track.valid for track in modalities.tracks]),
        resample(modalities.labels, UNCLAIMED).astype(np.uint8),
        None if disparity is None else resample(disparity, np.nan).astype(np.float32),
    )


def first_range(picture: Picture, depths: Array) -> tuple[float, float]:
    """z_near and z_far of the clip with which the masks' mean disparities best meet the people's depths.

    Args:
        picture: masks and disparity.
        depths: (N, T) metres.
    """
    disparity, inverse = _mean_disparities(picture, depths)
    if len(inverse) == 0:
        return _NEAR_M, _FAR_M
    # People at one depth say nothing of the far end: then it is three times as far as they are.
    guess, trust = float(np.median(inverse)) / 3, 0.01 * len(inverse)
    normal = np.array([[len(inverse) + trust, disparity.sum()], [disparity.sum(), (disparity**2).sum() + 1e-9]])
    far, _ = np.linalg.solve(normal, [inverse.sum() + trust * guess, disparity @ inverse])
    far = float(np.clip(far, 0.1 * guess, 0.9 * inverse.min()))
    gap = max(float(disparity @ (inverse - far) / max(disparity @ disparity, 1e-9)), 0.1 * guess)
    return 1 / (far + gap), 1 / far


def _mean_disparities(picture: Picture, depths: Array) -> tuple[Array, Array]:
    """(M,) mean disparity in a mask and (M,) inverse depth of its person, where both are known."""
    pairs = []
    for n, t in np.argwhere(picture.valid & (depths > 0)):
        values = _disparity(picture)[t][picture.labels[t] == picture.ids[n]]
        known = values[np.isfinite(values)]
        if len(known):
            pairs.append((known.mean(dtype=float), 1 / depths[n, t]))
    disparity, inverse = np.array(pairs).reshape(-1, 2).T
    return disparity, inverse


def _disparity(picture: Picture) -> NDArray[np.float32]:
    return np.full(picture.labels.shape, np.nan, np.float32) if picture.disparity is None else picture.disparity


@dataclass(frozen=True)
class Bodies:
    """The B valid bodies of some frames.

    Attributes:
        frame: (B,) of the clip.
        vertices: (B, V, 3) metres.
        own: (B, h, w) the person's mask.
        visible: (B, h, w) no other person hides this one there, and nobody unknown.
    """

    frame: NDArray[np.int64]
    vertices: Tensor
    own: NDArray[np.bool_]
    visible: NDArray[np.bool_]


def bodies_in(picture: Picture, frames: slice, vertices: Tensor) -> Bodies:
    """Choose who was seen in some frames; vertices (N, frames, V, 3) metres."""
    seen = picture.valid[:, frames]
    people, rows = np.nonzero(seen)
    labels = picture.labels[frames]
    points = vertices.detach().cpu().numpy()
    # Somebody who was not seen is nowhere, and hides nobody.
    points = np.where(seen[..., None, None], points, np.nan).swapaxes(0, 1)
    visible = visibility(points, picture.faces, picture.pinhole, labels, picture.ids)
    return Bodies(
        frame=rows + frames.start,
        vertices=vertices[torch.as_tensor(people), torch.as_tensor(rows)],
        own=labels[rows] == np.array(picture.ids)[people, None, None],
        visible=visible[rows, people] > 0,
    )


def depth(picture: Picture, bodies: Bodies, depth_range: DepthRange) -> Tensor:
    """E_depth of some bodies, over the pixels in which body, mask, visibility and disparity meet."""
    if picture.disparity is None:
        raise ValueError("E_depth needs disparity")
    disparity = picture.disparity[bodies.frame]
    seen = bodies.visible & np.isfinite(disparity)
    points = bodies.vertices.detach().cpu().numpy()
    terms = fused(points, picture.faces, picture.pinhole, bodies.own, seen)
    body = _with_gradient(bodies.vertices, terms.log_depth, terms.log_depth_gradient)
    shared = bodies.own & seen & (depth_buffer(points, picture.faces, picture.pinhole)[1] >= 0)
    scene = _mean_log_depth(shared, disparity, bodies.frame, depth_range)
    return energy.depth(body, scene, torch.as_tensor(shared.any((1, 2))).to(body))


def _mean_log_depth(
    shared: NDArray[np.bool_], disparity: NDArray[np.float32], frames: NDArray[np.int64], depth_range: DepthRange
) -> Tensor:
    """M of the depth map (B,) over the pixels shared (B, h, w); 0 without any."""
    like = depth_range.near
    body = np.nonzero(shared)[0]
    index, frame = torch.as_tensor(body, device=like.device), torch.as_tensor(frames[body], device=like.device)
    values = torch.as_tensor(disparity[shared]).to(like)
    far, gap = depth_range.inverse()
    total = like.new_zeros(len(shared)).index_add(0, index, -torch.log(far[frame] + gap[frame] * values))
    return total / torch.bincount(index, minlength=len(shared)).clamp_min(1)


def silhouette(picture: Picture, bodies: Bodies) -> Tensor:
    """E_silhouette of some bodies."""
    points, pinhole = bodies.vertices.detach().cpu().numpy(), picture.pinhole
    sigma = _SOFTNESS * (min(pinhole.width, pinhole.height) / 2) ** 2
    loss, gradient = soft_silhouette(points, picture.faces, pinhole, bodies.own, bodies.visible, sigma)
    # The operator divides by the pixels of the mask, the paper's program by all that are visible.
    claimed = (bodies.own & bodies.visible).sum((1, 2)).astype(np.float32)
    wrong = _with_gradient(bodies.vertices, claimed * loss, claimed[:, None, None] * gradient)
    return energy.silhouette(wrong, torch.as_tensor(bodies.visible.sum((1, 2))).to(wrong))


def _with_gradient(bodies: Tensor, values: NDArray[np.float32], gradients: NDArray[np.float32]) -> Tensor:
    """(B,) values of which the gradients (B, V, 3) by bodies (B, V, 3) are known already."""
    value, gradient = torch.as_tensor(values).to(bodies), torch.as_tensor(gradients).to(bodies)
    return value + (gradient * (bodies - bodies.detach())).sum((-1, -2))
