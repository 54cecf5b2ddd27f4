"""What a take holds, as frozen dataclasses. Camera frame (OpenCV), metres, seconds, throughout."""

from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.take.skeleton import JOINT_NAMES, PARENTS

FORMAT = "scene-aware-mocap/take"
VERSION = 1

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class CameraModel:
    """Pinhole intrinsics with OpenCV distortion; pixel (0.5, 0.5) is the centre of the top-left pixel.

    Attributes:
        width: pixels, as the video is shown (after its rotation flag).
        height: pixels.
        fx: focal length in pixels.
        fy: focal length in pixels.
        cx: principal point in pixels.
        cy: principal point in pixels.
        distortion: k1 k2 p1 p2 k3, all zero for a pinhole.
        source: where the numbers come from, in plain words.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)
    source: str = ""


@dataclass(frozen=True)
class Ground:
    """Ground plane in the camera frame: points x with normal . x + offset = 0.

    Attributes:
        normal: unit vector pointing up.
        offset: metres, positive when the camera is above the ground.
    """

    normal: tuple[float, float, float]
    offset: float


@dataclass(frozen=True)
class Meta:
    """Everything of a take that is not an array.

    Attributes:
        frame_rate: frames per second of the take, exact.
        first_frame: number of the take's first frame in the video, counted from 0.
        frame_step: video frames from one frame of the take to the next.
        video_name: file name without folder.
        camera: intrinsics.
        gravity: unit vector pointing down, camera frame.
        ground: ground plane.
        body_model: id of the body model whose theta and betas these are.
        body_licence: its licence.
        depth_source: what gave depth: a network's name, or "ground-plane prior".
        preset: solver preset.
        solver_version: version of the program that wrote the take.
        settings: further settings as JSON values, for the record.
        warnings: plain sentences a user should read.
        joint_names: names of the 24 joints.
        parents: parent index per joint, -1 for the pelvis.
        extra: unknown JSON entries of a file, kept on rewrite.
    """

    frame_rate: Fraction
    first_frame: int
    frame_step: int
    video_name: str
    camera: CameraModel
    gravity: tuple[float, float, float]
    ground: Ground
    body_model: str
    body_licence: str
    depth_source: str
    preset: str
    solver_version: str
    settings: dict[str, Any] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    joint_names: tuple[str, ...] = JOINT_NAMES
    parents: tuple[int, ...] = PARENTS
    extra: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Person:
    """One person's track: joints(t) = scale * FK(theta(t), rest_joints) + gamma(t), root at rest_joints[0].

    Attributes:
        id: stable over the clip.
        name: shown to the user.
        height_m: standing height, metres.
        colour: red, green, blue in [0, 1].
        theta: (T, 24, 3) axis-angle.
        gamma: (T, 3) metres, camera frame.
        betas: (10,) shape.
        scale: person scale, > 0.
        valid: (T,) bool, whether the frame has evidence of this person; other frames are filled.
        confidence: (T, 24) in [0, 1].
        contacts: (T, 2) probability of left / right foot on the ground.
        rest_joints: (24, 3) metres before `scale`.
        rest_vertices: (V, 3) metres before `scale`.
        faces: (F, 3) triangles.
        weight_joints: (V, 4) joint indices.
        weights: (V, 4) skinning weights, rows sum to 1.
    """

    id: int
    name: str
    height_m: float
    colour: tuple[float, float, float]
    theta: Floats
    gamma: Floats
    betas: Floats
    scale: float
    valid: NDArray[np.bool_]
    confidence: Floats
    contacts: Floats
    rest_joints: Floats
    rest_vertices: Floats
    faces: NDArray[np.int32]
    weight_joints: NDArray[np.uint8]
    weights: Floats


@dataclass(frozen=True)
class Scene:
    """The static scene.

    Attributes:
        points: (P, 3) metres.
        colors: (P, 3) sRGB, 0-255.
        depth: (H, W) metres at the depth network's size, NaN where never seen; (0, 0) without depth.
        z_near: (T,) metres per frame.
        z_far: (T,) metres per frame.
    """

    points: Floats
    colors: NDArray[np.uint8]
    depth: Floats
    z_near: Floats
    z_far: Floats


@dataclass(frozen=True)
class Take:
    """A whole take.

    Attributes:
        meta: names, camera, gravity, ground, settings.
        times: (T,) seconds from the start of the video.
        people: the tracks.
        scene: the static scene.
        steadying: (T, 3, 3) homographies from pixels of each frame of the video to those of the take's camera, where
            the video shook and that was compensated; None where its pixels are the camera's.
        extra: arrays under unknown keys, kept on rewrite.
    """

    meta: Meta
    times: NDArray[np.float64]
    people: tuple[Person, ...]
    scene: Scene
    steadying: NDArray[np.float64] | None = None
    extra: dict[str, NDArray[Any]] = field(default_factory=dict)

    @property
    def frame_count(self) -> int:
        """T."""
        return len(self.times)
