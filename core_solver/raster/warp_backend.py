"""The fused operator on a GPU, by Warp (an optional package). The same kernels run on the CPU, slowly, for tests.

On a GPU sums run in whatever order threads come: results repeat up to rounding, not to the bit.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.errors import UserError
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.terms import RasterTerms, as_bytes, owners_for

try:
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING  # no greeting on the console
    from core_solver.raster import warp_kernels as kernels
except ImportError as error:
    raise UserError('the GPU needs Warp: pip install "scene-aware-mocap[cuda]"') from error

_BODIES_AT_ONCE = 256  # about 9 bytes a pixel each


@dataclass(frozen=True)
class _Bodies:
    """B bodies on the device, drawn: vertices (B, V), screen (B, V), faces (F,), keys (B, H, W)."""

    vertices: wp.array
    screen: wp.array
    faces: wp.array
    keys: wp.array
    lens: wp.vec4


def fused_by_warp(
    vertices: ArrayLike,
    faces: ArrayLike,
    pinhole: Pinhole,
    masks: ArrayLike,
    visible: ArrayLike | None = None,
    device: str = "cuda",
) -> RasterTerms:
    """`terms.fused` on a Warp device, "cuda", "cuda:1" or "cpu".

    Raises:
        UserError: no such device.
    """
    vertices = np.ascontiguousarray(vertices, np.float32)
    shape = (len(vertices), pinhole.height, pinhole.width)
    masks = as_bytes(masks, shape)
    visible = np.ones(shape, np.uint8) if visible is None else as_bytes(visible, shape)
    with _on(device):
        parts = [
            _fuse(vertices[part], faces, pinhole, masks[part], visible[part])
            for part in _parts(len(vertices), _BODIES_AT_ONCE)
        ]
    return _joined(parts, vertices.shape)


def solve_terms_by_warp(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike, device: str = "cuda"
) -> RasterTerms:
    """`terms.solve_terms` on a Warp device, "cuda", "cuda:1" or "cpu".

    Raises:
        UserError: no such device.
    """
    vertices = np.ascontiguousarray(vertices, np.float32)
    labels = as_bytes(labels, (len(vertices), pinhole.height, pinhole.width))
    owners = owners_for(ids, vertices).astype(np.int32)
    with _on(device):
        parts = [
            _solve(vertices[part], faces, pinhole, labels[part], owners)
            for part in _parts(len(vertices), max(1, _BODIES_AT_ONCE // max(vertices.shape[1], 1)))
        ]
    return _joined(parts, vertices.shape)


def _on(device: str) -> wp.ScopedDevice:
    try:
        return wp.ScopedDevice(device)
    except (ValueError, RuntimeError) as error:
        raise UserError(f"there is no device {device} here that Warp can use: choose cpu") from error


def _parts(count: int, size: int) -> list[slice]:
    return [slice(start, start + size) for start in range(0, count, size)]


def _fuse(
    vertices: NDArray, faces: ArrayLike, pinhole: Pinhole, masks: NDArray[np.uint8], visible: NDArray[np.uint8]
) -> RasterTerms:
    bodies = _draw(vertices, faces, pinhole)
    cost = wp.zeros(bodies.keys.shape, dtype=wp.int8)
    wp.launch(kernels.cost_by_masks, cost.shape, [_sent(masks), _sent(visible), cost])
    return _compare(bodies, cost)


def _solve(
    vertices: NDArray, faces: ArrayLike, pinhole: Pinhole, labels: NDArray[np.uint8], owners: NDArray[np.int32]
) -> RasterTerms:
    people = vertices.shape[1]
    bodies = _draw(vertices.reshape(-1, *vertices.shape[2:]), faces, pinhole)
    count = bodies.keys.shape[0]
    sums, counts = wp.zeros(count, dtype=wp.float64), wp.zeros(count, dtype=wp.int32)
    cost = wp.zeros(bodies.keys.shape, dtype=wp.int8)
    wp.launch(kernels.add_depths, bodies.screen.shape, [bodies.screen, sums, counts])
    wp.launch(
        kernels.cost_by_labels, cost.shape, [_sent(labels), _sent(owners), people, bodies.keys, sums, counts, cost]
    )
    return _compare(bodies, cost)


def _draw(vertices: NDArray, faces: ArrayLike, pinhole: Pinhole) -> _Bodies:
    """Send bodies (B, V, 3) to the device and draw them."""
    corners = np.ascontiguousarray(faces, np.int32)
    bodies = _Bodies(
        vertices=wp.array(vertices, dtype=wp.vec3),
        screen=wp.zeros(vertices.shape[:2], dtype=wp.vec3),
        faces=wp.array(corners, dtype=wp.vec3i),
        keys=wp.zeros((len(vertices), pinhole.height, pinhole.width), dtype=wp.uint64),
        lens=wp.vec4(*pinhole.lens.tolist()),
    )
    wp.launch(kernels.project, vertices.shape[:2], [bodies.vertices, bodies.lens, bodies.screen])
    wp.launch(kernels.draw, (len(vertices), len(corners)), [bodies.screen, bodies.faces, bodies.keys])
    return bodies


def _sent(values: NDArray) -> wp.array:
    return wp.array(np.ascontiguousarray(values))


def _compare(bodies: _Bodies, cost: wp.array) -> RasterTerms:
    count, lens = cost.shape[0], bodies.lens
    logs = wp.zeros(count, dtype=wp.float64)
    pixels, claimed, costs = (wp.zeros(count, dtype=wp.int32) for _ in range(3))
    by_depth, by_outline = (wp.zeros(bodies.screen.shape, dtype=wp.vec3) for _ in range(2))
    wp.launch(
        kernels.shade,
        cost.shape,
        [bodies.screen, bodies.faces, bodies.keys, cost, logs, pixels, claimed, costs, by_depth, by_outline],
    )
    for amounts, slopes in ((pixels, by_depth), (claimed, by_outline)):
        wp.launch(kernels.to_camera_frame, slopes.shape, [bodies.vertices, bodies.screen, lens, amounts, slopes])
    met, wanted = pixels.numpy(), claimed.numpy()
    return RasterTerms(
        log_depth=(logs.numpy() / np.maximum(met, 1)).astype(np.float32),
        pixels=met,
        log_depth_gradient=by_depth.numpy(),
        silhouette=np.where(wanted > 0, (wanted + costs.numpy()) / np.maximum(wanted, 1), 0).astype(np.float32),
        silhouette_gradient=by_outline.numpy(),
    )


def _joined(parts: list[RasterTerms], shape: tuple[int, ...]) -> RasterTerms:
    """One record of all bodies, in the shape of their vertices (..., V, 3)."""
    bodies = shape[:-2]
    return RasterTerms(
        log_depth=_rows(parts, "log_depth", bodies, np.float32),
        pixels=_rows(parts, "pixels", bodies, np.int32),
        log_depth_gradient=_rows(parts, "log_depth_gradient", shape, np.float32),
        silhouette=_rows(parts, "silhouette", bodies, np.float32),
        silhouette_gradient=_rows(parts, "silhouette_gradient", shape, np.float32),
    )


def _rows(parts: list[RasterTerms], name: str, shape: tuple[int, ...], dtype: type) -> NDArray:
    rows = [getattr(part, name) for part in parts]
    return np.concatenate(rows).reshape(shape) if rows else np.zeros(shape, dtype)
