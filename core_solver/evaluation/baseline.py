"""The solver to beat: each person placed alone by 2D fitting at unit scale, frame by frame."""

import numpy as np
from numpy.typing import NDArray

from core_solver.body import BodyModel, pose_joints, skin
from core_solver.camera import Camera
from core_solver.geometry import GroundFrame
from core_solver.optimise.evidence import Evidence, gather_evidence
from core_solver.optimise.limb_pose import limb_pose
from core_solver.optimise.placement import place
from core_solver.optimise.solution import Solution
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

NAME = "baseline"

_NOBODY = (0.0, 0.0, 5.0)  # where someone stands who can be placed in no frame: in front of the camera
_EYE_HEIGHT_M = 1.6
# It knows no depth map: a range that holds any scene keeps the solution complete.
_NEAR_M, _FAR_M = 1.0, 100.0


def baseline(modalities: Modalities, camera: Camera, body: BodyModel) -> Solution:
    """Average adults, posed by their landmarks and put onto their keypoints' rays in each frame alone.

    Nothing is smoothed; frames without evidence are interpolated. Contacts are never claimed, and gravity is the
    camera's y axis.
    """
    evidence = gather_evidence(modalities, camera)
    people, frames = evidence.valid.shape
    theta, keypoints = _poses(evidence, body)
    ground = GroundFrame(np.array([0.0, 1.0, 0.0]), np.array([0.0, -1.0, 0.0]), _EYE_HEIGHT_M)
    return Solution(
        theta=theta,
        gamma=_places(keypoints, evidence, camera),
        betas=np.tile(body.neutral_betas, (people, 1)),
        scales=np.ones(people),
        confidence=np.repeat(evidence.confidence.mean(axis=-1, keepdims=True), 24, axis=-1),
        contacts=np.zeros((people, frames, 2)),
        inverse_far=np.full(frames, 1 / _FAR_M),
        inverse_gap=np.full(frames, 1 / _NEAR_M - 1 / _FAR_M),
        ground=ground,
    )


def _poses(evidence: Evidence, body: BodyModel) -> tuple[Array, Array]:
    """Poses (N, T, 24, 3) and their keypoints (N, T, 25, 3) at unit scale, before translation."""
    rest_joints, rest_keypoints = body.rest_joints(body.neutral_betas), body.rest_keypoints(body.neutral_betas)
    theta = np.stack([limb_pose(marks, rest_keypoints, rest_joints) for marks in evidence.landmarks])
    rotations, positions = pose_joints(theta, rest_joints)
    return theta, skin(rest_keypoints, body.keypoint_weights, rotations, positions, rest_joints)


def _places(keypoints: Array, evidence: Evidence, camera: Camera) -> Array:
    """Translations (N, T, 3), linear in time where a frame alone gives none: one without evidence has no weights."""
    rays = (evidence.pixels - (camera.cx, camera.cy)) / (camera.fx, camera.fy)
    gamma, placed = place(keypoints, rays, evidence.confidence)
    for person, known in enumerate(placed):
        if not known.any():
            gamma[person] = _NOBODY
            continue
        for axis in range(3):
            gamma[person, :, axis] = np.interp(evidence.times, evidence.times[known], gamma[person, known, axis])
    return gamma
