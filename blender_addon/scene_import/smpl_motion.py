# SPDX-License-Identifier: GPL-3.0-or-later
"""One person's SMPL motion, as AMASS and many tools store it, read as a take without video and scene. numpy only.

Such files hold poses and a path but no body: joints follow from `betas` only with SMPL's own data, whose licence keeps
it out of here. The open body's mean proportions take its place, scaled so that the feet reach the floor at z = 0.
"""

import zipfile
import zlib
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import TakeError
from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix
from core_solver.take import JOINT_NAMES, PARENTS, CameraModel, Ground, Meta, Person, Scene, Take

Array = NDArray[np.float64]

_RATE_KEYS = ("mocap_framerate", "mocap_frame_rate", "framerate", "frame_rate", "fps", "frameRate")
_ASSUMED_RATE = Fraction(30)
_NTSC_TOLERANCE = 0.006
# Values of a pose in the usual layouts: SMPL; its body alone; with SMPL-H's hands; with SMPL-X's face and hands.
_POSE_SIZES = (72, 66, 156, 165)
_BODY_JOINTS = 22

# An adult of the open body's mean proportions, 1.70 m tall, in SMPL's axes, metres: the steps from each parent, for the
# trunk and the left side.
_STEPS = {
    "spine1": (0.0, 0.116, -0.035), "spine2": (0.0, 0.129, 0.025), "spine3": (0.0, 0.052, 0.002),
    "neck": (0.0, 0.198, -0.031), "head": (0.0, 0.084, 0.047),
    "left_hip": (0.058, -0.081, -0.007), "left_knee": (0.042, -0.377, 0.001), "left_ankle": (-0.017, -0.427, -0.036),
    "left_foot": (0.039, -0.062, 0.129), "left_collar": (0.064, 0.054, 0.018), "left_shoulder": (0.111, 0.043, -0.013),
    "left_elbow": (0.257, -0.015, -0.027), "left_wrist": (0.231, 0.009, -0.006), "left_hand": (0.104, -0.013, -0.016),
}  # fmt: skip
_PELVIS = (0.0, -0.22, 0.03)
"""SMPL's pose turns about a pelvis that lies below the model's origin, by about this much, metres."""
_SOLE = 0.03
"""From the joint at the toes down to the sole, metres."""
_CROWN = 0.14
"""From the head's joint up to the crown, metres."""
_PLAUSIBLE_SCALES = (0.5, 1.3)

# AMASS's world seen by a camera that stands at its origin and looks along y: x right, y down, z ahead.
_CAMERA_FROM_WORLD = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


@dataclass(frozen=True)
class SmplMotion:
    """What such a file says.

    Attributes:
        theta: (T, 24, 3) axis-angle; hands beyond SMPL's are left out.
        path: (T, 3) `trans`, metres, z up.
        betas: (10,) shape, for the record.
        rate: frames per second.
        rate_known: whether the file says it.
    """

    theta: Array
    path: Array
    betas: Array
    rate: Fraction
    rate_known: bool


def is_smpl_motion(names: list[str]) -> bool:
    """Whether an archive with entries of these names holds an SMPL motion and no take."""
    return {"poses", "trans"} <= set(names) and "meta" not in names


def read_smpl_motion(path: Path) -> SmplMotion:
    """Read and check an archive.

    Raises:
        TakeError: damaged, empty or in another layout; the message names the entry.
    """
    with np.load(path, allow_pickle=False) as archive:
        poses = _numbers(archive, "poses", path)
        trans = _numbers(archive, "trans", path)
        betas = _numbers(archive, "betas", path) if "betas" in archive.files else np.zeros(0)
        rates = [float(_numbers(archive, key, path).ravel()[0]) for key in _RATE_KEYS if key in archive.files]
    frames = len(poses)
    poses = poses.reshape(frames, -1)
    if not frames or poses.shape[1] not in _POSE_SIZES:
        wanted = ", ".join(map(str, _POSE_SIZES[:-1])) + f" or {_POSE_SIZES[-1]}"
        raise TakeError(f"{path.name}: poses has shape {poses.shape} instead of frames by {wanted} values")
    if trans.shape != (frames, 3):
        raise TakeError(f"{path.name}: trans has shape {trans.shape} instead of {(frames, 3)}")
    if rates and not 0 < rates[0] < 10_000:
        raise TakeError(f"{path.name}: the frame rate {rates[0]} cannot be: mend the file")
    theta = np.zeros((frames, 24, 3))
    # SMPL's last two joints are hands; at their place SMPL-H and SMPL-X have a finger, jaw and eyes.
    joints = 24 if poses.shape[1] == 72 else _BODY_JOINTS
    theta[:, :joints] = poses[:, : 3 * joints].reshape(frames, joints, 3)
    shape = np.zeros(10)
    given = betas.reshape(-1)[:10]
    shape[: len(given)] = given
    rate = exact_rate(rates[0]) if rates else _ASSUMED_RATE
    return SmplMotion(theta, trans, shape, rate, bool(rates))


