"""What the poses of a clip say about statures, ground and depth range."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import JOINT_NAMES, joint_index
from core_solver.camera import Camera
from core_solver.energy.weights import Weights
from core_solver.optimise.evidence import Evidence
from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import TorchBody, sole_rows
from core_solver.optimise.scale_ground import ScaleGround, ScaleProblem, fit_scale_ground, mean_up
from core_solver.optimise.variables import pose_points, start_variables
from core_solver.scene.edges import find_cues
from core_solver.scene.sampling import sample_bodies, sample_floor
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

# Share of the body's mass near each joint, after the usual segment tables.
_MASS = {
    "pelvis": 0.12, "left_hip": 0.05, "right_hip": 0.05, "spine1": 0.10, "spine2": 0.10, "spine3": 0.18, "head": 0.08,
    "left_knee": 0.07, "right_knee": 0.07, "left_ankle": 0.03, "right_ankle": 0.03, "left_shoulder": 0.02,
    "right_shoulder": 0.02, "left_elbow": 0.02, "right_elbow": 0.02, "left_wrist": 0.02, "right_wrist": 0.02,
}  # fmt: skip


@dataclass(frozen=True)
class Clip:
    """What is given and stays as it is.

    Attributes:
        modalities: tracks, masks and disparity.
        camera: intrinsics.
        body: body model.
        solver_body: the same on the solver's device.
        evidence: tracks in solver units.
        still: (N, T, 2) probability that a foot rests in the picture.
    """

    modalities: Modalities
    camera: Camera
    body: BodyModel
    solver_body: TorchBody
    evidence: Evidence
    still: Array


def estimate_sizes(clip: Clip, fit: PoseFit, weights: Weights) -> ScaleGround:
    """Statures, ground and depth range of bodies posed at unit scale."""
    people = len(fit.betas)
    unit = ScaleGround(np.ones(people), np.array([0.0, -1.0, 0.0]), 1.6, np.zeros(people), 0.05, 0.5)
    with torch.no_grad():
        points = pose_points(start_variables(fit, unit, clip.solver_body), clip.solver_body)
    proxy = points.proxy.cpu().double().numpy()
    soles = proxy[:, :, sole_rows(clip.body)].mean(axis=3)
    planted = clip.still * clip.evidence.valid[..., None]
    depth = sample_bodies(proxy, clip.evidence.valid, clip.modalities, clip.camera)
    visible = np.maximum(depth.visible.sum(axis=-1), 1)
    log_depth = (depth.visible * np.log(np.maximum(proxy[..., 2], 0.05))).sum(axis=-1) / visible
    feet = clip.camera.project(np.maximum(soles, (-np.inf, -np.inf, 0.05)))
    balance = _balance(points.joints.cpu().double().numpy(), soles, planted)
    edges = clip.modalities.edges
    return fit_scale_ground(
        ScaleProblem(
            soles=soles,
            planted=planted,
            balance=balance,
            heights=np.array([clip.body.height(b) for b in fit.betas]),
            log_depth=log_depth,
            body_depth=depth,
            floor=sample_floor(feet, planted, clip.evidence.size, clip.modalities, clip.camera),
            cues=None if edges is None else find_cues(edges, clip.camera, mean_up(balance)),
        ),
        weights,
    )


def _balance(joints: Array, soles: Array, planted: Array) -> Array:
    """Time-averaged direction from support to centre of mass: over a while nobody leans against nothing."""
    mass = np.array([_MASS.get(name, 0.0) for name in JOINT_NAMES])
    centre = np.einsum("ntjc,j->ntc", joints, mass / mass.sum())
    directions = np.zeros((len(joints), 3))
    for n in range(len(joints)):
        lean = np.median(joints[n, :, joint_index("neck")] - soles[n].mean(axis=1), axis=0)
        up = lean / max(float(np.linalg.norm(lean)), 1e-9)
        # Of two still feet the lower one carries: a raised leg can be as still as a standing one.
        lower = soles[n] @ up
        carries = planted[n] * (lower < lower.min(axis=-1, keepdims=True) + 0.05)
        total = carries.sum(axis=0)
        if total.sum() < 1:
            continue
        # Over one foot a walker leans inwards: feet that both carry count alike, however often each was seen to.
        share = np.where(total > 0.15 * total.sum(), 1 / np.maximum(total, 1e-9), 0.0)
        mean = np.einsum("tf,tfc,f->c", carries, centre[n][:, None] - soles[n], share)
        directions[n] = mean / max(float(np.linalg.norm(mean)), 1e-9)
    return directions
