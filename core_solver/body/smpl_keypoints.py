"""Where the 25 image keypoints lie on a body of which only mesh, joints and skinning weights are known.

Everything is found from the rest mesh's geometry (T-pose; y up, z to the front, x to the body's left; metres).
"""

import numpy as np
from numpy.typing import NDArray

from core_solver.body.skeleton import KEYPOINT_NAMES, joint_index

Array = NDArray[np.float64]

_EYE_HEIGHT = 0.035  # metres above the tip of the nose, of a head 0.22 m high
_EYE_SPREAD = 0.032
_HEAD_HEIGHT = 0.22
_NEARBY = 4  # vertices that are averaged around a place on the surface
_JOINT_KEYPOINTS = ("shoulder", "elbow", "wrist", "hip", "knee", "ankle")


def find_keypoints(template: Array, joint_regressor: Array, weights: Array) -> Array:
    """Convex rows (25, V) in the order of KEYPOINT_NAMES.

    Args:
        template: (V, 3) rest vertices.
        joint_regressor: (24, V).
        weights: (V, 24) skinning weights.
    """
    body = _Body(template, joint_regressor, weights)
    rows = {"nose": body.around(body.nose())}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        rows[f"{side}_eye"] = body.around(body.eye(sign))
        rows[f"{side}_ear"] = body.around(body.ear(sign))
        rows[f"{side}_heel"] = body.around(body.heel(side))
        rows[f"{side}_toe"] = body.around(body.toe(side, sign))
        rows.update({f"{side}_{finger}": body.knuckle(side, finger) for finger in ("index", "pinky")})
        rows.update({f"{side}_{joint}": body.joint(f"{side}_{joint}") for joint in _JOINT_KEYPOINTS})
    return np.stack([rows[name] for name in KEYPOINT_NAMES])


class _Body:
    """A rest mesh together with the questions that are asked of it."""

    def __init__(self, template: Array, joint_regressor: Array, weights: Array) -> None:
        self.vertices = template
        self.regressor = joint_regressor
        self.weights = weights
        self.joints = joint_regressor @ template
        self.head = self._part("head")
        top = template[self.head, 1].max()
        self.head_size = (top - self.joints[joint_index("head"), 1]) / _HEAD_HEIGHT

    def around(self, place: Array) -> Array:
        """(V,) the mean of the vertices nearest to a place."""
        distance = np.linalg.norm(self.vertices - place, axis=1)
        row = np.zeros(len(self.vertices))
        row[np.argsort(distance, kind="stable")[:_NEARBY]] = 1 / _NEARBY
        return row

    def joint(self, name: str) -> Array:
        """(V,) the joint's own row, which SMPL's training has made non-negative; rounding below zero is cut off."""
        row = np.maximum(self.regressor[joint_index(name)], 0)
        return row / row.sum()

    def nose(self) -> Array:
        """The most forward of those vertices of the head that are nearest to the middle plane."""
        from_middle = np.argsort(np.abs(self.vertices[self.head, 0]), kind="stable")
        middle = self.head[from_middle[: max(1, len(self.head) // 10)]]
        return self.vertices[middle[np.argmax(self.vertices[middle, 2])]]

    def eye(self, sign: float) -> Array:
        """The most forward vertex around the eye's typical height and side."""
        target = self.nose()[:2] + self.head_size * np.array([sign * _EYE_SPREAD, _EYE_HEIGHT])
        target[0] = sign * _EYE_SPREAD * self.head_size
        front = self.head[self.vertices[self.head, 2] > self.joints[joint_index("head"), 2]]
        distance = np.linalg.norm(self.vertices[front, :2] - target, axis=1)
        return self.vertices[front[np.argmin(distance)]]

    def ear(self, sign: float) -> Array:
        """The vertex of the head that stands out farthest to the side."""
        return self.vertices[self.head[np.argmax(sign * self.vertices[self.head, 0])]]

    def heel(self, side: str) -> Array:
        """The rearmost vertex of the foot's lower half."""
        sole = self._low_foot(side)
        return self.vertices[sole[np.argmin(self.vertices[sole, 2])]]

    def toe(self, side: str, sign: float) -> Array:
        """The most forward vertex of the foot's inner half, where the big toe is."""
        foot = self._part(f"{side}_ankle", f"{side}_foot")
        middle = np.median(sign * self.vertices[foot, 0])
        inner = foot[sign * self.vertices[foot, 0] <= middle]
        return self.vertices[inner[np.argmax(self.vertices[inner, 2])]]

    def knuckle(self, side: str, finger: str) -> Array:
        """The hand's edge beside the hand joint: in front for the index finger, behind for the little one."""
        hand = self._part(f"{side}_wrist", f"{side}_hand")
        knuckles = self.joints[joint_index(f"{side}_hand")]
        slice_ = hand[np.abs(self.vertices[hand, 0] - knuckles[0]) < 0.02]
        if len(slice_) == 0:
            return self.around(knuckles)
        depth = self.vertices[slice_, 2]
        # The knuckle is inside the hand, a finger's half width from its edge.
        share = 0.8 if finger == "index" else 0.2
        return self.around(np.array([knuckles[0], knuckles[1], depth.min() + share * np.ptp(depth)]))

    def _low_foot(self, side: str) -> NDArray[np.int64]:
        foot = self._part(f"{side}_ankle", f"{side}_foot")
        ankle, ground = self.joints[joint_index(f"{side}_ankle"), 1], self.vertices[foot, 1].min()
        return foot[self.vertices[foot, 1] < (ankle + ground) / 2]

    def _part(self, *names: str) -> NDArray[np.int64]:
        share = self.weights[:, [joint_index(name) for name in names]].sum(axis=1)
        return np.flatnonzero(share > 0.5)
