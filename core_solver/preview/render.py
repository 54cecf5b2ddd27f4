"""Shaded bodies over a picture: all people's triangles together, the far ones first."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

_OPACITY = 0.65
_FAINT_OPACITY = 0.45
_STRIPE = 8  # pixels, of a picture 1000 pixels high
_NEAREST = 0.05  # metres; nearer triangles would cross the lens
_FARTHEST_OUT = 1.0  # image sizes outside the picture; lens polynomials fold back beyond
_SUBPIXEL_BITS = 4
_AMBIENT = 0.35


@dataclass(frozen=True)
class ShownBody:
    """One body to draw.

    Attributes:
        vertices: (V, 3) metres, camera frame.
        faces: (F, 3), anticlockwise seen from outside.
        colour: blue, green, red, 0-255.
        seen: False draws it striped: this frame is filled, not seen.
    """

    vertices: Array
    faces: NDArray[np.int32]
    colour: tuple[int, int, int]
    seen: bool = True


@dataclass(frozen=True)
class _Triangles:
    """Triangles on their way to the picture: corners (n, 3, 2) pixels, depth (n,) metres, paint (n, 4) BGR and code."""

    corners: Array
    depth: Array
    paint: Array


_SEEN, _FILLED = 255, 128  # the layer's fourth channel


def draw_bodies(picture: Image, bodies: Sequence[ShownBody], camera: Camera) -> Image:
    """A copy of the picture (h, w, 3) with the bodies over it; nearer bodies hide farther ones.

    Args:
        picture: BGR at the camera's size.
        bodies: in any order.
        camera: draws with its distortion, so that bodies lie on the footage as it is.
    """
    layer = np.zeros((*picture.shape[:2], 4), np.uint8)
    _paint(layer, [_triangles(body, camera) for body in bodies])
    return _blend(picture, layer)


def _triangles(body: ShownBody, camera: Camera) -> _Triangles:
    corners = body.vertices[body.faces]
    outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    towards_camera = np.einsum("fi,fi->f", outward, corners.mean(axis=1)) < 0
    drawn = towards_camera & _projectable(body.vertices, camera)[body.faces].all(axis=1)
    paint = np.empty((int(drawn.sum()), 4))
    paint[:, :3] = _brightness(body, outward)[drawn, None] * body.colour
    paint[:, 3] = _SEEN if body.seen else _FILLED
    safe = np.where(_projectable(body.vertices, camera)[:, None], body.vertices, (0.0, 0.0, 1.0))
    return _Triangles(camera.project(safe)[body.faces[drawn]], corners[drawn, :, 2].mean(axis=1), paint)


def _projectable(vertices: Array, camera: Camera) -> NDArray[np.bool_]:
    """(V,) in front of the lens and not far outside the picture."""
    in_front = vertices[:, 2] > _NEAREST
    pixels = camera.project(np.where(in_front[:, None], vertices, (0.0, 0.0, 1.0)), distorted=False)
    size = np.array([camera.width, camera.height])
    return in_front & np.all((pixels > -_FARTHEST_OUT * size) & (pixels < (1 + _FARTHEST_OUT) * size), axis=1)


def _brightness(body: ShownBody, outward: Array) -> Array:
    """(F,) light from above the camera's left shoulder, smoothed over neighbouring faces through the vertices."""
    normals = np.zeros_like(body.vertices)
    for corner in range(3):
        np.add.at(normals, body.faces[:, corner], outward)
    smooth = normals[body.faces].sum(axis=1)
    length = np.linalg.norm(smooth, axis=1, keepdims=True)
    light = np.array([-0.35, -0.6, -0.72])  # camera frame: left, up, towards the camera
    facing = (smooth / np.where(length > 0, length, 1)) @ light
    return _AMBIENT + (1 - _AMBIENT) * np.clip(0.5 + 0.6 * facing, 0, 1)


def _paint(layer: Image, groups: list[_Triangles]) -> None:
    if not groups:
        return
    corners = np.concatenate([g.corners for g in groups])
    depth = np.concatenate([g.depth for g in groups])
    colours = np.clip(np.concatenate([g.paint for g in groups]), 0, 255).tolist()
    # OpenCV draws with pixel centres at whole numbers, ours lie at halves.
    fixed = np.round((corners - 0.5) * (1 << _SUBPIXEL_BITS)).astype(np.int32)
    for index in np.argsort(-depth, kind="stable"):
        cv2.fillConvexPoly(layer, fixed[index], colours[index], cv2.LINE_8, _SUBPIXEL_BITS)


def _blend(picture: Image, layer: Image) -> Image:
    code = layer[..., 3]
    if not code.any():
        return picture.copy()
    top, bottom, left, right = _window(code > 0)
    window = (slice(top, bottom), slice(left, right))
    opacity = _opacity(code[window], picture.shape[0], top, left)[..., None]
    result = picture.copy()
    mixed = picture[window] * (1 - opacity) + layer[window][..., :3] * opacity
    result[window] = np.round(mixed).astype(np.uint8)
    return result


def _opacity(code: Image, picture_height: int, top: int, left: int) -> NDArray[np.float32]:
    """Opacity per pixel; filled frames get diagonal stripes."""
    width = max(2, round(_STRIPE * picture_height / 1000))
    rows, columns = np.indices(code.shape)
    stripe = (rows + top + columns + left) // width % 2 == 0
    faint = np.where(stripe, _FAINT_OPACITY, 0.1)
    return np.select([code == _SEEN, code == _FILLED], [_OPACITY, faint], 0).astype(np.float32)


def _window(mask: NDArray[np.bool_]) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
