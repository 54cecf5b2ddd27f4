"""The take file: one clip's people, scene and camera in one numpy archive. numpy and the standard library only."""

from core_solver.take.model import FORMAT, VERSION, CameraModel, Ground, Meta, Person, Scene, Take
from core_solver.take.reading import read_take
from core_solver.take.skeleton import JOINT_NAMES, PARENTS
from core_solver.take.writing import write_take

__all__ = [
    "FORMAT",
    "JOINT_NAMES",
    "PARENTS",
    "VERSION",
    "CameraModel",
    "Ground",
    "Meta",
    "Person",
    "Scene",
    "Take",
    "read_take",
    "write_take",
]
