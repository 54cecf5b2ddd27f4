"""Measure the raster operator against its bars: `python -m core_solver.raster.benchmark`.

The body is a mannequin with as many vertices and faces as SMPL, about 63 % of the picture's height tall, standing a few
pixels beside its mask. Times are CPU time on one thread, the best of several rounds, without compilation.
"""

import importlib.util
import time
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from core_solver.raster.contours import contours
from core_solver.raster.depth import depth_buffer
from core_solver.raster.mannequin import PARAMETERS, Mannequin, build_mannequin
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.reference import antialiased_silhouette, reference_terms
from core_solver.raster.soft import soft_silhouette
from core_solver.raster.terms import fused, solve_terms

_BODIES = 32
_ROUNDS = 7
_SOFTNESS = 0.3  # squared pixels

_FULL = Pinhole(512, 288, 420.0, 420.0, 256.0, 144.0)
_HALF = Pinhole(256, 144, 210.0, 210.0, 128.0, 72.0)
_SQUARE = Pinhole(256, 256, 373.0, 373.0, 128.0, 128.0)

_LIMB_ANGLES = np.full(PARAMETERS - 3, 0.15)
_HERE = np.array([0.0, 0.0, 3.9, *_LIMB_ANGLES], np.float64)
_THERE = _HERE + np.array([0.05, 0.03, 0.1, *np.full(PARAMETERS - 3, 0.06)], np.float64)
# Steps that move the picture by about half a pixel: along x, y and z, and of each limb.
_STEPS = np.array([0.005, 0.005, 0.025, *np.full(PARAMETERS - 3, 0.012)], np.float64)


@dataclass(frozen=True)
class Row:
    """One line of the table; `passed` is None where there is no bar."""

    what: str
    measured: str
    bar: str = ""
    passed: bool | None = None


def main() -> None:
    """Print the table."""
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    torch.set_num_threads(1)
    try:
        for row in _all_rows():
            verdict = {None: "", True: "pass", False: "MISSED"}[row.passed]
            print(f"{row.what:<66} {row.measured:>14}  {row.bar:>10}  {verdict}", flush=True)
    finally:
        numba.set_num_threads(threads)


def _all_rows() -> list[Row]:
    body, proxy = build_mannequin(6890), build_mannequin(502)
    return [
        *_speed_rows("6890 vertices, 512x288", body, _FULL, bar=0.8),
        *_speed_rows("502 vertices, 256x144", proxy, _HALF, bar=0.12),
        _soft_row(body),
        _warp_row(body),
        *_reference_rows(body),
        *_slope_rows("6890 vertices, 512x288", body, _FULL),
    ]


def _speed_rows(name: str, figure: Mannequin, pinhole: Pinhole, bar: float) -> list[Row]:
    vertices, mask = _crowd(figure), _mask(figure, pinhole)
    masks = np.repeat(mask[None], _BODIES, axis=0)
    clip, labels, everywhere = vertices[:, None], masks.astype(np.uint8), np.ones_like(masks)
    milliseconds = _milliseconds(lambda: fused(vertices, figure.faces, pinhole, masks, everywhere))
    as_clip = _milliseconds(lambda: solve_terms(clip, figure.faces, pinhole, labels, [1]))
    traced = _milliseconds(lambda: contours(clip, figure.faces, pinhole, labels, [1]))
    return [
        Row(f"depth + silhouette + gradients, {name}", f"{milliseconds:.3f} ms", f"<= {bar:g}", milliseconds <= bar),
        Row(f"the same with visibility from labels, {name}", f"{as_clip:.3f} ms"),
        Row(f"48 points of the outline, {name}", f"{traced:.3f} ms"),
    ]


def _soft_row(figure: Mannequin) -> Row:
    vertices, mask = _crowd(figure)[:2], np.repeat(_mask(figure, _FULL)[None], 2, axis=0)
    run = _milliseconds(lambda: soft_silhouette(vertices, figure.faces, _FULL, mask, mask | True, _SOFTNESS), bodies=2)
    return Row("soft silhouette, all faces, with gradient, 6890 vertices, 512x288", f"{run:.1f} ms")


