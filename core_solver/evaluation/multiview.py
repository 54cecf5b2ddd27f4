"""Truth in our own open format: joints in one world, measured with several cameras or any other way.

`docs/evaluation.md` describes the file, so that users can write their own.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.evaluation.metrics import Array
from core_solver.evaluation.real_truth import HIPS, RealTruth, TruthError, require_same_picture, truth_in_view
from core_solver.take import Take

# Skeletons disagree about where these are: a neck is the middle of the shoulders here and a vertebra there.
NOT_COMPARED = frozenset({"pelvis", "neck"})

_RATE_TOLERANCE = 0.01
_NEEDED = ("joints", "joint_names", "valid", "K", "dist", "R_wc", "t_wc")
_TURN_TOLERANCE = 1e-3


@dataclass(frozen=True)
class MultiviewTruth:
    """A file of truth, checked. World frame of any origin, metres.

    Attributes:
        path: of the file.
        joint_names: (J,).
        joints: (N, T, J, 3), NaN where not known.
        frames: (T,) frame numbers in the videos.
        person_names: (N,).
        heights: (N,) statures, NaN where not known.
        camera_names: (C,).
        intrinsics: (C, 3, 3).
        distortion: (C, 5).
        rotations: (C, 3, 3) world to camera.
        translations: (C, 3).
        image_size: width and height in pixels, if the file tells.
        frame_rate: frames a second of the videos, if the file tells.
    """

    path: Path
    joint_names: tuple[str, ...]
    joints: Array
    frames: NDArray[np.int64]
    person_names: tuple[str, ...]
    heights: Array
    camera_names: tuple[str, ...]
    intrinsics: Array
    distortion: Array
    rotations: Array
    translations: Array
    image_size: tuple[int, int] | None
    frame_rate: float | None

    def seen_by(self, camera_name: str, take: Take) -> RealTruth:
        """The truth in the frame of one camera, for a take of its footage.

        Raises:
            TruthError: there is no such camera, or the take is of other footage.
        """
        if camera_name not in self.camera_names:
            known = ", ".join(self.camera_names)
            raise TruthError(f"{self.path.name}: there is no camera {camera_name!r}: choose --camera from {known}")
        self._require_same_footage(take)
        index = self.camera_names.index(camera_name)
        size = self.image_size or (take.meta.camera.width, take.meta.camera.height)
        joints = self.joints @ self.rotations[index].T + self.translations[index]
        camera = _camera(self.intrinsics[index], self.distortion[index], size)
        return truth_in_view(
            camera_name, camera, self.joint_names, joints, self.frames, self.person_names, self.heights
        )

    def _require_same_footage(self, take: Take) -> None:
        if self.image_size is not None:
            require_same_picture(self.path.name, self.image_size, take.meta.camera)
        rate = float(take.meta.frame_rate * take.meta.frame_step)
        if self.frame_rate is not None and abs(rate / self.frame_rate - 1) > _RATE_TOLERANCE:
            raise TruthError(
                f"{self.path.name}: its videos have {self.frame_rate:g} frames a second, the take's has {rate:g}: "
                "give the take of the same clip"
            )


def read_multiview(path: Path) -> MultiviewTruth:
    """Read and check a file of truth.

    Raises:
        TruthError: missing or damaged file, or arrays that do not fit each other.
    """
    if not path.is_file():
        raise TruthError(f"there is no truth at {path}: check --truth")
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {key: archive[key] for key in archive.files}
    except Exception as error:  # a damaged archive raises almost anything
        raise TruthError(f"{path.name}: not a readable .npz archive of plain arrays: get the file again") from error
    missing = [key for key in _NEEDED if key not in arrays]
    if missing:
        raise TruthError(f"{path.name}: the entry {missing[0]} is missing: see docs/evaluation.md for the format")
    try:
        truth = _assemble(path, arrays)
    except (TypeError, ValueError, OverflowError) as error:
        raise TruthError(f"{path.name}: its entries do not fit each other ({error}): see docs/evaluation.md") from error
    _check(truth)
    return truth


def _assemble(path: Path, arrays: dict[str, NDArray[Any]]) -> MultiviewTruth:
    joints = arrays["joints"].astype(float)
    if joints.ndim != 4 or joints.shape[3] != 3:
        raise ValueError(f"joints have the shape {joints.shape} instead of (N, T, J, 3)")
    people, count, joint_count = joints.shape[:3]
    valid = _shaped(arrays, "valid", (people, count, joint_count)).astype(bool)
    names = _names(arrays, "joint_names", joint_count)
    compared = [index for index, name in enumerate(names) if name not in NOT_COMPARED]
    cameras = len(np.atleast_1d(arrays["K"]))
    first = int(arrays.get("first_frame", np.int64(0)))
    return MultiviewTruth(
        path=path,
        joint_names=tuple(names[index] for index in compared),
        joints=np.where(valid[..., None], joints, np.nan)[:, :, compared],
        frames=first + np.arange(count),
        person_names=_names(arrays, "person_names", people, [f"person {n + 1}" for n in range(people)]),
        heights=_shaped(arrays, "heights_m", (people,), np.full(people, np.nan)).astype(float),
        camera_names=_names(arrays, "camera_names", cameras, [f"cam{c + 1:02d}" for c in range(cameras)]),
        intrinsics=_shaped(arrays, "K", (cameras, 3, 3)).astype(float),
        distortion=_shaped(arrays, "dist", (cameras, 5)).astype(float),
        rotations=_shaped(arrays, "R_wc", (cameras, 3, 3)).astype(float),
        translations=_shaped(arrays, "t_wc", (cameras, 3)).astype(float),
        image_size=_image_size(arrays),
        frame_rate=float(arrays["fps"]) if "fps" in arrays else None,
    )


def _check(truth: MultiviewTruth) -> None:
    missing = [hip for hip in HIPS if hip not in truth.joint_names]
    if missing:
        raise TruthError(f"{truth.path.name}: the joint {missing[0]} is missing: both hips are needed for the root")
    turns = truth.rotations @ np.swapaxes(truth.rotations, 1, 2)
    # "not less than" also refuses NaN.
    if not np.abs(turns - np.eye(3)).max(initial=0) < _TURN_TOLERANCE or (np.linalg.det(truth.rotations) < 0).any():
        raise TruthError(f"{truth.path.name}: R_wc holds something that is no rotation: see docs/evaluation.md")
    if not all(np.isfinite(array).all() for array in (truth.intrinsics, truth.distortion, truth.translations)):
        raise TruthError(f"{truth.path.name}: a camera has numbers that are not finite: see docs/evaluation.md")


def _shaped(
    arrays: dict[str, NDArray[Any]], key: str, shape: tuple[int, ...], default: NDArray[Any] | None = None
) -> NDArray[Any]:
    array = arrays.get(key, default)
    if array is None or array.shape != shape:
        raise ValueError(f"{key} has the shape {None if array is None else array.shape} instead of {shape}")
    return array


def _names(arrays: dict[str, NDArray[Any]], key: str, count: int, default: list[str] | None = None) -> tuple[str, ...]:
    names = tuple(str(name) for name in np.atleast_1d(arrays[key])) if key in arrays else tuple(default or ())
    if len(names) != count or len(set(names)) != count:
        raise ValueError(f"{key} needs {count} different names")
    return names


def _image_size(arrays: dict[str, NDArray[Any]]) -> tuple[int, int] | None:
    if "image_size" not in arrays:
        return None
    width, height = (int(pixels) for pixels in arrays["image_size"])
    return width, height


def _camera(matrix: Array, distortion: Array, size: tuple[int, int]) -> Camera:
    k1, k2, p1, p2, k3 = (float(k) for k in distortion)
    return Camera(
        *size, float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]),
        (k1, k2, p1, p2, k3), "truth",
    )  # fmt: skip