def take_of(motion: SmplMotion, name: str) -> Take:
    """A take of one person with the motion in its own world; without video, so without a camera to be shown.

    Args:
        motion: z up.
        name: of the person.
    """
    frames = len(motion.theta)
    rest = rest_joints()
    scale, floor_found = fit_scale(motion, rest)
    height = scale * (float(np.ptp(rest[:, 1])) + _SOLE + _CROWN)
    theta = motion.theta.copy()
    theta[:, 0] = rotvec_from_matrix(_CAMERA_FROM_WORLD @ matrix_from_rotvec(theta[:, 0]))
    turned_pelvis = scale * rest[0]
    person = Person(
        id=1,
        name=name,
        height_m=round(height, 3),
        colour=(0.9, 0.6, 0.2),
        theta=theta.astype(np.float32),
        # The model turns about its pelvis, which stays where it was: the camera's axes turn the path alone.
        gamma=((motion.path + turned_pelvis) @ _CAMERA_FROM_WORLD.T - turned_pelvis).astype(np.float32),
        betas=motion.betas.astype(np.float32),
        scale=scale,
        valid=np.ones(frames, bool),
        confidence=np.ones((frames, 24), np.float32),
        contacts=np.zeros((frames, 2), np.float32),
        rest_joints=rest.astype(np.float32),
        rest_vertices=np.zeros((0, 3), np.float32),
        faces=np.zeros((0, 3), np.int32),
        weight_joints=np.zeros((0, 4), np.uint8),
        weights=np.zeros((0, 4), np.float32),
    )
    meta = Meta(
        frame_rate=motion.rate,
        first_frame=0,
        frame_step=1,
        video_name="",
        camera=CameraModel(1920, 1080, 1920.0, 1920.0, 960.0, 540.0),
        gravity=(0.0, 1.0, 0.0),
        ground=Ground((0.0, -1.0, 0.0), 0.0),
        body_model="open-body-mean",
        body_licence="CC0-1.0",
        depth_source="none",
        preset="none",
        solver_version="",
        warnings=_warnings(motion, height, floor_found),
    )
    return Take(meta, np.arange(frames) / float(motion.rate), (person,), _no_scene(frames))


def rest_joints() -> Array:
    """(24, 3) the mean adult's joints at rest, SMPL's axes, metres, the pelvis where SMPL has it."""
    joints = np.zeros((24, 3))
    joints[0] = _PELVIS
    for joint, name in enumerate(JOINT_NAMES[1:], start=1):
        step = np.array(_STEPS[name.replace("right_", "left_")])
        joints[joint] = joints[PARENTS[joint]] + step * (-1.0 if name.startswith("right_") else 1.0, 1.0, 1.0)
    return joints


def fit_scale(motion: SmplMotion, rest: Array) -> tuple[float, bool]:
    """The scale at which the lowest foot of the whole motion just reaches the floor at z = 0.

    A foot hangs below the model's origin by a length that grows with the scale: the frames in which it touches the
    floor are those that allow the smallest scale. A few frames may lie deeper: they are noise.

    Returns:
        The scale, and whether the floor was found; without one the scale is 1.
    """
    hanging = -_lowest_foot(motion.theta, rest)
    usable = hanging > 0.5
    if not usable.any():
        return 1.0, False
    scale = float(np.percentile(motion.path[usable, 2] / hanging[usable], 2))
    if not _PLAUSIBLE_SCALES[0] <= scale <= _PLAUSIBLE_SCALES[1]:
        return 1.0, False
    return scale, True


def exact_rate(rate: float) -> Fraction:
    """The fraction that a rounded rate means: 59.94 is 60000/1001."""
    ntsc = Fraction(1000 * round(rate * 1.001), 1001)
    if round(rate) != rate and abs(float(ntsc) - rate) < _NTSC_TOLERANCE:
        return ntsc
    return Fraction(rate).limit_denominator(1001)


def _lowest_foot(theta: Array, rest: Array) -> Array:
    """(T,) height of the lower sole above the model's origin, at scale 1."""
    local = matrix_from_rotvec(theta)
    turns, places = [local[:, 0]], [np.broadcast_to(rest[0], (len(theta), 3))]
    for joint, parent in enumerate(PARENTS[1:], start=1):
        turns.append(turns[parent] @ local[:, joint])
        places.append(places[parent] + turns[parent] @ (rest[joint] - rest[parent]))
    feet = [places[JOINT_NAMES.index(name)][:, 2] for name in ("left_foot", "right_foot")]
    return np.minimum(*feet) - _SOLE


def _warnings(motion: SmplMotion, height: float, floor_found: bool) -> tuple[str, ...]:
    why = "so that the feet reach the floor" if floor_found else "as no floor was found at z = 0"
    body = f"Only SMPL's own data know its body: mean proportions, {height:.2f} m tall, move instead, {why}."
    if motion.rate_known:
        return (body,)
    return (body, f"The file says no frame rate: {float(motion.rate):g} frames per second are assumed.")


def _no_scene(frames: int) -> Scene:
    empty = np.zeros((0, 3), np.float32)
    near, far = np.full(frames, 1.0, np.float32), np.full(frames, 20.0, np.float32)
    return Scene(empty, np.zeros((0, 3), np.uint8), np.zeros((0, 0), np.float32), near, far)


def _numbers(archive: Any, key: str, path: Path) -> Array:
    """An entry as finite floats.

    Raises:
        TakeError: it holds objects, text or values that are not finite.
    """
    try:
        values = np.asarray(archive[key], float)
    except (ValueError, TypeError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise TakeError(f"{path.name}: the entry {key} holds no plain numbers: save it as an array") from error
    if not values.size or not np.isfinite(values).all():
        raise TakeError(f"{path.name}: the entry {key} is empty or holds values that are not finite")
    return values
