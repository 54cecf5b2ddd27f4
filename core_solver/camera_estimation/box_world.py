"""How well a picture's straight edges fit a world of right angles, for a lens of a given focal length.

Rooms and streets have upright edges, and level ones along two directions at right angles. Parallel edges meet in one
point of the picture, and only with the right focal length do three such points lie at right angles.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec
from core_solver.scene.edges import Segments

Array = NDArray[np.float64]

_ANGLE_SIGMA = np.radians(0.7)  # of an edge of the picture, against the meeting point of its fellows
_IN_BOX = 0.5  # share of edges that belong to one of the three directions
_TRUST = 0.3  # edges come in groups, of one door or one shelf, and err together
_GUESS_SIGMA = np.radians(6)  # of up, as far as people tell
_LONG = 0.1  # of the picture's longer side: longer edges count no more
_LEAST_EDGES = 6
_MOST_EDGES = 250
_MEETING_POINTS = 12
_RIGHT_ANGLE = np.radians(10)  # within which two directions may begin
_BEST = 6  # frames refined for every focal length
_ROUNDS = 8
_STEP = 1e-4


@dataclass(frozen=True)
class _Edges:
    """Middles (L, 2) and unit directions (L, 2) in longer sides of the picture from its centre; weights (L,)."""

    middles: Array
    along: Array
    weights: Array


def box_costs(segments: Segments | None, image_size: tuple[int, int], focals: Array, ups: Array) -> Array:
    """Minus the log-likelihood of each focal length (F,), against edges that lie at random: 0 where there is no box.

    Args:
        segments: (L, 5) of `scene.edges.find_edges`; None where none were sought.
        image_size: (width, height) pixels; square pixels, principal point in the middle.
        focals: (F,) in longer sides of the picture.
        ups: (F, 3) unit vectors, camera frame: where up is as far as people tell.
    """
    if segments is None or len(segments) < _LEAST_EDGES:
        return np.zeros(len(focals))
    edges = _prepare(segments, image_size)
    points = _meeting_points(edges)
    return np.array([_cost(edges, points, focal, up) for focal, up in zip(focals, ups, strict=True)])


def _prepare(segments: Segments, image_size: tuple[int, int]) -> _Edges:
    longer = max(image_size)
    ends = (segments[:, :4].astype(float).reshape(-1, 2, 2) - np.array(image_size) / 2) / longer
    along = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    weights = segments[:, 4] * np.minimum(lengths / _LONG, 1)
    heaviest = np.argsort(-weights, kind="stable")[:_MOST_EDGES]
    along = along / np.maximum(lengths, 1e-9)[:, None]
    return _Edges(ends.mean(axis=1)[heaviest], along[heaviest], weights[heaviest].astype(float))


def _meeting_points(edges: _Edges) -> Array:
    """(P, 3) homogeneous points in which most edges meet, each edge given to the first of them."""
    lines = np.column_stack([edges.middles, np.ones(len(edges.middles))])
    lines = np.cross(lines, np.column_stack([edges.along, np.zeros(len(edges.along))]))
    first, second = np.triu_indices(len(lines), 1)
    crossings = np.cross(lines[first], lines[second])
    length = np.linalg.norm(crossings, axis=1)
    crossings = crossings[length > 1e-6] / length[length > 1e-6, None]
    left = edges.weights.copy()
    found = []
    agreements = np.concatenate(
        [_agreement(edges, part) for part in np.array_split(crossings, len(crossings) // 4000 + 1)]
    )
    for _ in range(min(_MEETING_POINTS, len(crossings))):
        best = int((agreements @ left).argmax())
        found.append(crossings[best])
        left = left * (1 - agreements[best])
    return np.array(found).reshape(-1, 3)


def _agreement(edges: _Edges, points: Array) -> Array:
    """(P, L) how well each edge points to each homogeneous point: 1 exactly, 0 not at all."""
    return np.exp(-((_sines(edges, points) / _ANGLE_SIGMA) ** 2) / 2)


def _sines(edges: _Edges, points: Array) -> Array:
    """(..., L) sines of the angles between edges and their lines to homogeneous points (..., 3)."""
    x = points[..., None, 0] - points[..., None, 2] * edges.middles[:, 0]
    y = points[..., None, 1] - points[..., None, 2] * edges.middles[:, 1]
    cross = edges.along[:, 0] * y - edges.along[:, 1] * x
    result: Array = cross / np.maximum(np.sqrt(x**2 + y**2), 1e-9)
    return result


def _cost(edges: _Edges, points: Array, focal: float, up: Array) -> float:
    """The best box for one focal length: three directions at right angles, one of them near up."""
    directions = points * (1, 1, focal)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    boxes = _right_angles(directions)
    if len(boxes) == 0:
        return 0.0
    costs = _box_cost(edges, boxes, focal, up)
    boxes = boxes[costs.argsort(kind="stable")[:_BEST]]
    return min(0.0, float(_box_cost(edges, _refine(edges, boxes, focal), focal, up).min()))


def _right_angles(directions: Array) -> Array:
    """(B, 3, 3) boxes, axes in columns, from pairs of directions that are nearly at right angles."""
    first, second = np.triu_indices(len(directions), 1)
    near = np.abs((directions[first] * directions[second]).sum(axis=1)) < np.sin(_RIGHT_ANGLE)
    a, b = directions[first[near]], directions[second[near]]
    c = np.cross(a, b)
    c /= np.maximum(np.linalg.norm(c, axis=1, keepdims=True), 1e-9)
    left, _, right = np.linalg.svd(np.stack([a, b, c], axis=2))
    nearest: Array = np.einsum("bij,bjk->bik", left, right)
    return nearest


def _box_cost(edges: _Edges, boxes: Array, focal: float, up: Array) -> Array:
    """(B,) minus the log-likelihood. An edge of no direction may lie at any angle in the picture, whatever the lens."""
    points = np.swapaxes(boxes, -1, -2) * (focal, focal, 1.0)
    chance = _agreement(edges, points).sum(axis=-2) * np.sqrt(np.pi / 2) / _ANGLE_SIGMA / 3
    fit = np.log(1 - _IN_BOX + _IN_BOX * chance) @ edges.weights
    lean = np.arccos(np.clip(np.abs(np.einsum("bij,i->bj", boxes, up)).max(axis=-1), 0, 1))
    result: Array = -_TRUST * fit + 0.5 * (lean / _GUESS_SIGMA) ** 2
    return result


def _refine(edges: _Edges, boxes: Array, focal: float) -> Array:
    """Boxes turned to where the edges that agree with them agree best."""
    for _ in range(_ROUNDS):
        boxes = boxes @ matrix_from_rotvec(_turn(edges, boxes, focal))
    return boxes


def _turn(edges: _Edges, boxes: Array, focal: float) -> Array:
    """One Gauss-Newton step (B, 3), radians about the boxes' own axes."""
    scale = np.array([focal, focal, 1.0])
    here = _sines(edges, np.swapaxes(boxes, -1, -2) * scale)
    small = [boxes @ matrix_from_rotvec(_STEP * axis) for axis in np.eye(3)]
    slopes = np.stack([(_sines(edges, np.swapaxes(box, -1, -2) * scale) - here) / _STEP for box in small], axis=-1)
    trust = np.exp(-((here / _ANGLE_SIGMA) ** 2) / 2) * edges.weights
    curvature = np.einsum("bkl,bkli,bklj->bij", trust, slopes, slopes) + 1e-6 * np.eye(3)
    gradient = np.einsum("bkl,bkli,bkl->bi", trust, slopes, here)
    step: Array = -np.linalg.solve(curvature, gradient[..., None])[..., 0]
    return np.clip(step, -0.05, 0.05)