def _warp_row(figure: Mannequin) -> Row:
    name = "depth + silhouette + gradients by Warp, 6890 vertices, 512x288"
    if importlib.util.find_spec("warp") is None:
        return Row(name, "not installed")
    import warp as wp  # noqa: PLC0415  (an optional package)

    from core_solver.raster.warp_backend import fused_by_warp  # noqa: PLC0415

    device = "cuda" if wp.is_cuda_available() else "cpu"
    vertices = _crowd(figure)
    masks = np.repeat(_mask(figure, _FULL)[None], _BODIES, axis=0)
    run = lambda: fused_by_warp(vertices, figure.faces, _FULL, masks, device=device)  # noqa: E731
    # On a GPU the work is not CPU time, so the clock on the wall counts.
    return Row(f"{name}, {device}", f"{_milliseconds(run, clock=time.perf_counter):.3f} ms")


def _reference_rows(figure: Mannequin) -> list[Row]:
    """Time and results of the plain torch reference, one body once."""
    vertices, mask = figure.posed(_HERE)[None], _mask(figure, _SQUARE)[None]
    ours = _milliseconds(lambda: fused(vertices, figure.faces, _SQUARE, mask), bodies=1)
    tensor = torch.tensor(vertices, requires_grad=True)
    faces, seen = torch.tensor(figure.faces, dtype=torch.long), torch.ones(mask.shape, dtype=torch.bool)
    start = time.process_time()
    reference = reference_terms(tensor, faces, _SQUARE, torch.tensor(mask), seen)
    reference.log_depth.sum().backward()
    theirs = 1000 * (time.process_time() - start)
    terms = fused(vertices, figure.faces, _SQUARE, mask)
    difference = abs(terms.log_depth[0] / reference.log_depth.item() - 1)
    assert tensor.grad is not None  # noqa: S101  (for the type checker)
    agreement = _cosine(terms.log_depth_gradient, tensor.grad.numpy())
    return [
        Row("plain torch reference, 6890 vertices, 256x256", f"{theirs:.0f} ms"),
        Row("fused operator, the same", f"{ours:.3f} ms"),
        Row("times faster", f"{theirs / ours:.0f}", ">= 2000", theirs / ours >= 2000),
        Row("mean log depth, relative difference", f"{difference:.1e}", "<= 1e-5", difference <= 1e-5),
        Row("its gradient, cosine", f"{agreement:.7f}", ">= 0.9999", agreement >= 0.9999),
    ]


def _slope_rows(name: str, figure: Mannequin, pinhole: Pinhole) -> list[Row]:
    """Silhouette gradients against central differences of the silhouette with 8 x 8 points a pixel."""
    mask = _mask(figure, pinhole)[None]

    def loss(parameters: NDArray[np.float64]) -> float:
        vertices = figure.posed(parameters)[None]
        return float(antialiased_silhouette(vertices, figure.faces, pinhole, mask, mask | True)[0])

    gradient = fused(figure.posed(_HERE)[None], figure.faces, pinhole, mask).silhouette_gradient[0]
    ours, truth = [], []
    for step in np.diag(_STEPS):
        ours.append(np.sum(gradient * (figure.posed(_HERE + step) - figure.posed(_HERE - step))))
        truth.append(loss(_HERE + step) - loss(_HERE - step))
    translation, pose = (_cosine(np.array(ours[part]), np.array(truth[part])) for part in (slice(3), slice(3, None)))
    return [
        Row(f"gradient by translation, cosine, {name}", f"{translation:.5f}", ">= 0.999", translation >= 0.999),
        Row(f"gradient by pose, cosine, {name}", f"{pose:.5f}", ">= 0.99", pose >= 0.99),
    ]


def _crowd(figure: Mannequin) -> NDArray[np.float32]:
    """(_BODIES, V, 3) the figure at slightly different places."""
    shifts = np.random.default_rng(0).normal(0, 0.03, (_BODIES, 1, 3))
    return (figure.posed(_HERE) + shifts).astype(np.float32)


def _mask(figure: Mannequin, pinhole: Pinhole) -> NDArray[np.bool_]:
    """(H, W) the figure a few pixels away."""
    return depth_buffer(figure.posed(_THERE)[None], figure.faces, pinhole)[1][0] >= 0


def _milliseconds(
    run: Callable[[], object], bodies: int = _BODIES, clock: Callable[[], float] = time.process_time
) -> float:
    """Best time a body of several rounds, after one that compiles."""
    run()
    times = []
    for _ in range(_ROUNDS):
        start = clock()
        run()
        times.append(clock() - start)
    return 1000 * min(times) / bodies


def _cosine(a: NDArray, b: NDArray) -> float:
    return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))


if __name__ == "__main__":
    main()
