"""Modalities in, solution out: pose fit, scale and ground, stage I, stage II."""

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import JOINT_NAMES, joint_index, keypoint_index
from core_solver.camera import Camera
from core_solver.energy.weights import Weights
from core_solver.geometry import GroundFrame
from core_solver.optimise import pose_fit, stages
from core_solver.optimise.evidence import Evidence, gather_evidence
from core_solver.optimise.one_euro import one_euro_zero_phase
from core_solver.optimise.pose_fit import PoseFit, fit_poses
from core_solver.optimise.posing import TorchBody, torch_body
from core_solver.optimise.presets import Preset
from core_solver.optimise.scale_ground import ScaleGround, ScaleProblem, fit_scale_ground
from core_solver.optimise.stages import JointEnergy, Points, Variables, pose_points, run_stage, start_variables
from core_solver.progress import Progress
from core_solver.scene.contacts import contact_probability, still_feet
from core_solver.scene.sampling import sample_bodies, sample_floor
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

# Share of the body's mass near each joint, after the usual segment tables.
_MASS = {
    "pelvis": 0.12, "left_hip": 0.05, "right_hip": 0.05, "spine1": 0.10, "spine2": 0.10, "spine3": 0.18, "head": 0.08,
    "left_knee": 0.07, "right_knee": 0.07, "left_ankle": 0.03, "right_ankle": 0.03, "left_shoulder": 0.02,
    "right_shoulder": 0.02, "left_elbow": 0.02, "right_elbow": 0.02, "left_wrist": 0.02, "right_wrist": 0.02,
}  # fmt: skip

# The keypoints that speak for a joint; joints of the trunk take the shoulders and hips.
_WITNESSES = {
    "head": ("nose", "left_ear", "right_ear"), "left_foot": ("left_toe", "left_heel"),
    "right_foot": ("right_toe", "right_heel"), "left_hand": ("left_index", "left_pinky"),
    "right_hand": ("right_index", "right_pinky"),
}  # fmt: skip
_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@dataclass(frozen=True)
class Solution:
    """All people and the depth range, camera frame, metres.

    Attributes:
        theta: (N, T, 24, 3) radians.
        gamma: (N, T, 3) translation, scale included.
        betas: (N, 10).
        scales: (N,).
        confidence: (N, T, 24).
        contacts: (N, T, 2).
        inverse_far: (T,) 1 / z_far.
        inverse_gap: (T,) 1 / z_near - 1 / z_far.
        ground: gravity and ground.
    """

    theta: Array
    gamma: Array
    betas: Array
    scales: Array
    confidence: Array
    contacts: Array
    inverse_far: Array
    inverse_gap: Array
    ground: GroundFrame


def solve(
    modalities: Modalities, camera: Camera, body: BodyModel, progress: Progress, preset: Preset, device: str = "cpu"
) -> Solution:
    """Solve all people and the scene of a clip.

    Args:
        modalities: at least one track.
        camera: intrinsics of the footage.
        body: body model.
        progress: shows the stages.
        preset: what is minimised and how.
        device: "cpu" or "cuda".
    """
    weights = preset.weights
    evidence = gather_evidence(modalities, camera)
    solver_body = torch_body(body, torch.as_tensor(sole_rows(body)), torch.device(device))
    with progress.stage("Fit poses", pose_fit.ITERATIONS) as advance:
        fit = fit_poses(evidence, body, solver_body, camera, advance)
    still = still_feet(evidence.pixels, evidence.confidence, evidence.size, evidence.times)
    ground = _first_scales(fit, evidence, still, modalities, camera, body, solver_body, weights)
    variables = start_variables(fit, ground, solver_body)
    heights = np.array([body.height(b) for b in fit.betas])
    energy = JointEnergy(evidence, fit, ground, camera, solver_body, heights, weights)
    _refresh(energy, variables, evidence, still, modalities, camera, solver_body)
    with progress.stage("Solve scale and depth", stages.STAGE_ONE_ITERATIONS) as advance:
        run_stage(variables, energy.stage_one, stages.STAGE_ONE_ITERATIONS, advance)
    points = _refresh(energy, variables, evidence, still, modalities, camera, solver_body)
    proxy = points.proxy.cpu().double().numpy()
    energy.set_filtered(np.stack([one_euro_zero_phase(p, evidence.times) for p in proxy]))
    with progress.stage("Solve space and time", stages.STAGE_TWO_ITERATIONS) as advance:
        run_stage(variables, energy.stage_two, stages.STAGE_TWO_ITERATIONS, advance)
    return _solution(variables, energy, evidence, still, ground, solver_body)


