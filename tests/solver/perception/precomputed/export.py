"""A synthetic clip's true modalities, written as other programs would."""

import json
from pathlib import Path

import cv2
import numpy as np

from core_solver.camera import Camera, camera_from_fov
from core_solver.geometry import align_vectors, matrix_from_rotvec, rotvec_from_matrix
from tests.solver.scenes import SyntheticClip

WIDTH, HEIGHT, FRAMES = 320, 240, 12
CAMERA = camera_from_fov(WIDTH, HEIGHT, 60, "truth")


def draw_video(path: Path, frames: int = FRAMES, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Path:
    """A patterned wall."""
    rng = np.random.default_rng(0)
    wall = cv2.resize(rng.integers(30, 220, (40, 60, 3)).astype(np.uint8), size)
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), 25.0, size)
    assert writer.isOpened()
    for _ in range(frames):
        writer.write(wall)
    writer.release()
    return path


def write_alphapose(file: Path, clip: SyntheticClip, first: int = 0, scale: float = 1.0) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    people = []
    for t in range(len(clip.modalities.times)):
        for track in clip.modalities.tracks:
            points = np.column_stack([track.keypoints[t, :17] * scale, track.confidence[t, :17]])
            people.append({"image_id": f"img_{t + first:06d}.jpg", "category_id": 1, "score": 2.9,
                           "keypoints": points.ravel().tolist(), "idx": 10 + track.id})  # fmt: skip
    file.write_text(json.dumps(people))
    return file


def write_romp(folder: Path, clip: SyntheticClip, camera: Camera = CAMERA, first: int = 0) -> None:
    """As ROMP sees people: each along their own viewing ray, and in another order in every frame."""
    folder.mkdir(parents=True, exist_ok=True)
    for t in range(len(clip.modalities.times)):
        order = np.roll(np.arange(len(clip.theta)), t)
        theta = clip.theta[order, t].copy()
        rays = clip.joints[order, t].mean(axis=1)
        to_ray = np.swapaxes(align_vectors(np.broadcast_to([0.0, 0.0, 1.0], rays.shape), rays), -1, -2)
        theta[:, 0] = rotvec_from_matrix(to_ray @ matrix_from_rotvec(theta[:, 0]))
        points = np.zeros((len(order), 71, 2), np.float32)
        points[:, :24] = [camera.project(joints) for joints in clip.joints[order, t]]
        results = {"smpl_thetas": theta.reshape(-1, 72).astype(np.float32), "pj2d_org": points,
                   "smpl_betas": np.zeros((len(order), 10), np.float32)}  # fmt: skip
        np.savez(folder / f"img_{t + first:06d}.npz", results=results)  # type: ignore[arg-type]


def write_disparity(folder: Path, clip: SyntheticClip, first: int = 0) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    assert clip.modalities.disparity is not None
    for t, plane in enumerate(clip.modalities.disparity.astype(float)):
        levels = np.round(65535 * (plane - plane.min()) / np.ptp(plane)).astype(np.uint16)
        assert cv2.imwrite(str(folder / f"img_{t + first:06d}.png"), levels)


def write_ids(folder: Path, clip: SyntheticClip, first: int = 0, shuffled: bool = False) -> None:
    """Pictures of ids at the video's size; shuffled as a network numbers people, anew in every picture."""
    folder.mkdir(parents=True, exist_ok=True)
    for t, labels in enumerate(clip.modalities.labels):
        ids = cv2.resize(labels, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
        ids = np.where((ids > 0) & shuffled & (t % 2 == 1), 3 - ids, ids).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"img_{t + first:06d}.png"), ids)
