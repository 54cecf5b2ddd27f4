"""Depth by a declared network: disparity, metric depth, or points from which the field of view follows."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from core_solver.errors import ModelError
from core_solver.perception.disparity import normalise, rounded_size, sharpen_edges
from core_solver.perception.networks.prepare import lay_picture, to_tensor
from core_solver.perception.networks.session import DeclaredSession
from core_solver.perception.networks.spec import NetworkSpec

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]

_FIT_POINTS = 64  # along each side: more fix the field of view no better
_LEAST_POINTS = 16
_LEAST_DEPTH = 1e-4  # of the median depth: nearer is no surface


@dataclass(frozen=True)
class DepthPicture:
    """What a depth network sees.

    Attributes:
        inverse_depth: (h, w) up to scale and, from relative networks, shift; NaN where there is no surface.
        field_of_view: degrees along the picture's longer side, None where the network does not say.
    """

    inverse_depth: Floats
    field_of_view: float | None


class DeclaredDepth:
    """A declared depth network, used like `perception.disparity.DisparityNetwork`."""

    def __init__(self, spec: NetworkSpec, device: str) -> None:
        """Open the network.

        Raises:
            ModelError: the file is not as declared.
        """
        self.path = spec.file
        self._spec = spec
        self._session = DeclaredSession(spec, device)

    def __call__(self, image: Image) -> NDArray[np.float16]:
        """Disparity (h, w) in [0, 1] of a (H, W, 3) BGR picture, near = large; edges are steps.

        Raises:
            ModelError: the network fails.
        """
        return sharpen_edges(normalise(self.look(image).inverse_depth)).astype(np.float16)

    def look(self, image: Image) -> DepthPicture:
        """Inverse depth and field of view of a (H, W, 3) BGR picture.

        Raises:
            ModelError: the network fails.
        """
        height, width = image.shape[:2]
        spec = self._spec
        size = self._session.size or rounded_size(width, height, spec.longer_side, spec.multiple)
        laid, _ = lay_picture(image, size, spec)
        outputs = self._session([to_tensor(laid, spec)])
        if spec.decoder == "points":
            return read_points(outputs[0], outputs[1], (width, height), shifted=spec.shift)
        plane = plane_of(outputs[0])
        if spec.decoder == "disparity":
            return DepthPicture(plane, None)
        focal = outputs[1]
        view = None if focal is None else focal_view(float(focal.ravel()[0]), spec.focal, (width, height), size[0])
        return DepthPicture(inverse(plane), view)


def plane_of(output: NDArray | None) -> Floats:
    """(h, w) from an output with further axes of length 1."""
    if output is None or np.squeeze(output).ndim != 2:
        raise ModelError("a depth network must give one value per pixel of a picture larger than one row")
    return np.squeeze(output).astype(np.float32)


def inverse(depth: Floats) -> Floats:
    """1 / depth, NaN where the depth is none."""
    known = np.isfinite(depth) & (depth > 0)
    known[known] &= depth[known] > _LEAST_DEPTH * np.median(depth[known]) if known.any() else False
    return np.where(known, 1 / np.where(known, depth, 1), np.nan).astype(np.float32)


def focal_view(focal: float, unit: str, picture: tuple[int, int], input_width: int) -> float | None:
    """Degrees along the picture's longer side.

    Args:
        focal: in pixels of the input's width, or as the field of view along the width.
        unit: "pixels", "fov-degrees" or "fov-radians".
        picture: (width, height).
        input_width: pixels.
    """
    if unit == "pixels":
        widths = focal / input_width
    else:
        angle = math.radians(focal) if unit == "fov-degrees" else focal
        widths = 0.5 / math.tan(angle / 2) if 0 < angle < math.pi else 0.0
    if not (math.isfinite(widths) and widths > 0):
        return None
    return math.degrees(2 * math.atan(max(picture) / (2 * widths * picture[0])))


def read_points(
    points: NDArray | None, mask: NDArray | None, picture: tuple[int, int], *, shifted: bool
) -> DepthPicture:
    """Points of the camera's frame for each pixel.

    The focal length is the one that throws the points back onto their pixels. Where their depth lacks an unknown shift,
    the shift is the one for which they fall there best.

    Args:
        points: (1, h, w, 3) or (1, 3, h, w): x right, y down, z forward, up to scale.
        mask: (1, h, w) above 0.5 where there is a surface; None for everywhere.
        picture: (width, height) of the picture on which the grid lies.
        shifted: whether z lacks a shift.
    """
    if points is None:
        raise ModelError("the network gives no points")
    grid = points[0] if points.shape[-1] == 3 else points[0].transpose(1, 2, 0)
    rows, columns = grid.shape[:2]
    known = np.isfinite(grid).all(axis=-1)
    if mask is not None:
        known &= plane_of(mask) > 0.5
    # Pixels in units of the picture's longer side, from its centre.
    side = max(picture)
    u = ((np.arange(columns) + 0.5) / columns - 0.5) * picture[0] / side
    v = ((np.arange(rows) + 0.5) / rows - 0.5) * picture[1] / side
    pixels = np.stack(np.meshgrid(u, v), axis=-1)
    sample = np.zeros_like(known)
    sample[:: max(rows // _FIT_POINTS, 1), :: max(columns // _FIT_POINTS, 1)] = True
    sample &= known
    if np.count_nonzero(sample) < _LEAST_POINTS:
        return DepthPicture(np.full((rows, columns), np.nan, np.float32), None)
    focal, shift = fit_focal(grid[sample].astype(float), pixels[sample], shifted=shifted)
    depth = np.where(known, grid[..., 2] + shift, np.nan)
    view = math.degrees(2 * math.atan(0.5 / focal)) if focal > 0 else None
    return DepthPicture(inverse(depth.astype(np.float32)), view)


def fit_focal(points: NDArray, pixels: NDArray, *, shifted: bool) -> tuple[float, float]:
    """The focal length and the shift of depth for which points (n, 3) fall upon pixels (n, 2) from the centre."""

    def focal_at(shift: float) -> tuple[float, NDArray]:
        slopes = points[:, :2] / np.maximum(points[:, 2:] + shift, 1e-6)
        # For a given shift the focal length is a matter of linear least squares.
        return float((slopes * pixels).sum() / max((slopes**2).sum(), 1e-12)), slopes

    def misses(shift: NDArray) -> NDArray:
        focal, slopes = focal_at(float(shift[0]))
        return (focal * slopes - pixels).ravel()

    if not shifted:
        return focal_at(0.0)[0], 0.0
    spread = float(np.ptp(points[:, 2])) or 1.0
    nearest = float(points[:, 2].min())
    # Every point stands before the camera. Begin where the nearest is as far away as the scene is deep.
    fit = least_squares(misses, spread - nearest, bounds=(-nearest + 1e-3 * spread, np.inf), x_scale=spread)
    return focal_at(float(fit.x[0]))[0], float(fit.x[0])
