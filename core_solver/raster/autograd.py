"""The fused operator as a function that torch can differentiate."""

from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from core_solver.raster.pinhole import Pinhole
from core_solver.raster.terms import RasterTerms, solve_terms


def raster_terms(
    vertices: Tensor, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike
) -> tuple[Tensor, Tensor, Tensor]:
    """`solve_terms` of a tensor: numba for tensors on the CPU, Warp for tensors on a GPU.

    Args:
        vertices: (T, N, V, 3) metres, camera frame; any device and floating type.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid of the labels.
        labels: (T, H, W) uint8.
        ids: (N,) labels of the people.

    Returns:
        log_depth (T, N) and silhouette (T, N), differentiable once by the vertices; pixels (T, N) int32.
    """
    return _RasterTerms.apply(vertices, faces, pinhole, labels, ids)  # type: ignore[return-value]


class _RasterTerms(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any, vertices: Tensor, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike
    ) -> tuple[Tensor, Tensor, Tensor]:
        terms = _solve(vertices, faces, pinhole, labels, ids)
        ctx.save_for_backward(_like(terms.log_depth_gradient, vertices), _like(terms.silhouette_gradient, vertices))
        pixels = torch.from_numpy(terms.pixels).to(vertices.device)
        ctx.mark_non_differentiable(pixels)
        return _like(terms.log_depth, vertices), _like(terms.silhouette, vertices), pixels

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, *by_outputs: Tensor) -> tuple[Tensor | None, ...]:  # type: ignore[override]
        by_depth, by_silhouette, _ = by_outputs
        depth, silhouette = ctx.saved_tensors
        return by_depth[..., None, None] * depth + by_silhouette[..., None, None] * silhouette, None, None, None, None


def _solve(vertices: Tensor, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike) -> RasterTerms:
    values = vertices.detach().cpu().numpy()
    if vertices.device.type == "cpu":
        return solve_terms(values, faces, pinhole, labels, ids)
    from core_solver.raster.warp_backend import solve_terms_by_warp  # noqa: PLC0415  (an optional package)

    return solve_terms_by_warp(values, faces, pinhole, labels, ids, device=str(vertices.device))


def _like(values: np.ndarray, tensor: Tensor) -> Tensor:
    return torch.from_numpy(values).to(tensor)
