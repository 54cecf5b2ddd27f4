"""A small take of two box people and a drawn video that belongs to it."""

import math
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from core_solver.body import BodyModel
from core_solver.take import CameraModel, Ground, Meta, Person, Scene, Take
from tests.solver.body.synthetic import make_stick_body

RATE = 25.0
CAMERA_HEIGHT = 1.6
DISTORTION = (-0.08, 0.02, 0.001, -0.001, 0.0)
RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.2, 0.9)


def make_camera(width: int = 320, height: int = 240, distortion=DISTORTION) -> CameraModel:
    focal = 0.9 * max(width, height)
    return CameraModel(width, height, focal, focal, width / 2 + 3, height / 2 - 2, distortion, "test lens")


def make_person(body: BodyModel, track_id: int, colour, start, velocity, frames: int, valid=None) -> Person:
    """A person in a T-pose who faces the camera and glides over a level floor CAMERA_HEIGHT below it."""
    theta = np.zeros((frames, 24, 3), np.float32)
    theta[:, 0, 0] = math.pi  # SMPL's y up, z to the front -> y down, z away: half a turn about x
    rest_vertices, rest_joints = body.rest_vertices(body.neutral_betas), body.rest_joints(body.neutral_betas)
    root = rest_joints[0]
    soles = root[1] - rest_vertices[:, 1].min()
    path = np.array(start) + np.arange(frames)[:, None] / RATE * np.array(velocity)
    pelvis = np.stack([path[:, 0], np.full(frames, CAMERA_HEIGHT - soles), path[:, 1]], axis=-1)
    order = np.argsort(-body.weights, axis=1)[:, :4]
    weights = np.take_along_axis(body.weights, order, axis=1)
    return Person(
        id=track_id,
        name=f"Person {track_id}",
        height_m=float(np.ptp(rest_vertices[:, 1])),
        colour=colour,
        theta=theta,
        gamma=(pelvis - root).astype(np.float32),
        betas=np.asarray(body.neutral_betas, np.float32),
        scale=1.0,
        valid=np.ones(frames, bool) if valid is None else valid,
        confidence=np.ones((frames, 24), np.float32),
        contacts=np.zeros((frames, 2), np.float32),
        rest_joints=rest_joints.astype(np.float32),
        rest_vertices=rest_vertices.astype(np.float32),
        faces=body.faces,
        weight_joints=order.astype(np.uint8),
        weights=(weights / weights.sum(axis=1, keepdims=True)).astype(np.float32),
    )


def make_take(camera: CameraModel | None = None, frames: int = 12, people=None, first_frame=0, frame_step=1) -> Take:
    camera = camera or make_camera()
    body = make_stick_body()
    if people is None:
        gone = np.arange(frames) < frames // 2
        people = (
            make_person(body, 1, RED, (-0.6, 4.0), (0.5, 0.0), frames),
            make_person(body, 2, BLUE, (0.5, 5.0), (0.0, 0.4), frames, valid=gone),
        )
    rng = np.random.default_rng(0)
    floor = np.stack([rng.uniform(-3, 3, 4000), np.full(4000, CAMERA_HEIGHT), rng.uniform(2, 9, 4000)], axis=-1)
    scene = Scene(
        points=floor.astype(np.float32),
        colors=rng.integers(60, 200, (4000, 3)).astype(np.uint8),
        depth=np.zeros((0, 0), np.float32),
        z_near=np.ones(frames, np.float32),
        z_far=np.full(frames, 10, np.float32),
    )
    meta = Meta(
        frame_rate=Fraction(25) / frame_step,
        first_frame=first_frame,
        frame_step=frame_step,
        video_name="clip.avi",
        camera=camera,
        gravity=(0.0, 1.0, 0.0),
        ground=Ground((0.0, -1.0, 0.0), CAMERA_HEIGHT),
        body_model="stick",
        body_licence="none",
        depth_source="ground-plane prior",
        preset="fast",
        solver_version="0",
        warnings=("the camera moved by 2 pixels",),
    )
    times = (first_frame + frame_step * np.arange(frames)) / RATE
    return Take(meta, times, tuple(people), scene)


def write_video(path: Path, camera: CameraModel, frames: int, grey: int = 128) -> Path:
    """A grey clip whose first row tells the frame number: one white pixel."""
    # OpenCV's own Motion-JPEG writer is the one that keeps odd sizes.
    size = (camera.width, camera.height)
    writer = cv2.VideoWriter(str(path), cv2.CAP_OPENCV_MJPEG, cv2.VideoWriter.fourcc(*"MJPG"), RATE, size)
    assert writer.isOpened()
    for number in range(frames):
        picture = np.full((camera.height, camera.width, 3), grey, np.uint8)
        picture[0, number] = 255
        writer.write(picture)
    writer.release()
    return path


def project_by_hand(point, camera: CameraModel) -> tuple[float, float]:
    """The lens model written out: OpenCV's k1 k2 p1 p2 k3."""
    x, y = point[0] / point[2], point[1] / point[2]
    k1, k2, p1, p2, k3 = camera.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    u = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    v = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return camera.fx * u + camera.cx, camera.fy * v + camera.cy
