"""Straight edges of the background, and what they tell of gravity.

Door frames, walls and furniture show it far better than people's bearing does: planes through the camera's centre and
one of several parallel edges all hold the edges' direction, be it upright or level.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.tracking.tracks import BACKGROUND

Array = NDArray[np.float64]
Segments = NDArray[np.float32]

_SHORTEST = 0.03  # of the picture's longer side
_LONG = 0.1  # of the same: an edge of this length counts as one observation, and longer ones count no more
_MARGIN = 0.005  # of the same: bars at the picture's border are no edges of the scene
_SAMPLES = np.linspace(0, 1, 9)
_WORK_SIDE = 1920  # pixels; larger pictures are looked at in this size

_EDGE_SIGMA = np.radians(0.5)
_GUESS_SIGMA = np.radians(6)
_VERTICAL_CONE = np.radians(14)  # about the first guess: what leans more is not upright
_LEVEL_SIGMA = np.radians(1.5)  # of what is built level
_LEVEL_CONE = np.radians(15)
_LEVEL_DIRECTIONS = 3
_LEVEL_EDGES = 2.5  # of full length that make a direction
_UPRIGHT_EDGES = 3.0
_MOST_EDGES = 300
_ROUNDS = 20


@dataclass(frozen=True)
class UprightCues:
    """What in the scene tells where up is.

    Attributes:
        normals: (L, 3) unit vectors at right angles to up, camera frame: of the plane through the camera and an upright
            edge, or along edges that are level.
        weights: (L,) how many upright edges of full length each amounts to.
    """

    normals: Array
    weights: Array


def find_edges(pictures: Iterable[tuple[int, NDArray[np.uint8]]], labels: NDArray[np.uint8]) -> Segments:
    """Straight edges of the background in a few pictures of a static camera.

    Args:
        pictures: take frame and (H, W, 3) picture, BGR.
        labels: (T, h, w) who is where.

    Returns:
        (L, 5): both ends in pixels of the footage (u, v, u, v), and the share of a picture's vote that the edge has: an
        edge that is seen in all of them shall count once.
    """
    found = [_background_edges(picture, labels[t]) for t, picture in pictures]
    share = 1 / max(len(found), 1)
    rows = [np.column_stack([edges, np.full(len(edges), share)]) for edges in found]
    return np.concatenate([np.zeros((0, 5)), *rows]).astype(np.float32)


def _background_edges(picture: NDArray[np.uint8], labels: NDArray[np.uint8]) -> Array:
    height, width = picture.shape[:2]
    longer = max(height, width)
    factor = min(1.0, _WORK_SIDE / longer)
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    if found is None:
        return np.zeros((0, 4))
    # The detector puts the top-left pixel's centre at (0, 0).
    edges = (found[:, 0].astype(float) + 0.5) / factor
    long = np.linalg.norm(edges[:, 2:] - edges[:, :2], axis=1) > _SHORTEST * longer
    return edges[long & ~_on_border(edges, width, height) & _on_background(edges, width, height, labels)]


def _on_border(edges: Array, width: int, height: int) -> NDArray[np.bool_]:
    margin = _MARGIN * max(width, height)
    ends = edges.reshape(-1, 2, 2)
    outside = (ends < margin) | (ends > np.array([width, height]) - margin)
    return outside.all(axis=1).any(axis=1)


def _on_background(edges: Array, width: int, height: int, labels: NDArray[np.uint8]) -> NDArray[np.bool_]:
    rows, columns = labels.shape
    nobody = cv2.erode((labels == BACKGROUND).astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=(1.0,))
    points = edges[:, None, :2] + _SAMPLES[:, None] * (edges[:, None, 2:] - edges[:, None, :2])
    cells = np.floor(points * (columns / width, rows / height)).astype(int)
    column, row = np.clip(cells[..., 0], 0, columns - 1), np.clip(cells[..., 1], 0, rows - 1)
    return (nobody[row, column] > 0).all(axis=1)


def find_cues(edges: Segments, camera: Camera, guess: Array) -> UprightCues | None:
    """Upright and level edges that agree with each other and with a first guess of up; None where there are too few.

    Level directions come first: an edge on the floor that leads away from the camera looks upright in the picture, and
    only the others of its direction give it away.

    Args:
        edges: (L, 5) of `find_edges`.
        camera: intrinsics.
        guess: (3,) unit vector, camera frame: up as far as people's bearing tells.
    """
    normals, weights = _planes(edges, camera)
    levels = _level_directions(normals, weights, guess)
    # Bearing and level directions as one quadratic form, in deviations: small for what may be up.
    form = (np.eye(3) - np.outer(guess, guess)) / _GUESS_SIGMA**2 + levels.T @ levels / _LEVEL_SIGMA**2
    up = _smallest(form, guess)
    near = np.abs(normals @ up) < np.sin(_VERTICAL_CONE)
    near &= (np.abs(levels @ normals.T) > np.sin(2 * _EDGE_SIGMA)).all(axis=0)
    normals, weights = normals[near], weights[near]
    up = _meeting_point(normals, weights, form, up)
    upright = np.abs(normals @ up) < np.sin(2 * _EDGE_SIGMA)
    if weights[upright].sum() < _UPRIGHT_EDGES:
        upright[:] = False
    if not upright.any() and len(levels) == 0:
        return None
    level_weights = np.full(len(levels), (_EDGE_SIGMA / _LEVEL_SIGMA) ** 2)
    return UprightCues(np.concatenate([normals[upright], levels]), np.concatenate([weights[upright], level_weights]))


def _planes(edges: Segments, camera: Camera) -> tuple[Array, Array]:
    """Unit normals (L, 3) of the planes through the camera's centre and the edges, and the edges' weights (L,)."""
    ends = edges[:, :4].astype(float).reshape(-1, 2, 2)
    rays = camera.rays(ends)
    normals = np.cross(rays[:, 0], rays[:, 1])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    longer = max(camera.width, camera.height)
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / (_LONG * longer)
    weights = edges[:, 4] * np.minimum(lengths, 1.0)
    heaviest = np.argsort(-weights, kind="stable")[:_MOST_EDGES]
    return normals[heaviest], weights[heaviest]


def _level_directions(normals: Array, weights: Array, guess: Array) -> Array:
    """(D, 3) the directions that most edges share, one after the other, as far as they may be level."""
    weights = weights * (np.abs(normals @ guess) > np.sin(_VERTICAL_CONE))
    directions = []
    for _ in range(_LEVEL_DIRECTIONS):
        left = weights > 0
        crossings = _crossings(normals[left])
        rise = np.arcsin(np.clip(np.abs(crossings @ guess), 0, 1))
        crossings, rise = crossings[rise < _LEVEL_CONE], rise[rise < _LEVEL_CONE]
        if len(crossings) == 0:
            break
        trust = np.exp(-((rise / _GUESS_SIGMA) ** 2) / 2) * _votes(crossings, normals[left], weights[left])
        direction = _settled(crossings[trust.argmax()], normals, weights, np.zeros((3, 3)))
        if weights @ _agreement(normals @ direction) < _LEVEL_EDGES:
            break
        if abs(direction @ guess) < np.sin(_LEVEL_CONE):
            directions.append(direction)
        weights = weights * (np.abs(normals @ direction) > np.sin(2 * _EDGE_SIGMA))
    return np.array(directions).reshape(-1, 3)


def _meeting_point(normals: Array, weights: Array, form: Array, up: Array) -> Array:
    """The direction (3,) in which most of the planes meet, where `form` says that it may be; `up` if they do not."""
    crossings = _crossings(normals)
    crossings = crossings[np.abs(crossings @ up) > np.cos(_VERTICAL_CONE)]
    if len(crossings) == 0:
        return up
    excess = np.einsum("ni,ij,nj->n", crossings, form, crossings) - up @ form @ up
    best = crossings[(np.exp(-excess / 2) * _votes(crossings, normals, weights)).argmax()]
    return _settled(best * np.sign(best @ up), normals, weights, form)


def _settled(direction: Array, normals: Array, weights: Array, form: Array) -> Array:
    """A direction moved to where the planes near it agree best."""
    for _ in range(_ROUNDS):
        trust = weights * _agreement(normals @ direction)
        scatter = (normals * trust[:, None]).T @ normals / _EDGE_SIGMA**2
        direction = _smallest(scatter + form, direction)
    return direction


def _smallest(form: Array, like: Array) -> Array:
    """The unit vector of a form's (3, 3) smallest value, on the side of another."""
    vector: Array = np.linalg.eigh(form)[1][:, 0]
    return vector if vector @ like >= 0 else -vector


def _crossings(normals: Array) -> Array:
    """(M, 3) directions in which two planes meet, but for planes nearly the same."""
    first, second = np.triu_indices(len(normals), 1)
    crossings = np.cross(normals[first], normals[second])
    lengths = np.linalg.norm(crossings, axis=1)
    apart = lengths > np.sin(3 * _EDGE_SIGMA)
    result: Array = crossings[apart] / lengths[apart, None]
    return result


def _votes(directions: Array, normals: Array, weights: Array) -> Array:
    """(M,) weight of the planes in which each direction lies; a few at a time, as there are many pairs of edges."""
    parts = np.array_split(directions, len(directions) // 4000 + 1)
    return np.concatenate([_agreement(part @ normals.T) @ weights for part in parts])


def _agreement(sines: Array) -> Array:
    return np.exp(-((sines / _EDGE_SIGMA) ** 2) / 2)
