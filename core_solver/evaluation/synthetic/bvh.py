"""Reading BVH motion files."""

import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError
from core_solver.geometry import matrix_from_rotvec

Array = NDArray[np.float64]

_AXES = {"X": 0, "Y": 1, "Z": 2}
_CHANNEL = re.compile(r"[XYZ](position|rotation)", re.IGNORECASE)


class MotionFileError(UserError):
    """A BVH file that cannot be read or used."""


@dataclass(frozen=True)
class BvhMotion:
    """A skeleton of J joints and its motion over T frames, in the file's own units and axes.

    Attributes:
        names: of the joints, parents before children; a branch's end is not a joint.
        parents: (J,) -1 for the root.
        positions: (T, J, 3).
        rotations: (T, J, 3, 3) from the joint's axes in the file to the world.
        frame_seconds: between frames.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    positions: Array
    rotations: Array
    frame_seconds: float


@dataclass(frozen=True)
class _Joint:
    name: str
    parent: int
    offset: Array
    channels: tuple[str, ...]


def read_bvh(path: Path) -> BvhMotion:
    """Read a BVH file.

    Raises:
        MotionFileError: missing, cut off, or not BVH.
    """
    try:
        words = path.read_text(encoding="utf-8-sig", errors="replace").split()
        joints, rest = _read_hierarchy(words)
        values, seconds = _read_motion(rest, sum(len(joint.channels) for joint in joints))
    except (OSError, ValueError, IndexError) as error:
        raise MotionFileError(f"{path} is not a BVH file this program reads: {error}") from error
    return _forward(joints, values, seconds)


def _read_hierarchy(words: list[str]) -> tuple[list[_Joint], list[str]]:
    if words[0].upper() != "HIERARCHY":
        raise ValueError("it does not begin with HIERARCHY")
    joints: list[_Joint] = []
    open_joints: list[int] = []  # -1 stands for a branch's end
    place, parent = 1, -1
    while words[place].upper() != "MOTION":
        word = words[place].upper()
        if word in {"ROOT", "JOINT"}:
            parent = next((joint for joint in reversed(open_joints) if joint >= 0), -1)
            joints.append(_Joint(words[place + 1], parent, np.zeros(3), ()))
            place += 2
        elif word == "END":
            place += 2
            if words[place] != "{" or words[place + 5] != "}":
                raise ValueError("an End Site holds more than an offset")
            place += 6
        elif word == "{":
            open_joints.append(len(joints) - 1)
            place += 1
        elif word == "}":
            open_joints.pop()
            place += 1
        else:
            joints[-1], place = _read_property(joints[-1], words, place)
    return joints, words[place + 1 :]


def _read_property(joint: _Joint, words: list[str], place: int) -> tuple[_Joint, int]:
    """The joint with its OFFSET or CHANNELS, and the place of the next word."""
    word = words[place].upper()
    if word == "OFFSET":
        return replace(joint, offset=np.array(words[place + 1 : place + 4], float)), place + 4
    if word != "CHANNELS":
        raise ValueError(f"{words[place]} is not expected in the hierarchy")
    end = place + 2 + int(words[place + 1])
    channels = tuple(words[place + 2 : end])
    if not all(_CHANNEL.fullmatch(channel) for channel in channels):
        raise ValueError(f"its channels are {' '.join(channels)}")
    return replace(joint, channels=channels), end


def _read_motion(words: list[str], channels: int) -> tuple[Array, float]:
    """(T, channels) values and the seconds between frames, from "Frames: T Frame Time: S" and the numbers."""
    if words[0].lower() != "frames:" or words[2].lower() != "frame" or words[3].lower() != "time:":
        raise ValueError("the motion does not begin with Frames and Frame Time")
    frames, seconds = int(words[1]), float(words[4])
    values = np.array(words[5 : 5 + frames * channels], float)
    if frames < 1 or not 0 < seconds < 10 or len(values) != frames * channels or not np.isfinite(values).all():
        raise ValueError("it has too few numbers for its frames")
    return values.reshape(frames, channels), seconds


def _forward(joints: list[_Joint], values: Array, seconds: float) -> BvhMotion:
    count = len(values)
    positions, rotations = np.zeros((count, len(joints), 3)), np.zeros((count, len(joints), 3, 3))
    column = 0
    for number, joint in enumerate(joints):
        local, offset = np.broadcast_to(np.eye(3), (count, 3, 3)), np.tile(joint.offset, (count, 1))
        for channel in joint.channels:
            axis = _AXES[channel[0].upper()]
            if channel.lower().endswith("position"):
                offset[:, axis] = values[:, column]
            else:
                local = local @ matrix_from_rotvec(np.radians(values[:, column, None]) * np.eye(3)[axis])
            column += 1
        if joint.parent < 0:
            positions[:, number], rotations[:, number] = offset, local
        else:
            turn = rotations[:, joint.parent]
            positions[:, number] = positions[:, joint.parent] + (turn @ offset[..., None])[..., 0]
            rotations[:, number] = turn @ local
    names, parents = tuple(joint.name for joint in joints), tuple(joint.parent for joint in joints)
    return BvhMotion(names, parents, positions, rotations, seconds)
