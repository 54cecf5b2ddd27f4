"""The raster operator written down plainly in torch: slow, without approximations, and the truth for the fast ones.

Everything is dense: every face is held against every pixel. Depth and soft silhouettes are differentiable by autograd;
the hard silhouette is a count and has no slope, so `antialiased_silhouette` measures it finely enough for differences.
"""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray
from torch import Tensor

from core_solver.raster.depth import depth_buffer
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.zbuffer import NEAR

_EDGE_ON = 1e-4  # as in `zbuffer`
_PAIRS_AT_ONCE = 4_000_000  # faces times pixels that are held in memory


@dataclass(frozen=True)
class ReferenceTerms:
    """Terms of bodies as in `terms.RasterTerms`, gradients left to autograd.

    Attributes:
        log_depth: (B,) differentiable.
        pixels: (B,) integers.
        silhouette: (B,) a constant.
    """

    log_depth: Tensor
    pixels: Tensor
    silhouette: Tensor


def reference_terms(
    vertices: Tensor, faces: Tensor, pinhole: Pinhole, masks: Tensor, visible: Tensor
) -> ReferenceTerms:
    """Mean log depth and silhouette error of bodies, as `terms.fused`.

    Args:
        vertices: (B, V, 3) metres, camera frame.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid.
        masks: (B, H, W) bool.
        visible: (B, H, W) bool.
    """
    rows = [_body_terms(*body, faces, pinhole) for body in zip(vertices, masks, visible, strict=True)]
    log_depth, pixels, silhouette = (torch.stack(column) for column in zip(*rows, strict=True))
    return ReferenceTerms(log_depth, pixels, silhouette)


def _body_terms(
    vertices: Tensor, mask: Tensor, visible: Tensor, faces: Tensor, pinhole: Pinhole
) -> tuple[Tensor, Tensor, Tensor]:
    depth, covered = reference_depth(vertices, faces, pinhole)
    meet, claimed = covered & mask & visible, (mask & visible).sum()
    pixels = meet.sum()
    log_depth = torch.log(depth[meet]).sum() / pixels.clamp(min=1)
    wrong = ((covered != mask) & visible).sum()
    return log_depth, pixels, torch.where(claimed > 0, wrong / claimed.clamp(min=1), torch.zeros(()))


