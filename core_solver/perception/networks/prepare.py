"""From pictures to tensors. Positions have pixel centres at half-integers; maps go from the input to the picture."""

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.perception.blazepose import warp
from core_solver.perception.networks.spec import NetworkSpec

Image = NDArray[np.uint8]
Floats = NDArray[np.float32]
Affine = NDArray[np.float64]

_LEAST_SIDE = 8.0  # pixels of a person's box


def lay_picture(image: Image, size: tuple[int, int], spec: NetworkSpec) -> tuple[Image, Affine]:
    """Bring a whole picture to the input's size, stretched or with margins.

    Args:
        image: (H, W, 3).
        size: (width, height) of the input.
        spec: says how.

    Returns:
        (height, width, 3), and the (2, 3) map from its pixels to the picture's.
    """
    height, width = image.shape[:2]
    scale = min(size[0] / width, size[1] / height)
    inner = size if spec.fits_stretched else (max(round(width * scale), 1), max(round(height * scale), 1))
    shrinks = inner[0] < width
    small = cv2.resize(image, inner, interpolation=cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR)
    left, top = ((s - i) // 2 if spec.fit == "centre" else 0 for s, i in zip(size, inner, strict=True))
    laid = np.full((size[1], size[0], 3), spec.pad, np.uint8)
    laid[top : top + inner[1], left : left + inner[0]] = small
    across, down = width / inner[0], height / inner[1]
    return laid, np.array([[across, 0, -left * across], [0, down, -top * down]])


def person_crop(box: Floats, size: tuple[int, int], padding: float) -> Affine:
    """The (2, 3) map from an input of (width, height) to the picture, for an upright crop around a person.

    Args:
        box: (4,) left, top, right, bottom.
        size: of the input, whose aspect the crop takes by growing the box in one direction.
        padding: size of the crop over the grown box.
    """
    corners = np.asarray(box, float).reshape(2, 2)
    across, down = np.maximum(corners[1] - corners[0], _LEAST_SIDE)
    scale = padding * max(across / size[0], down / size[1])
    return np.column_stack([scale * np.eye(2), corners.mean(axis=0) - scale * np.array(size) / 2])


def cut(image: Image, crop: Affine, size: tuple[int, int]) -> Image:
    """The (height, width, 3) crop that `person_crop` describes; black outside the picture."""
    return warp(image, crop, size)


def to_tensor(picture: Image, spec: NetworkSpec) -> Floats:
    """One picture of the input's size, BGR, in the declared colour order, normalisation and layout, without batch."""
    colours = picture[..., ::-1] if spec.colour == "rgb" else picture
    values = (colours.astype(np.float32) * np.float32(spec.scale) - np.float32(spec.mean)) / np.float32(spec.std)  # type: ignore[arg-type]
    return np.ascontiguousarray(values.transpose(2, 0, 1) if spec.layout == "NCHW" else values)
