"""A simple closed figure of any fineness that can move, to measure the raster operator on without any body model."""

import heapq
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

# The figure in blocks of 10 cm, as (x, y, z) ranges: x to its left, y up, z to the front, ends excluded.
_BLOCKS = (
    ((-2, -1), (0, 8), (0, 2)),  # right leg
    ((1, 2), (0, 8), (0, 2)),  # left leg
    ((-2, 2), (8, 14), (0, 2)),  # trunk
    ((-4, -3), (6, 14), (0, 1)),  # right arm
    ((3, 4), (6, 14), (0, 1)),  # left arm
    ((-4, 4), (13, 14), (0, 1)),  # shoulders
    ((-1, 1), (14, 17), (0, 2)),  # head and neck
)
_BLOCK = 0.1  # metres
_HEIGHT = 1.7  # metres
_TO_CAMERA = np.array(
    [1.0, -1.0, -1.0], np.float64
)  # it faces the camera, whose y points down and whose z points at it

# What can turn, forwards and sideways: the joint (x, y), and the half-planes a x + b y > c (metres) that follow it.
_LIMBS = (
    ((-0.35, 1.35), ((-1, 0, 0.25), (0, -1, -1.35))),  # right arm
    ((0.35, 1.35), ((1, 0, 0.25), (0, -1, -1.35))),  # left arm
    ((-0.15, 0.8), ((-1, 0, 0.0), (0, -1, -0.75))),  # right leg
    ((0.15, 0.8), ((1, 0, 0.0), (0, -1, -0.75))),  # left leg
    ((0.0, 1.4), ((0, 1, 1.4),)),  # head
)
_BLEND = 0.12  # metres over which a limb's motion fades into the trunk

PARAMETERS = 3 + 2 * len(_LIMBS)


