"""Body models: the open default, a user's SMPL file, forward kinematics and skinning.

Torch twins live in `body.kinematics_torch` and are not imported here.
"""

from core_solver.body.kinematics import pose_blend, pose_joints, skin
from core_solver.body.model import BodyModel, load_body, load_open_body, load_smpl
from core_solver.body.skeleton import JOINT_NAMES, KEYPOINT_NAMES, MIRROR, PARENTS

__all__ = [
    "JOINT_NAMES",
    "KEYPOINT_NAMES",
    "MIRROR",
    "PARENTS",
    "BodyModel",
    "load_body",
    "load_open_body",
    "load_smpl",
    "pose_blend",
    "pose_joints",
    "skin",
]
