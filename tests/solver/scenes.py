"""Small synthetic clips with exact truth: box people walk on a floor before a known, tilted camera."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import cv2
import numpy as np

from core_solver.body import kinematics
from core_solver.body.model import BodyModel
from core_solver.body.skeleton import joint_index
from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import align_vectors, matrix_from_rotvec, rotvec_from_matrix
from core_solver.tracking.tracks import Modalities, Track

LANDMARK_NOISE_M = (0.01, 0.01, 0.05)  # in every frame the same: networks err about a body's depth, and stay with it


@dataclass(frozen=True)
class Walker:
    """Somebody who starts somewhere on the floor (metres right of and away from the camera) and walks ahead.

    Attributes:
        scale: of the whole body.
        start: metres.
        heading: radians about the vertical; at 0 the person comes towards the camera.
        level: metres by which the place to walk on lies above the floor.
        is_still: stands instead of walking.
        on_one_leg: holds the left knee up.
    """

    scale: float
    start: tuple[float, float]
    heading: float
    level: float = 0.0
    is_still: bool = False
    on_one_leg: bool = False


@dataclass(frozen=True)
class SyntheticClip:
    """Modalities with their truth, camera frame, metres.

    Attributes:
        modalities: what a solver sees.
        camera: true intrinsics.
        up: (3,) normal of the floor, which lies `camera_height` below the camera.
        camera_height: metres.
        scales: (N,).
        theta: (N, T, 24, 3) radians.
        gamma: (N, T, 3).
        joints: (N, T, 24, 3).
        vertices: (N, T, V, 3).
    """

    modalities: Modalities
    camera: Camera
    up: np.ndarray
    camera_height: float
    scales: np.ndarray
    theta: np.ndarray
    gamma: np.ndarray
    joints: np.ndarray
    vertices: np.ndarray


def change_tracks(clip: SyntheticClip, change: Callable[[Track], Track]) -> Modalities:
    """The clip's modalities with every track changed."""
    return replace(clip.modalities, tracks=tuple(change(track) for track in clip.modalities.tracks))


def walking_pose(phase: np.ndarray, heading: float, up: np.ndarray) -> np.ndarray:
    """(T, 24, 3) of a simple walk that keeps the torso upright along `up` and faces `heading` on the floor."""
    theta = np.zeros((len(phase), 24, 3))
    swing = 0.4 * np.sin(phase)
    for side, sign in (("left", 1), ("right", -1)):
        theta[:, joint_index(f"{side}_hip"), 0] = -sign * swing
        # A leg bends while it swings forwards and is straight while it carries: the body passes over a resting foot.
        theta[:, joint_index(f"{side}_knee"), 0] = 1.0 * np.maximum(sign * np.cos(phase), 0) ** 2 + 0.05
        theta[:, joint_index(f"{side}_shoulder"), 2] = -sign * 1.2
        theta[:, joint_index(f"{side}_elbow"), 1] = -sign * 0.4
    root = align_vectors([0.0, 1.0, 0.0], up) @ matrix_from_rotvec([0.0, heading, 0.0])
    theta[:, 0] = rotvec_from_matrix(root)
    return theta


