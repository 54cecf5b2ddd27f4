"""The 24-joint tree of a body and the 25 image keypoints that are compared with detections. Standard library only.

Joint names and parents are the take file's: a take must be readable without body models, so they stand there.
"""

from core_solver.take.skeleton import JOINT_NAMES, PARENTS

__all__ = [
    "JOINT_NAMES",
    "KEYPOINT_MIRROR",
    "KEYPOINT_NAMES",
    "LEVELS",
    "MIRROR",
    "PARENTS",
    "joint_index",
    "keypoint_index",
]

KEYPOINT_NAMES: tuple[str, ...] = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle",
    "right_ankle", "left_heel", "right_heel", "left_toe", "right_toe", "left_index", "right_index", "left_pinky",
    "right_pinky",
)  # fmt: skip
"""COCO's 17 in COCO's order, then heel, tip of the big toe, and the knuckles at the base of two fingers."""


def joint_index(name: str) -> int:
    """Where the joint stands in every (24, ...) array; ValueError for a name that is not one of ours."""
    return JOINT_NAMES.index(name)


def keypoint_index(name: str) -> int:
    """Where the keypoint stands in every (25, ...) array; ValueError for a name that is not one of ours."""
    return KEYPOINT_NAMES.index(name)


def _mirror_name(name: str) -> str:
    if name.startswith("left_"):
        return "right_" + name.removeprefix("left_")
    if name.startswith("right_"):
        return "left_" + name.removeprefix("right_")
    return name


def _levels() -> tuple[tuple[int, ...], ...]:
    depth = [0] * len(PARENTS)
    for joint, parent in enumerate(PARENTS):
        depth[joint] = depth[parent] + 1 if parent >= 0 else 0
    return tuple(tuple(j for j, d in enumerate(depth) if d == level) for level in range(max(depth) + 1))


MIRROR: tuple[int, ...] = tuple(JOINT_NAMES.index(_mirror_name(name)) for name in JOINT_NAMES)
"""For each joint the one on the other side of the body; the spine's joints mirror to themselves."""

KEYPOINT_MIRROR: tuple[int, ...] = tuple(KEYPOINT_NAMES.index(_mirror_name(name)) for name in KEYPOINT_NAMES)
"""The same for keypoints."""

LEVELS: tuple[tuple[int, ...], ...] = _levels()
"""The joints by their distance from the pelvis: a level's parents all stand in the level before."""
