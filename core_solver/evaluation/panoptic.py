"""Sequences in the layout of CMU Panoptic: body3DScene_%08d.json of one world, and a calibration of all cameras.

    SEQ/hdPose3d_stage1_coco19/body3DScene_%08d.json    frame numbers of the HD videos
    SEQ/calibration_SEQ.json

Centimetres there, metres here.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.evaluation.metrics import Array
from core_solver.evaluation.real_truth import RealTruth, TruthError, require_same_picture, truth_in_view
from core_solver.take import Take

POSES = "hdPose3d_stage1_coco19"
COCO19 = (
    "neck", "nose", "mid_hips", "left_shoulder", "left_elbow", "left_wrist", "left_hip", "left_knee", "left_ankle",
    "right_shoulder", "right_elbow", "right_wrist", "right_hip", "right_knee", "right_ankle", "left_eye", "left_ear",
    "right_eye", "right_ear",
)  # fmt: skip
"""Joints of `joints19`, four numbers each: x y z and a confidence."""

_COMPARED = tuple(
    f"{side}_{joint}" for side in ("left", "right") for joint in ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")
)
_METRES = 0.01
_LEAST_CONFIDENCE = 0.1
_FEWEST_JOINTS = 6  # of the twelve compared; people of whom less is known are left out


@dataclass(frozen=True)
class PanopticSequence:
    """One sequence, world frame, metres.

    Attributes:
        name: its directory's.
        joints: (N, T, 12, 3) shoulders to ankles, NaN where not known.
        person_names: (N,) from the dataset's ids.
        frames: (T,) numbers of the frames that have a file.
        cameras: by name, like "00_16".
    """

    name: str
    joints: Array
    person_names: tuple[str, ...]
    frames: NDArray[np.int64]
    cameras: "dict[str, PosedCamera]"

    def seen_by(self, camera_name: str, take: Take) -> RealTruth:
        """The truth in the frame of one camera, for a take of its footage.

        Raises:
            TruthError: there is no such camera, or the take's pictures have another size.
        """
        if camera_name not in self.cameras:
            raise TruthError(f"calibration of {self.name}: there is no camera {camera_name!r}: check the take's name")
        posed = self.cameras[camera_name]
        require_same_picture(f"{self.name} {camera_name}", (posed.camera.width, posed.camera.height), take.meta.camera)
        return truth_in_view(
            f"{self.name} {camera_name}",
            posed.camera,
            _COMPARED,
            self.joints @ posed.rotation.T + posed.translation,
            self.frames,
            self.person_names,
            np.full(len(self.joints), np.nan),
        )


@dataclass(frozen=True)
class PosedCamera:
    """A camera in the world: x_camera = rotation X + translation, metres.

    Attributes:
        camera: intrinsics.
        rotation: (3, 3).
        translation: (3,).
    """

    camera: Camera
    rotation: Array
    translation: Array


def find_sequences(directory: Path) -> list[Path]:
    """The sequences in a directory, or the directory itself if it is one.

    Raises:
        TruthError: there is none.
    """
    candidates = [directory, *sorted(path for path in directory.glob("*") if path.is_dir())]
    sequences = [path for path in candidates if (path / POSES).is_dir()]
    if not sequences:
        raise TruthError(f"no sequence of CMU Panoptic in {directory}: there must be SEQ/{POSES}")
    return sequences


def read_panoptic(directory: Path) -> PanopticSequence:
    """Read one sequence.

    Raises:
        TruthError: a file is missing or damaged.
    """
    files = sorted((directory / POSES).glob("body3DScene_*.json"))
    if not files:
        raise TruthError(f"{directory.name}: no body3DScene_*.json in {POSES}: unpack the sequence's archive there")
    frames = np.array([_frame_number(path) for path in files])
    bodies = [dict(_bodies(path)) for path in files]
    people = sorted({person for frame in bodies for person in frame})
    joints = np.full((len(people), len(files), len(_COMPARED), 3), np.nan)
    for t, frame in enumerate(bodies):
        for person, points in frame.items():
            joints[people.index(person), t] = points
    return PanopticSequence(
        directory.name, joints, tuple(f"person {person}" for person in people), frames, _read_cameras(directory)
    )


def _frame_number(path: Path) -> int:
    digits = path.stem.removeprefix("body3DScene_")
    if not digits.isdecimal():
        raise TruthError(f"{path.name}: its name holds no frame number: remove or rename it")
    return int(digits)


def _bodies(path: Path) -> Iterator[tuple[int, Array]]:
    """Ids and the compared joints (12, 3) in metres of the people of one frame of whom enough is known."""
    try:
        for body in _read_json(path)["bodies"]:
            joints = np.array(body["joints19"], float).reshape(len(COCO19), 4)
            joints = joints[[COCO19.index(name) for name in _COMPARED]]
            known = (joints[:, 3] > _LEAST_CONFIDENCE) & np.isfinite(joints).all(axis=1)
            if known.sum() >= _FEWEST_JOINTS:
                yield int(body["id"]), np.where(known[:, None], joints[:, :3] * _METRES, np.nan)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise TruthError(f"{path.name}: not as CMU Panoptic writes it ({error!r}): get the file again") from error


def _read_cameras(directory: Path) -> dict[str, PosedCamera]:
    path = directory / f"calibration_{directory.name}.json"
    if not path.is_file():
        raise TruthError(f"{directory.name}: {path.name} is missing: the cameras' places are in it")
    try:
        return {str(entry["name"]): _camera(entry) for entry in _read_json(path)["cameras"]}
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise TruthError(f"{path.name}: not as CMU Panoptic writes it ({error!r}): get the file again") from error


def _camera(entry: dict[str, Any]) -> PosedCamera:
    K = np.array(entry["K"], float).reshape(3, 3)
    k1, k2, p1, p2, k3 = (float(k) for k in entry["distCoef"])
    width, height = (int(pixels) for pixels in entry["resolution"])
    camera = Camera(
        width, height, float(K[0, 0]), float(K[1, 1]), float(K[0, 2]), float(K[1, 2]), (k1, k2, p1, p2, k3), "truth"
    )
    rotation = np.array(entry["R"], float).reshape(3, 3)
    return PosedCamera(camera, rotation, np.array(entry["t"], float).reshape(3) * _METRES)


def _read_json(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise TruthError(f"{path.name}: not readable JSON: get the file again") from error
    if not isinstance(document, dict):
        raise TruthError(f"{path.name}: not readable JSON: get the file again")
    return document