def reference_depth(vertices: Tensor, faces: Tensor, pinhole: Pinhole) -> tuple[Tensor, Tensor]:
    """Depth (H, W) of one body (V, 3) at pixel centres, inf where empty, and where it is covered (H, W)."""
    corners, inverse, _ = _front_faces(vertices, faces, pinhole)
    points = _pixel_centres(pinhole, vertices)
    nearest = torch.zeros(len(points), dtype=vertices.dtype)
    winner = torch.full((len(points),), -1)
    with torch.no_grad():
        step = max(1, _PAIRS_AT_ONCE // len(points))
        for start in range(0, len(corners), step):
            shares = _barycentric(corners[start : start + step, None], points[None])
            here = (shares * inverse[start : start + step, None]).sum(-1)
            best, face = torch.where((shares >= 0).all(-1), here, 0).max(0)
            winner = torch.where(best > nearest, face + start, winner)
            nearest = torch.maximum(nearest, best)
    covered = winner >= 0
    shares = _barycentric(corners[winner[covered]], points[covered])
    depth = torch.full((len(points),), torch.inf, dtype=vertices.dtype)
    depth = depth.masked_scatter(covered, 1 / (shares * inverse[winner[covered]]).sum(-1))
    grid = (pinhole.height, pinhole.width)
    return depth.reshape(grid), covered.reshape(grid)


def reference_soft_silhouette(
    vertices: Tensor, faces: Tensor, pinhole: Pinhole, masks: Tensor, visible: Tensor, sigma: float
) -> Tensor:
    """Loss (B,) of `soft.soft_silhouette`, differentiable."""
    return torch.stack(
        [
            _soft_loss(vertex_row, faces, pinhole, mask, seen, sigma)
            for vertex_row, mask, seen in zip(vertices, masks, visible, strict=True)
        ]
    )


def _soft_loss(
    vertices: Tensor, faces: Tensor, pinhole: Pinhole, mask: Tensor, visible: Tensor, sigma: float
) -> Tensor:
    corners, _, drawable = _project(vertices, faces, pinhole)
    corners, points = corners[drawable], _pixel_centres(pinhole, vertices)
    ends = torch.roll(corners, -1, dims=1)
    edge = (ends - corners)[:, None]  # (F, 1, 3, 2)
    arm = points[None, :, None] - corners[:, None]  # (F, P, 3, 2)
    along = ((arm * edge).sum(-1) / (edge * edge).sum(-1)).clamp(0, 1)
    squared = ((arm - along[..., None] * edge) ** 2).sum(-1).amin(-1)  # (F, P)
    inside = (_barycentric(corners[:, None], points[None]) >= 0).all(-1)
    exponent = torch.where(inside, squared, -squared) / sigma
    # log of the product of 1 - sigmoid(x), which is -softplus(x) for each face
    empty = torch.exp(-torch.nn.functional.softplus(exponent).sum(0))
    claimed = (mask & visible).sum()
    error = ((1 - empty - mask.reshape(-1).to(empty)) ** 2)[visible.reshape(-1)].sum()
    return error / claimed if claimed > 0 else error * 0


def antialiased_silhouette(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, masks: ArrayLike, visible: ArrayLike, factor: int = 8
) -> NDArray[np.float64]:
    """Silhouette error (B,) in which pixels count by the share a body covers of them.

    Args:
        vertices: (B, V, 3) metres, camera frame.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid of the masks.
        masks: (B, H, W) bool.
        visible: (B, H, W) bool.
        factor: points along each side of a pixel at which the body is looked for.
    """
    masks, visible = np.asarray(masks, bool), np.asarray(visible, bool)
    fine = Pinhole(
        pinhole.width * factor, pinhole.height * factor,
        pinhole.fx * factor, pinhole.fy * factor, pinhole.cx * factor, pinhole.cy * factor,
    )  # fmt: skip
    errors = np.zeros(len(masks))
    for body, body_vertices in enumerate(np.asarray(vertices)):
        covered = depth_buffer(body_vertices[None], faces, fine)[1][0] >= 0
        share = covered.reshape(pinhole.height, factor, pinhole.width, factor).mean(axis=(1, 3))
        wrong = np.where(masks[body], 1 - share, share)[visible[body]].sum()
        errors[body] = wrong / max((masks[body] & visible[body]).sum(), 1)
    return errors


def _project(vertices: Tensor, faces: Tensor, pinhole: Pinhole) -> tuple[Tensor, Tensor, Tensor]:
    """Corners (F, 3, 2) in pixels, their 1/z (F, 3), and which faces can be drawn at all (F,)."""
    drawable = (torch.isfinite(vertices).all(-1) & (vertices[:, 2] >= NEAR))[faces].all(-1)
    x, y, z = torch.where(drawable[:, None, None], vertices[faces], torch.ones(())).unbind(-1)
    return torch.stack([pinhole.fx * x / z + pinhole.cx, pinhole.fy * y / z + pinhole.cy], -1), 1 / z, drawable


def _front_faces(vertices: Tensor, faces: Tensor, pinhole: Pinhole) -> tuple[Tensor, Tensor, Tensor]:
    """What `_project` gives, for the faces that look at the camera and are not seen edge-on."""
    corners, inverse, drawable = _project(vertices, faces, pinhole)
    a, b, c = corners.unbind(1)
    extent = ((corners.amax(1) - corners.amin(1)) ** 2).sum(-1)
    front = drawable & (-_cross(b - a, c - a) > _EDGE_ON * extent)
    return corners[front], inverse[front], drawable[front]


def _pixel_centres(pinhole: Pinhole, like: Tensor) -> Tensor:
    """(H * W, 2) pixels."""
    v, u = torch.meshgrid(torch.arange(pinhole.height), torch.arange(pinhole.width), indexing="ij")
    return torch.stack([u, v], -1).reshape(-1, 2).to(like) + 0.5


def _barycentric(corners: Tensor, points: Tensor) -> Tensor:
    """Shares (..., 3) of corners (..., 3, 2) at points (..., 2)."""
    a, b, c = corners.unbind(-2)
    area = _cross(b - a, c - a)
    first, second = _cross(b - points, c - points) / area, _cross(c - points, a - points) / area
    return torch.stack([first, second, 1 - first - second], -1)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
