"""A jointed figure: the 24 joints of a take at rest, and a low-poly skin of tubes around them.

Rest axes: y up, z to the front, x to the figure's left, metres; it stands on y = 0 with its arms along x.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core_solver.take import JOINT_NAMES

Array = NDArray[np.float64]

STATURE = 1.75
_SHOULDER_Y = 1.42
_HIP_Y = 0.91
_HEAD_Y = 1.56
_LEFT = {
    "hip": (0.095, _HIP_Y, 0.0), "knee": (0.10, 0.50, 0.015), "ankle": (0.10, 0.085, -0.02),
    "foot": (0.105, 0.022, 0.10), "collar": (0.06, 1.39, 0.0), "shoulder": (0.18, _SHOULDER_Y, -0.01),
    "elbow": (0.46, _SHOULDER_Y, -0.02), "wrist": (0.71, _SHOULDER_Y, -0.01), "hand": (0.79, _SHOULDER_Y, 0.0),
}  # fmt: skip
_TRUNK = {
    "pelvis": (0.0, 0.96, 0.0), "spine1": (0.0, 1.06, -0.01), "spine2": (0.0, 1.18, -0.005),
    "spine3": (0.0, 1.26, -0.01), "neck": (0.0, 1.47, -0.02), "head": (0.0, _HEAD_Y, 0.0),
}  # fmt: skip


@dataclass(frozen=True)
class Ring:
    """One cross-section of a tube.

    Attributes:
        centre: (3,) metres.
        across: (3,) half of its width.
        along: (3,) half of its depth.
        joints: (name, weight) of the joints that carry it; the weights sum to 1.
    """

    centre: Array
    across: Array
    along: Array
    joints: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Build:
    """How a figure differs from the ordinary one: factors of lengths.

    Attributes:
        legs: of what lies below the hips.
        arms: of what lies beyond the shoulders.
        head: of the head.
        bulk: of the thickness of everything else.
        sides: corners of every cross-section.
    """

    legs: float = 1.0
    arms: float = 1.0
    head: float = 1.0
    bulk: float = 1.0
    sides: int = 10

    def point(self, place: Array) -> Array:
        """Where a point of the ordinary figure lies on this one; (..., 3)."""
        x, y, z = np.moveaxis(np.asarray(place, float), -1, 0)
        beyond = np.maximum(np.abs(x) - 0.18, 0) * (np.asarray(y) > _HIP_Y)
        x = np.sign(x) * (np.abs(x) + (self.arms - 1) * beyond)
        above_head = np.maximum(y - _HEAD_Y, 0)
        y = np.minimum(y, _HIP_Y) * self.legs + np.maximum(y - _HIP_Y, 0) + (self.head - 1) * above_head
        return np.stack([x, y, z], axis=-1)

    def ring(self, ring: Ring) -> Ring:
        """The same cross-section on this figure."""
        on_head = all(name == "head" for name, _ in ring.joints)
        on_foot = ring.joints[0][0].endswith(("_ankle", "_foot"))
        # A foot is lower where legs are shorter, for its sole to stay on the ground.
        across, along = (self.head, self.head) if on_head else (1.0, self.legs) if on_foot else (self.bulk, self.bulk)
        return replace(ring, centre=self.point(ring.centre), across=across * ring.across, along=along * ring.along)


@dataclass(frozen=True)
class Figure:
    """A body at rest with its skin.

    Attributes:
        joints: (24, 3) in the order of a take.
        vertices: (V, 3).
        faces: (F, 3) triangles, anticlockwise from outside.
        weight_joints: (V, 4) joints, as a take counts them.
        weights: (V, 4) rows sum to 1.
    """

    joints: Array
    vertices: Array
    faces: NDArray[np.int32]
    weight_joints: NDArray[np.uint8]
    weights: Array


def build_figure(build: Build) -> Figure:
    """The figure of a build."""
    tubes = [[build.ring(ring) for ring in tube] for tube in (_trunk(), *_limbs("left", 1), *_limbs("right", -1))]
    vertices, faces, carriers = [], [], []
    for tube in tubes:
        points, triangles, rings = _tube(tube, build.sides)
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(points)
        carriers += [tube[ring].joints for ring in rings]
    weight_joints, weights = np.zeros((len(carriers), 4), np.uint8), np.zeros((len(carriers), 4))
    for row, carrier in enumerate(carriers):
        for slot, (name, weight) in enumerate(carrier):
            weight_joints[row, slot], weights[row, slot] = JOINT_NAMES.index(name), weight
    return Figure(_joints(build), np.concatenate(vertices), np.concatenate(faces), weight_joints, weights)


def _joints(build: Build) -> Array:
    places = dict(_TRUNK)
    for name, (x, y, z) in _LEFT.items():
        places[f"left_{name}"], places[f"right_{name}"] = (x, y, z), (-x, y, z)
    return build.point(np.array([places[name] for name in JOINT_NAMES]))


def _trunk() -> list[Ring]:
    rows = (
        (0.82, 0.09, 0.080, {"pelvis": 1}), (0.87, 0.155, 0.110, {"pelvis": 1}), (0.96, 0.165, 0.112, {"pelvis": 1}),
        (1.06, 0.145, 0.098, {"pelvis": 0.5, "spine1": 0.5}), (1.14, 0.138, 0.095, {"spine1": 0.5, "spine2": 0.5}),
        (1.24, 0.152, 0.104, {"spine2": 0.5, "spine3": 0.5}), (1.34, 0.172, 0.108, {"spine3": 1}),
        (1.42, 0.165, 0.088, {"spine3": 1}), (1.465, 0.085, 0.062, {"spine3": 0.7, "neck": 0.3}),
        (1.51, 0.052, 0.054, {"neck": 1}), (1.55, 0.054, 0.060, {"neck": 0.5, "head": 0.5}),
        (1.59, 0.070, 0.085, {"head": 1}), (1.65, 0.080, 0.100, {"head": 1}), (1.71, 0.066, 0.084, {"head": 1}),
        (STATURE, 0.022, 0.030, {"head": 1}),
    )  # fmt: skip
    return [
        Ring(np.array([0.0, y, 0.0]), np.array([half_width, 0, 0]), np.array([0, 0, half_depth]), tuple(joints.items()))
        for y, half_width, half_depth, joints in rows
    ]


def _limbs(side: str, sign: int) -> list[list[Ring]]:
    leg = (
        (0.93, 0.082, {"pelvis": 0.5, "hip": 0.5}), (0.80, 0.083, {"hip": 1}), (0.65, 0.068, {"hip": 1}),
        (0.54, 0.055, {"hip": 0.8, "knee": 0.2}), (0.50, 0.053, {"hip": 0.5, "knee": 0.5}),
        (0.46, 0.051, {"hip": 0.2, "knee": 0.8}), (0.35, 0.054, {"knee": 1}), (0.21, 0.040, {"knee": 1}),
        (0.12, 0.035, {"knee": 0.7, "ankle": 0.3}), (0.06, 0.033, {"ankle": 1}),
    )  # fmt: skip
    arm = (
        (0.12, 0.050, 0.050, {"collar": 1}), (0.18, 0.056, 0.056, {"collar": 0.4, "shoulder": 0.6}),
        (0.30, 0.046, 0.046, {"shoulder": 1}), (0.42, 0.039, 0.039, {"shoulder": 0.8, "elbow": 0.2}),
        (0.46, 0.038, 0.038, {"shoulder": 0.5, "elbow": 0.5}), (0.50, 0.037, 0.037, {"shoulder": 0.2, "elbow": 0.8}),
        (0.60, 0.033, 0.033, {"elbow": 1}), (0.69, 0.026, 0.024, {"elbow": 0.6, "wrist": 0.4}),
        (0.73, 0.034, 0.015, {"wrist": 1}), (0.79, 0.042, 0.015, {"wrist": 0.5, "hand": 0.5}),
        (0.85, 0.036, 0.012, {"hand": 1}), (0.89, 0.014, 0.007, {"hand": 1}),
    )  # fmt: skip
    # The foot runs from the heel forwards; its lower side is flat on the ground.
    foot = (
        (-0.085, 0.022, 0.030, {"ankle": 1}), (-0.06, 0.032, 0.070, {"ankle": 1}), (0.0, 0.036, 0.085, {"ankle": 1}),
        (0.06, 0.042, 0.060, {"ankle": 1}), (0.11, 0.046, 0.044, {"ankle": 0.5, "foot": 0.5}),
        (0.15, 0.042, 0.034, {"foot": 1}), (0.18, 0.026, 0.022, {"foot": 1}),
    )  # fmt: skip

    def carriers(joints: Mapping[str, float]) -> tuple[tuple[str, float], ...]:
        return tuple((name if name == "pelvis" else f"{side}_{name}", weight) for name, weight in joints.items())

    return [
        [
            Ring(np.array([sign * 0.1, y, 0.005]), np.array([r, 0, 0]), np.array([0, 0, r]), carriers(joints))
            for y, r, joints in leg
        ],
        [
            Ring(
                np.array([sign * x, _SHOULDER_Y, -0.01]), np.array([0, 0, wide]), np.array([0, thick, 0]),
                carriers(joints),
            )
            for x, wide, thick, joints in arm
        ],
        [
            Ring(
                np.array([sign * 0.103, height / 2, z]), np.array([half_width, 0, 0]), np.array([0, height / 2, 0]),
                carriers(joints),
            )
            for z, half_width, height, joints in foot
        ],
    ]  # fmt: skip


def _tube(rings: list[Ring], sides: int) -> tuple[Array, NDArray[np.int32], list[int]]:
    """Points, triangles and each point's ring: the rings joined, with a point in the middle of both ends."""
    angle = 2 * np.pi * np.arange(sides) / sides
    # Between an ellipse and a box: feet lie flat and trunks are no barrels.
    cosine, sine = (
        np.sign(np.cos(angle)) * np.abs(np.cos(angle)) ** 0.7,
        np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** 0.7,
    )
    points = [ring.centre + cosine[:, None] * ring.across + sine[:, None] * ring.along for ring in rings]
    owners = [ring for ring in range(len(rings)) for _ in range(sides)]
    corner, following = np.arange(sides), (np.arange(sides) + 1) % sides
    quads = []
    for ring in range(len(rings) - 1):
        low, high = sides * ring, sides * (ring + 1)
        quads += [np.stack([low + corner, low + following, high + following], axis=1)]
        quads += [np.stack([low + corner, high + following, high + corner], axis=1)]
    first, last = len(owners), len(owners) + 1
    top = sides * (len(rings) - 1)
    quads += [np.stack([np.full(sides, first), following, corner], axis=1)]
    quads += [np.stack([np.full(sides, last), top + corner, top + following], axis=1)]
    vertices = np.concatenate([*points, rings[0].centre[None], rings[-1].centre[None]])
    faces = np.concatenate(quads).astype(np.int32)
    if _volume(vertices, faces) < 0:
        faces = faces[:, ::-1]
    return vertices, faces, [*owners, 0, len(rings) - 1]


def _volume(vertices: Array, faces: NDArray[np.int32]) -> float:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    return float(np.einsum("fc,fc->f", a, np.cross(b, c)).sum() / 6)