def sole_rows(body: BodyModel, most: int = 16) -> NDArray[np.int64]:
    """Rows of `body.proxy` under the left and the right foot, (2, S), the same number on both sides."""
    rest = body.rest_vertices(body.neutral_betas)[body.proxy]
    weights = body.weights[body.proxy]
    low = rest[:, 1] < rest[:, 1].min() + 0.03
    sides = []
    for side in ("left", "right"):
        feet = weights[:, [joint_index(f"{side}_ankle"), joint_index(f"{side}_foot")]].sum(axis=1) > 0.5
        sides.append(np.flatnonzero(low & feet))
    count = min(most, *(len(rows) for rows in sides))
    if count == 0:
        raise ValueError("the body's proxy has no vertices under the feet")
    spread = [rows[np.linspace(0, len(rows) - 1, count).astype(int)] for rows in sides]
    return np.stack(spread)


def _first_scales(
    fit: PoseFit, evidence: Evidence, still: Array, modalities: Modalities, camera: Camera, body: BodyModel,
    solver_body: TorchBody, weights: Weights,
) -> ScaleGround:  # fmt: skip
    unit = ScaleGround(np.ones(len(fit.betas)), np.array([0.0, -1.0, 0.0]), 1.6, np.zeros(len(fit.betas)), 0.05, 0.5)
    with torch.no_grad():
        points = pose_points(start_variables(fit, unit, solver_body), solver_body)
    proxy = points.proxy.cpu().double().numpy()
    joints = points.joints.cpu().double().numpy()
    soles = proxy[:, :, solver_body.soles.cpu().numpy()].mean(axis=3)
    planted = still * evidence.valid[..., None]
    depth = sample_bodies(proxy, evidence.valid, modalities, camera)
    visible = np.maximum(depth.visible.sum(axis=-1), 1)
    log_depth = (depth.visible * np.log(np.maximum(proxy[..., 2], 0.05))).sum(axis=-1) / visible
    feet = camera.project(np.maximum(soles, (-np.inf, -np.inf, 0.05)))
    return fit_scale_ground(
        ScaleProblem(
            soles=soles,
            planted=planted,
            balance=_balance(joints, soles, planted),
            heights=np.array([body.height(b) for b in fit.betas]),
            log_depth=log_depth,
            body_depth=depth,
            floor=sample_floor(feet, planted, evidence.size, modalities, camera),
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


def _refresh(
    energy: JointEnergy, variables: Variables, evidence: Evidence, still: Array, modalities: Modalities, camera: Camera,
    body: TorchBody,
) -> Points:  # fmt: skip
    """Look again at what depends on where people stand: visible vertices and contacts."""
    with torch.no_grad():
        points = pose_points(variables, body)
        heights = energy.sole_heights(points.proxy).cpu().double().numpy()
    proxy = points.proxy.cpu().double().numpy()
    if modalities.disparity is not None:
        energy.set_depth(sample_bodies(proxy, evidence.valid, modalities, camera))
    contacts = contact_probability(heights, still, points.joints[:, :, 0, 2].cpu().double().numpy())
    energy.set_contacts(contacts * evidence.valid[..., None])
    return points


def _solution(
    variables: Variables, energy: JointEnergy, evidence: Evidence, still: Array, ground: ScaleGround, body: TorchBody
) -> Solution:
    with torch.no_grad():
        points = pose_points(variables, body)
        heights = energy.sole_heights(points.proxy).cpu().double().numpy()
    contacts = contact_probability(heights, still, points.joints[:, :, 0, 2].cpu().double().numpy())
    settled = heights[(contacts > 0.5) & evidence.valid[..., None]]
    # The plane takes its final height from the soles that stand on it.
    offset = ground.offset - (float(np.median(settled)) if len(settled) else 0.0)
    scales = torch.exp(variables.log_scale).cpu().double().numpy()
    return Solution(
        theta=variables.theta.cpu().double().numpy(),
        gamma=scales[:, None, None] * variables.translation.cpu().double().numpy(),
        betas=variables.betas.cpu().double().numpy(),
        scales=scales,
        confidence=_joint_confidence(evidence.confidence),
        contacts=contacts,
        inverse_far=np.exp(variables.log_inverse_far.cpu().double().numpy()),
        inverse_gap=np.exp(variables.log_inverse_gap.cpu().double().numpy()),
        ground=GroundFrame(-ground.up, ground.up, offset),
    )


def _joint_confidence(keypoint_confidence: Array) -> Array:
    columns = []
    for name in JOINT_NAMES:
        witnesses = _WITNESSES.get(name)
        if witnesses is None:
            witnesses = (name,) if name.startswith(("left_", "right_")) and "collar" not in name else _TRUNK
        columns.append(keypoint_confidence[..., [keypoint_index(w) for w in witnesses]].mean(axis=-1))
    return np.stack(columns, axis=-1)
