"""Depth pictures of bodies."""

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import kernel
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.zbuffer import NO_FACE, draw, project


def depth_buffer(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole
) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Draw each body alone.

    Args:
        vertices: (B, V, 3) metres, camera frame.
        faces: (F, 3) anticlockwise seen from outside; faces seen from behind are not drawn, nor those with a vertex
            nearer than 5 cm, behind the camera or not finite.
        pinhole: the grid.

    Returns:
        depth (B, H, W): metres along the camera's axis at pixel centres, exact on the flat faces; inf where empty.
        face (B, H, W): index of the face seen there; -1 where empty.
    """
    vertices = np.ascontiguousarray(vertices, np.float32)
    shape = (len(vertices), pinhole.height, pinhole.width)
    depth, face = np.zeros(shape, np.float32), np.full(shape, NO_FACE, np.int32)
    _draw_all(vertices, np.ascontiguousarray(faces, np.int32), pinhole.lens, depth, face)
    return depth, face


@kernel
def _draw_all(vertices, faces, lens, depth, face):
    height, width = depth.shape[1], depth.shape[2]
    for body in numba.prange(vertices.shape[0]):
        screen = np.empty(vertices.shape[1:], np.float32)
        project(vertices[body], lens, screen)
        draw(screen, faces, (0, 0, width, height), depth[body], face[body])
        for y in range(height):
            for x in range(width):
                depth[body, y, x] = np.float32(1) / depth[body, y, x]