@dataclass(frozen=True)
class Mannequin:
    """A figure that stands upright and looks at the camera.

    Attributes:
        rest: (V, 3) metres, axes of the camera frame, origin between the hips.
        faces: (F, 3) anticlockwise seen from outside; closed and in one piece, so F = 2 V - 4.
        follow: (limbs, V) share in which each vertex follows each limb.
        joints: (limbs, 3) metres, centres of the limbs' rotations.
    """

    rest: NDArray[np.float64]
    faces: NDArray[np.int32]
    follow: NDArray[np.float64]
    joints: NDArray[np.float64]

    def posed(self, parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        """Vertices (V, 3) for (PARAMETERS,): translation in metres, then two small angles in radians a limb."""
        moved = self.rest.copy()
        for share, joint, (forwards, sideways) in zip(
            self.follow, self.joints, parameters[3:].reshape(-1, 2), strict=True
        ):
            arm = self.rest - joint
            moved += share[:, None] * (arm @ (_about_x(forwards) @ _about_z(sideways)).T - arm)
        return moved + parameters[:3]


def build_mannequin(vertex_count: int) -> Mannequin:
    """A figure 1.7 m tall with exactly this many vertices: 6890 are as many as SMPL's, about 500 a proxy's.

    Raises:
        ValueError: fewer vertices than the blocks have.
    """
    vertices, faces = _surface_of_blocks()
    if vertex_count < len(vertices):
        raise ValueError(f"a mannequin needs at least {len(vertices)} vertices")
    vertices, faces = _refine(vertices, faces, vertex_count)
    # Rounding works edge by edge: the finer the mesh, the more steps the same roundness takes.
    vertices = _rounded(vertices, faces, steps=1 + vertex_count // 600)
    vertices[:, 1] -= vertices[:, 1].min()
    vertices *= _HEIGHT / vertices[:, 1].max()
    follow = np.stack([_share(vertices, half_planes) for _, half_planes in _LIMBS])
    origin = np.array([0.0, 0.8, _BLOCK], np.float64)
    joints = np.array([[x, y, _BLOCK] for (x, y), _ in _LIMBS], np.float64)
    return Mannequin((vertices - origin) * _TO_CAMERA, faces, follow, (joints - origin) * _TO_CAMERA)


def _surface_of_blocks() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Vertices (V, 3) in metres and triangles of the boundary of the blocks, each block face cut in two."""
    filled = {cell for ranges in _BLOCKS for cell in product(*(range(*r) for r in ranges))}
    index: dict[tuple[int, ...], int] = {}
    triangles: list[tuple[int, int, int]] = []
    for cell, axis, side in product(sorted(filled), range(3), (0, 1)):
        beside = list(cell)
        beside[axis] += 2 * side - 1
        if tuple(beside) in filled:
            continue
        square = []
        # Around the axis the other two axes follow in cyclic order, so these corners run anticlockwise from above it.
        for across, along in ((0, 0), (1, 0), (1, 1), (0, 1)):
            corner = list(cell)
            corner[axis] += side
            corner[(axis + 1) % 3] += across
            corner[(axis + 2) % 3] += along
            square.append(index.setdefault(tuple(corner), len(index)))
        a, b, c, d = square if side else square[::-1]
        triangles += [(a, b, c), (a, c, d)]
    return np.array(list(index), float) * _BLOCK, np.array(triangles, np.int32)


def _refine(
    vertices: NDArray[np.float64], faces: NDArray[np.int32], vertex_count: int
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Halve the longest edge again and again: each time one vertex and two faces more."""
    points = list(vertices)
    triangles = [tuple(face) for face in faces.tolist()]
    owner = {edge: f for f, face in enumerate(triangles) for edge in _edges(face)}
    longest = [(-_squared(points, edge), edge) for edge in owner if edge[0] < edge[1]]
    heapq.heapify(longest)
    while len(points) < vertex_count:
        _, (i, j) = heapq.heappop(longest)
        if (i, j) not in owner:
            continue
        middle = len(points)
        points.append((points[i] + points[j]) / 2)
        for a, b in ((i, j), (j, i)):
            f = owner.pop((a, b))
            apex = next(k for k in triangles[f] if k not in (a, b))
            triangles[f] = (a, middle, apex)
            triangles.append((middle, b, apex))
            owner |= dict.fromkeys(_edges(triangles[f]), f)
            owner |= dict.fromkeys(_edges(triangles[-1]), len(triangles) - 1)
        for end in (i, j):
            new = {k for k in triangles[owner[end, middle]] if k != middle}
            for k in new:
                heapq.heappush(longest, (-_squared(points, (k, middle)), (k, middle)))
    return np.array(points), np.array(triangles, np.int32)


def _edges(face: tuple[int, ...]) -> list[tuple[int, int]]:
    a, b, c = face
    return [(a, b), (b, c), (c, a)]


def _squared(points: list[NDArray[np.float64]], edge: tuple[int, int]) -> float:
    difference = points[edge[0]] - points[edge[1]]
    return float(difference @ difference)


def _rounded(vertices: NDArray[np.float64], faces: NDArray[np.int32], steps: int) -> NDArray[np.float64]:
    """Move every vertex half-way to the mean of its neighbours, so many times."""
    first, second = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).T
    degree = np.bincount(first, minlength=len(vertices))[:, None]
    for _ in range(steps):
        sums = np.zeros_like(vertices)
        np.add.at(sums, first, vertices[second])
        vertices = (vertices + sums / degree) / 2
    return vertices


def _share(vertices: NDArray[np.float64], half_planes: tuple[tuple[float, float, float], ...]) -> NDArray[np.float64]:
    """1 well inside all the half-planes, 0 outside, smooth between."""
    inside = np.min([a * vertices[:, 0] + b * vertices[:, 1] - c for a, b, c in half_planes], axis=0)
    ramp = np.clip(inside / _BLEND, 0, 1)
    return ramp * ramp * (3 - 2 * ramp)


def _about_x(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def _about_z(angle: float) -> NDArray[np.float64]:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
