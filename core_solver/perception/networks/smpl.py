"""Reading SMPL regressors: rotations of 24 joints in any of the usual forms, and where the person is.

Only the pose is used: shape numbers belong to a body of their own. The open body takes the pose at its neutral shape.
"""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from core_solver.body import BodyModel, pose_joints, skin
from core_solver.geometry import align_vectors, matrix_from_rotvec, rotvec_from_matrix

Array = NDArray[np.float64]

_JOINTS, _WITHOUT_HANDS = 24, 22
_MID_HIPS = [11, 12]  # keypoints
_ROMP_SCALE = 1.1  # to the power of what the network gives
_ROMP_WINDOW = np.ones((5, 5), np.uint8)
_NUMBERS = {"matrix": 9, "6d": 6, "6d-rows": 6, "axis-angle": 3}


@dataclass(frozen=True)
class Regressed:
    """The numbers of the people that a regressor sees, in any of the usual forms.

    Attributes:
        pose: (N, ...) rotations.
        orient: (N, ...) the root's, where it is apart.
        camera: (N, 3) where the network says where people are.
        scores: (N,) or (N, 1) where it doubts.
    """

    pose: NDArray
    orient: NDArray | None
    camera: NDArray | None
    scores: NDArray | None


def read_romp_maps(centers: NDArray, params: NDArray, score: float) -> Regressed:
    """ROMP as it leaves the network: each peak of the map of centres is a person, whose numbers stand there.

    Args:
        centers: (1, 1, h, w) confidence.
        params: (1, 145, h, w) camera (log scale, tx, ty), 22 rotations in 6D, shape.
        score: least confidence.
    """
    plane = np.ascontiguousarray(centers[0, 0], np.float32)
    peaks = (plane >= cv2.dilate(plane, _ROMP_WINDOW)) & (plane >= score)
    numbers = params[0][:, peaks].T
    camera = numbers[:, :3].astype(float)
    camera[:, 0] = _ROMP_SCALE ** camera[:, 0]
    return Regressed(numbers[:, 3 : 3 + 6 * _WITHOUT_HANDS], None, camera, plane[peaks])


def read_rotations(pose: NDArray, orient: NDArray | None, form: str) -> Array:
    """The joints' rotations relative to their parents.

    Args:
        pose: (N, ...) the numbers of 24 joints, or of 22 without hands; without the root if `orient` is given.
        orient: (N, ...) the root's.
        form: "matrix", "6d", "6d-rows" or "axis-angle".

    Returns:
        (N, 24, 3, 3); missing hands are straight.

    Raises:
        ValueError: the numbers are not those of 24 or 22 joints.
    """
    parts = [pose] if orient is None else [orient, pose]
    numbers = _NUMBERS[form]
    counts = [math.prod(part.shape[1:]) for part in parts]
    if any(count % numbers for count in counts):
        raise ValueError(f'{_shapes(parts)} are no rotations of the form "{form}"')
    joints = [part.reshape(len(part), n // numbers, numbers) for part, n in zip(parts, counts, strict=True)]
    matrices = np.concatenate([_matrices(part, form) for part in joints], axis=1)
    count = matrices.shape[1]
    if count not in (_JOINTS, _WITHOUT_HANDS):
        raise ValueError(f"{_shapes(parts)} are {count} joints: {_JOINTS} or {_WITHOUT_HANDS} are wanted")
    hands = np.broadcast_to(np.eye(3), (len(matrices), _JOINTS - count, 3, 3))
    return np.concatenate([matrices, hands], axis=1)


def _matrices(numbers: NDArray, form: str) -> Array:
    """(N, J, 3, 3) from (N, J, n)."""
    numbers = numbers.astype(float)
    if form == "axis-angle":
        return matrix_from_rotvec(numbers)
    if form == "matrix":
        return _nearest_rotation(numbers.reshape(*numbers.shape[:2], 3, 3))
    if form == "6d":
        return _orthonormal(numbers[..., 0::2], numbers[..., 1::2])
    return np.swapaxes(_orthonormal(numbers[..., :3], numbers[..., 3:]), -1, -2)


def _orthonormal(first: Array, second: Array) -> Array:
    """Rotations (..., 3, 3) whose first two columns are nearest, in that order, to the given (..., 3)."""
    x = first / np.maximum(np.linalg.norm(first, axis=-1, keepdims=True), 1e-12)
    y = second - (x * second).sum(axis=-1, keepdims=True) * x
    y = y / np.maximum(np.linalg.norm(y, axis=-1, keepdims=True), 1e-12)
    return np.stack([x, y, np.cross(x, y)], axis=-1)


def _nearest_rotation(matrices: Array) -> Array:
    """Networks round: the rotations nearest to (..., 3, 3), never a reflection."""
    u, _, vt = np.linalg.svd(matrices)
    sign = np.sign(np.linalg.det(u @ vt))
    u[..., 2] *= sign[..., None]
    return np.matmul(u, vt)


def posed_keypoints(rotations: Array, body: BodyModel, axes: str) -> Array:
    """The neutral body's keypoints (N, 25, 3) in poses (N, 24, 3, 3): metres, camera's axes, origin at the mid-hips."""
    if len(rotations) == 0:
        return np.zeros((0, len(body.keypoint_regressor), 3))
    joints = body.rest_joints(body.neutral_betas)
    turns, positions = pose_joints(rotvec_from_matrix(rotations), joints)
    points = skin(body.rest_keypoints(body.neutral_betas), body.keypoint_weights, turns, positions, joints)
    points = points - points[:, _MID_HIPS].mean(axis=1, keepdims=True)
    return points * (1, -1, -1) if axes == "y-up" else points


def along_ray(points: Array, place: Array) -> Array:
    """Points (N, 25, 3) as seen along the ray to where each person is, (N, 3) in the camera's axes."""
    turn = align_vectors(place, np.array([0.0, 0.0, 1.0]))
    return points @ np.swapaxes(turn, -1, -2)


def project(points: Array, camera: Array, form: str, size: tuple[int, int], fov_degrees: float) -> Array:
    """Where points lie in the network's input.

    Args:
        points: (N, 25, 3) metres.
        camera: (N, 3).
        form: "hmr", "romp" or "translation".
        size: (width, height) of the input, whose edges are at -1 and 1 for the first two.
        fov_degrees: along the longer side, for the third.

    Returns:
        (N, 25, 2) pixels of the input.
    """
    half = np.array(size) / 2
    if form == "translation":
        there = points + camera[:, None]
        focal = max(size) / (2 * math.tan(math.radians(fov_degrees) / 2))
        return focal * there[..., :2] / np.maximum(there[..., 2:], 1e-3) + half
    scale, offset = camera[:, None, :1], camera[:, None, 1:]
    seen = scale * (points[..., :2] + offset) if form == "hmr" else scale * points[..., :2] + offset
    return (seen + 1) * half


def _shapes(parts: list[NDArray]) -> str:
    return " and ".join(str(part.shape) for part in parts)
