"""Captured motion for our bodies: joint places from BVH files, whatever the skeleton's own axes and bones."""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import keypoint_index
from core_solver.evaluation.synthetic.bvh import BvhMotion, MotionFileError, read_bvh

Array = NDArray[np.float64]

_PARTS = ("hip", "knee", "ankle", "toe", "shoulder", "elbow", "wrist")
# The left side's joints of the usual skeletons, in the order of _PARTS; lower case, without prefixes and underscores.
_SKELETONS = (
    ("leftupleg", "leftleg", "leftfoot", "lefttoebase", "leftarm", "leftforearm", "lefthand"),
    ("lefthip", "leftknee", "leftankle", "lefttoe", "leftshoulder", "leftelbow", "leftwrist"),
    ("lfemur", "ltibia", "lfoot", "ltoes", "lhumerus", "lradius", "lwrist"),
    ("lthigh", "lcalf", "lfoot", "ltoebase", "lupperarm", "lforearm", "lhand"),
    ("lhip", "lknee", "lfoot", "toe1-1.l", "lshoulder", "lelbow", "lhand"),
)
_PREFIX = re.compile(r"^(mixamorig\d*:|cc_base_)")


@dataclass(frozen=True)
class Recording:
    """Captured motion, z up, lengths in legs (hip to ankle).

    Attributes:
        name: of the file.
        seconds: between frames.
        keypoints: (T, 25, 3); those that a skeleton lacks lie at the mid-hips.
    """

    name: str
    seconds: float
    keypoints: Array

    @property
    def length(self) -> float:
        """Seconds from the first frame to the last."""
        return self.seconds * (len(self.keypoints) - 1)

    def at(self, times: Array) -> Array:
        """(T, 25, 3) at seconds after its begin; it rests in its first and last frame before and after."""
        place = np.clip(times / self.seconds, 0, len(self.keypoints) - 1)
        low = np.minimum(place.astype(int), max(len(self.keypoints) - 2, 0))
        share = (place - low)[:, None, None]
        return (1 - share) * self.keypoints[low] + share * self.keypoints[np.minimum(low + 1, len(self.keypoints) - 1)]


def read_recordings(folder: Path) -> tuple[Recording, ...]:
    """All BVH files of a folder, in the order of their names.

    Raises:
        MotionFileError: no BVH file there, or one that cannot be used.
    """
    files = sorted(folder.glob("*.bvh"))
    if not files:
        raise MotionFileError(f"no .bvh files in {folder}: name a folder that holds some")
    return tuple(record(read_bvh(file), file.name) for file in files)


def record(motion: BvhMotion, name: str) -> Recording:
    """The places of a motion's joints.

    Raises:
        MotionFileError: its joints' names belong to no skeleton known here.
    """
    rows = _rows(motion.names, name)
    # A first frame is often a T-pose for programs that want one.
    places = motion.positions[1 if len(motion.positions) > 2 else 0 :]
    keypoints = np.repeat(places[:, [rows["left_hip"], rows["right_hip"]]].mean(axis=1)[:, None], 25, axis=1)
    for part, row in rows.items():
        keypoints[:, keypoint_index(part)] = places[:, row]
    bones = [("left_hip", "left_knee"), ("left_knee", "left_ankle")]
    leg = sum(float(np.linalg.norm(places[0, rows[a]] - places[0, rows[b]])) for a, b in bones)
    if not leg > 0:
        raise MotionFileError(f"{name} has legs of no length: use another file")
    return Recording(name, motion.frame_seconds, keypoints @ _upright(keypoints).T / leg)


def _rows(names: tuple[str, ...], file: str) -> dict[str, int]:
    """Where each of our keypoints stands among the file's joints."""
    plain = [_PREFIX.sub("", name.lower()).replace("_", "") for name in names]
    for skeleton in _SKELETONS:
        right = [_other_side(name) for name in skeleton]
        if set(skeleton) | set(right) <= set(plain):
            sides = (("left", skeleton), ("right", right))
            return {
                f"{side}_{part}": plain.index(name)
                for side, own in sides
                for part, name in zip(_PARTS, own, strict=True)
            }
    raise MotionFileError(
        f"{file} names its joints in a way not known here: use CMU, Mixamo or Character Creator names"
    )


def _other_side(name: str) -> str:
    if name.startswith("left"):
        return "right" + name.removeprefix("left")
    return name.removesuffix(".l") + ".r" if name.endswith(".l") else "r" + name.removeprefix("l")


def _upright(keypoints: Array) -> Array:
    """(3, 3) rotation from the file's axes to z up: people's feet are below their shoulders most of the time."""
    shoulders, ankles = (
        keypoints[:, [keypoint_index(f"{side}_{part}") for side in ("left", "right")]].mean(axis=(0, 1))
        for part in ("shoulder", "ankle")
    )
    axis = int(np.argmax(np.abs(shoulders - ankles)))
    # The cyclic exchange of axes that brings this one to the third place is a rotation; so is a half turn about x.
    rotation = np.roll(np.eye(3), axis - 2, axis=1)
    return rotation if (shoulders - ankles)[axis] > 0 else np.diag([1.0, -1.0, -1.0]) @ rotation
