"""Where the picture is evidence of whom."""

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.raster.compiling import helper, kernel
from core_solver.raster.people import draw_people, fill_cost
from core_solver.raster.pinhole import Pinhole
from core_solver.raster.terms import as_bytes, owners_for


def visibility(
    vertices: ArrayLike, faces: ArrayLike, pinhole: Pinhole, labels: ArrayLike, ids: ArrayLike
) -> NDArray[np.uint8]:
    """Tell who could be seen where; occlusion is decided by depth, not by the order of masks.

    A person is hidden at a pixel where another's body is drawn more than 5 cm nearer, and where the label is that of
    another whose body's mean depth is as much nearer. A person's own depth there is the drawn one, or the body's mean
    where it is not drawn. Labels of nobody among `ids` (such as 255, somebody unknown) are no evidence for anyone.

    Args:
        vertices: (T, N, V, 3) metres, camera frame, or (N, V, 3) of one frame.
        faces: (F, 3) anticlockwise seen from outside.
        pinhole: the grid of the labels.
        labels: (T, H, W) uint8, or (H, W) of one frame; 0 is background.
        ids: (N,) labels of the people.

    Returns:
        (T, N, H, W), or (N, H, W) of one frame: 1 where the picture shows whether the person is there.
    """
    vertices, faces = np.ascontiguousarray(vertices, np.float32), np.ascontiguousarray(faces, np.int32)
    if vertices.ndim == 3:
        return visibility(vertices[None], faces, pinhole, np.asarray(labels)[None], ids)[0]
    labels = as_bytes(labels, (len(vertices), pinhole.height, pinhole.width))
    visible = np.empty((*vertices.shape[:2], pinhole.height, pinhole.width), np.int8)
    _see(vertices, faces, pinhole.lens, labels, owners_for(ids, vertices), visible)
    return visible.view(np.uint8)


@kernel
def _see(vertices, faces, lens, labels, owners, visible):
    for frame in numba.prange(vertices.shape[0]):
        _see_frame(vertices[frame], faces, lens, labels[frame], owners, visible[frame])


@helper
def _see_frame(vertices, faces, lens, labels, owners, visible):
    drawn = draw_people(vertices, faces, lens, labels, owners, 0)
    height, width = labels.shape
    for n in range(vertices.shape[0]):
        fill_cost(drawn, owners, labels, n, (0, 0, width, height), visible[n])
        for y in range(height):
            for x in range(width):
                visible[n, y, x] = visible[n, y, x] != 0