def make_clip(
    body: BodyModel, walkers: list[Walker], *, frames: int = 40, rate: float = 25.0, noise_px: float = 1.0,
    seed: int = 0, tilt: float = 0.3, camera_height: float = 2.2, with_depth: bool = True, camera: Camera | None = None,
) -> SyntheticClip:  # fmt: skip
    rng = np.random.default_rng(seed)
    camera = camera or camera_from_fov(960, 720, 60, "truth")
    up = matrix_from_rotvec([tilt, 0, 0.05]) @ np.array([0.0, -1.0, 0.0])
    right = np.cross([0, 0, 1.0], up)
    right /= np.linalg.norm(right)
    away = np.cross(up, right)
    times = np.arange(frames) / rate
    rest = body.rest_joints(body.neutral_betas)
    people, tracks = [], []
    grid = (120 * np.array([camera.height, camera.width]) / max(camera.height, camera.width)).round().astype(int)
    labels = np.zeros((frames, *grid), np.uint8)
    far, gap = 1 / 30.0, 1 / 1.5 - 1 / 30.0
    depth = np.repeat(_plane_depth(camera, up, camera_height, *grid)[None], frames, axis=0)
    for index, walker in enumerate(walkers):
        phase = 0.0 * times if walker.is_still else 2 * np.pi * 0.9 * times + index
        theta = walking_pose(phase, walker.heading, up)
        if walker.on_one_leg:
            theta[:, joint_index("left_hip"), 0], theta[:, joint_index("left_knee"), 0] = -1.2, 1.4
        rotations, positions = kinematics.pose_joints(theta, rest)
        vertices = kinematics.skin(body.rest_vertices(body.neutral_betas), body.weights, rotations, positions, rest)
        metric = walker.scale * vertices
        gamma = _walk(metric, up) - metric[0].mean(axis=0) + right * walker.start[0] + away * walker.start[1]
        # The lowest vertex stands on the floor in every frame.
        lowest = ((metric + gamma[:, None]) @ up).min(axis=1)
        gamma += (walker.level - camera_height - lowest)[:, None] * up
        keypoints = walker.scale * kinematics.skin(
            body.rest_keypoints(body.neutral_betas), body.keypoint_weights, rotations, positions, rest
        )
        keypoints = keypoints + gamma[:, None]
        pixels = camera.project(keypoints) + rng.normal(size=(frames, 25, 2)) * noise_px
        landmarks = keypoints / walker.scale
        landmarks -= landmarks[:, [11, 12]].mean(axis=1, keepdims=True)
        ray = keypoints.mean(axis=1)
        landmarks = landmarks @ align_vectors(np.broadcast_to([0, 0, 1.0], ray.shape), ray)
        landmarks += rng.normal(size=(25, 3)) * LANDMARK_NOISE_M
        vertices = metric + gamma[:, None]
        _paint(labels, depth, vertices, body.faces, camera, index + 1)
        track = Track(
            index + 1, np.ones(frames, bool), pixels.astype(np.float32), np.full((frames, 25), 0.9, np.float32),
            landmarks.astype(np.float32), 0.9,
        )  # fmt: skip
        tracks.append(track)
        people.append((theta, gamma, walker.scale * positions + gamma[:, None], vertices))
    inverse = 1 / depth
    disparity = np.clip((inverse - far) / gap, 0, 1).astype(np.float16)
    modalities = Modalities(
        times,
        np.arange(frames),
        (camera.width, camera.height),
        tuple(tracks),
        labels,
        disparity if with_depth else None,
    )
    scales = np.array([walker.scale for walker in walkers])
    return SyntheticClip(modalities, camera, up, camera_height, scales, *map(np.stack, zip(*people, strict=True)))


def _walk(vertices: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Root motion (T, 3) that keeps the lowest vertex of each frame where it was: feet do not slide."""
    lowest = (vertices @ up).argmin(axis=1)
    shift = np.zeros((len(vertices), 3))
    for t in range(1, len(vertices)):
        shift[t] = shift[t - 1] + vertices[t - 1, lowest[t - 1]] - vertices[t, lowest[t - 1]]
    return shift


def _plane_depth(camera: Camera, up: np.ndarray, height: float, rows: int, columns: int) -> np.ndarray:
    """Depth (rows, columns) of the floor, ending at a wall 25 m away."""
    fall = -(camera.grid_rays(rows, columns) @ up)
    return np.minimum(np.where(fall > 0.05, height / np.maximum(fall, 0.05), 25.0), 25.0).astype(np.float32)


def _paint(labels: np.ndarray, depth: np.ndarray, vertices: np.ndarray, faces: np.ndarray, camera: Camera, value: int):
    """Draw one person into labels and depth, far triangles first, hidden where somebody stands in front."""
    height, width = labels.shape[1:]
    for t, body in enumerate(vertices):
        pixels = camera.project(body) * (width / camera.width, height / camera.height)
        layer = np.zeros((height, width), np.float32)
        means = body[faces, 2].mean(axis=1)
        for triangle in np.argsort(-means):
            corners = np.round(pixels[faces[triangle]] - 0.5).astype(np.int32)
            cv2.fillConvexPoly(layer, corners, float(means[triangle]))
        front = (layer > 0) & (layer < depth[t])
        depth[t][front] = layer[front]
        labels[t][front] = value
