"""Small pictures for the raster tests."""

import numpy as np
from numpy.typing import NDArray

from core_solver.raster import Pinhole, depth_buffer
from core_solver.raster.mannequin import PARAMETERS, Mannequin, build_mannequin

SMALL = Pinhole(64, 48, 60.0, 62.0, 30.0, 25.0)
SIZED = Pinhole(160, 96, 130.0, 130.0, 80.0, 48.0)
SQUARE_FACES = [[0, 1, 2], [0, 2, 3]]
FIGURE: Mannequin = build_mannequin(502)


def square(pinhole: Pinhole, left: float, top: float, right: float, bottom: float, depth: float) -> NDArray[np.float64]:
    """(4, 3) vertices of a rectangle that faces the camera and covers these pixels; use with SQUARE_FACES."""
    u, v = np.array([left, left, right, right]), np.array([top, bottom, bottom, top])
    return np.stack(
        [(u - pinhole.cx) / pinhole.fx * depth, (v - pinhole.cy) / pinhole.fy * depth, np.full(4, depth)], axis=-1
    )


def disc(pinhole: Pinhole, u: float, v: float, radius: float, depth: float) -> tuple[NDArray, NDArray]:
    """Vertices (V, 3) and faces of a disc that faces the camera."""
    angle = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    rim = np.stack([u + radius * np.cos(angle), v - radius * np.sin(angle)], axis=-1)
    pixels = np.vstack([[u, v], rim])
    vertices = np.column_stack([(pixels - (pinhole.cx, pinhole.cy)) / (pinhole.fx, pinhole.fy), np.ones(121)]) * depth
    following = np.roll(np.arange(1, 121), -1)
    return vertices, np.stack([np.zeros(120, int), np.arange(1, 121), following], axis=-1)


def standing(depth: float = 3.0, across: float = 0.0, bend: float = 0.1) -> NDArray[np.float64]:
    """(V, 3) the figure at a place, its limbs a little bent."""
    parameters = np.full(PARAMETERS, bend)
    parameters[:3] = across, 0.05, depth
    return FIGURE.posed(parameters)


def picture_of(vertices: NDArray, pinhole: Pinhole, faces: NDArray | list = FIGURE.faces) -> NDArray[np.bool_]:
    """(H, W) where one body is seen."""
    return depth_buffer(vertices[None], faces, pinhole)[1][0] >= 0


def cosine(a: NDArray, b: NDArray) -> float:
    """Of the angle between two arrays of numbers."""
    return float(np.sum(a * b) / np.sqrt(np.sum(a * a) * np.sum(b * b)))
