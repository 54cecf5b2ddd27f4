"""Rotations, rigid transforms and the project's frames. numpy only; torch twins live in `geometry.torch_ops`.

Frames (binding for the whole project):
    camera  OpenCV: x right, y down, z forward, metres. Everything in a take lives here.
    world   Blender: right-handed, z up along minus gravity, origin on the ground, metres.
"""

from core_solver.geometry.frames import GroundFrame, world_from_camera
from core_solver.geometry.rigid import Similarity, fit_similarity
from core_solver.geometry.rotations import (
    align_vectors,
    matrix_from_rotvec,
    quaternion_from_matrix,
    quaternion_from_rotvec,
    rotvec_from_matrix,
)

__all__ = [
    "GroundFrame",
    "Similarity",
    "align_vectors",
    "fit_similarity",
    "matrix_from_rotvec",
    "quaternion_from_matrix",
    "quaternion_from_rotvec",
    "rotvec_from_matrix",
    "world_from_camera",
]
