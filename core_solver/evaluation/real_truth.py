"""What really happened in a real clip, as far as a reference measurement knows it."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core_solver.camera import Camera
from core_solver.errors import UserError
from core_solver.evaluation.metrics import Array, Mask
from core_solver.take import CameraModel

HIPS = ("left_hip", "right_hip")

_SEEN_SHARE = 0.5  # of a person's known joints must be in the picture


class TruthError(UserError):
    """Truth that cannot be read or does not belong to the take."""


@dataclass(frozen=True)
class RealTruth:
    """N people over T frames, camera frame (OpenCV), metres. What is not finite is not known.

    Attributes:
        name: of the sequence.
        joint_names: (J,) in the take's names; both hips are among them.
        joints: (N, T, J, 3).
        present: (N, T) the person is in the picture and their root is known.
        root_pixels: (N, T, 2) midway between the hips in the footage.
        frames: (T,) frame numbers in the video, ascending.
        person_names: (N,).
        heights: (N,) statures, NaN where not known.
    """

    name: str
    joint_names: tuple[str, ...]
    joints: Array
    present: Mask
    root_pixels: Array
    frames: NDArray[np.int64]
    person_names: tuple[str, ...]
    heights: Array

    @property
    def roots(self) -> Array:
        """(N, T, 3) midway between the hips, NaN where one is not known."""
        return middle_of_hips(self.joints, self.joint_names)

    def at(self, frames: NDArray[np.int64]) -> "RealTruth":
        """The truth of these frames of the video; nobody is present in those it does not have.

        Raises:
            TruthError: it has none of them.
        """
        rows = np.searchsorted(self.frames, frames).clip(max=max(len(self.frames) - 1, 0))
        known = self.frames[rows] == frames if len(self.frames) else np.zeros(len(frames), bool)
        if not known.any():
            raise TruthError(f"{self.name}: the truth has none of the take's frames: is the take of the same clip?")
        return replace(
            self,
            joints=self.joints[:, rows],
            present=self.present[:, rows] & known,
            root_pixels=self.root_pixels[:, rows],
            frames=frames,
        )

    def require_all(self, frames: NDArray[np.int64]) -> None:
        """Make sure that truth reaches as far as the take.

        Raises:
            TruthError: the take has frames after the truth's last one.
        """
        if len(self.frames) and frames[-1] > self.frames[-1]:
            raise TruthError(
                f"{self.name}: the take goes on to frame {frames[-1]} of its video, the truth ends with frame "
                f"{self.frames[-1]}: give the take of the same clip"
            )


def require_same_picture(name: str, size: tuple[int, int], camera: CameraModel) -> None:
    """Make sure that a take's pixels are those of the truth.

    Raises:
        TruthError: the take's pictures have another size.
    """
    if size != (camera.width, camera.height):
        raise TruthError(
            f"{name}: its pictures have {size[0]}x{size[1]} pixels, those of the take {camera.width}x{camera.height}: "
            "solve the original footage"
        )


def middle_of_hips(joints: Array, names: tuple[str, ...]) -> Array:
    """(..., 3) from (..., J, 3). Body models put the pelvis elsewhere than people who mark hips do."""
    left, right = (joints[..., names.index(hip), :] for hip in HIPS)
    return (left + right) / 2


def truth_in_view(
    name: str, camera: Camera, joint_names: tuple[str, ...], joints: Array, frames: NDArray[np.int64],
    person_names: tuple[str, ...], heights: Array,
) -> RealTruth:  # fmt: skip
    """Truth from joints (N, T, J, 3) in the camera's frame: who is in its picture follows from its intrinsics.

    A person is in the picture where the root is known and half the known joints, at least, lie inside its borders.
    """
    roots = middle_of_hips(joints, joint_names)
    present = _inside(joints, camera) & np.isfinite(roots).all(axis=-1)
    in_front = np.where(roots[..., 2:] > 0, roots, np.nan)
    return RealTruth(name, joint_names, joints, present, camera.project(in_front), frames, person_names, heights)


def _inside(joints: Array, camera: Camera) -> Mask:
    """(N, T). Without distortion: its polynomial folds points from far outside back into the picture."""
    in_front = np.where(joints[..., 2:] > 0, joints, np.nan)
    pixels = camera.project(in_front, distorted=False)
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0) & (pixels <= (camera.width, camera.height))).all(axis=-1)
    known = np.isfinite(joints).all(axis=-1)
    return inside.sum(axis=-1) >= _SEEN_SHARE * np.maximum(known.sum(axis=-1), 1)
