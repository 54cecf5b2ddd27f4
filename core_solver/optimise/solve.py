"""Modalities in, solution out: pose fit, scale and ground, stage I, stage II."""

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import JOINT_NAMES, joint_index, keypoint_index
from core_solver.camera import Camera
from core_solver.energy.weights import Weights
from core_solver.geometry import GroundFrame
from core_solver.optimise import pose_fit
from core_solver.optimise.evidence import Evidence, gather_evidence
from core_solver.optimise.joint_energy import JointEnergy, given_evidence
from core_solver.optimise.looking import Onlooker, foot_heights, lowest_soles
from core_solver.optimise.one_euro import one_euro_zero_phase
from core_solver.optimise.paper import PaperPreset, solve_paper
from core_solver.optimise.pose_fit import PoseFit, fit_poses
from core_solver.optimise.posing import TorchBody, pose, sole_rows, torch_body
from core_solver.optimise.presets import AnyPreset
from core_solver.optimise.scale_ground import ScaleGround, ScaleProblem, fit_scale_ground
from core_solver.optimise.second_order import minimise
from core_solver.optimise.solution import Solution
from core_solver.optimise.threads import single_thread
from core_solver.optimise.variables import Variables, pose_points, start_variables
from core_solver.progress import Progress
from core_solver.scene.aggregate import median_depth
from core_solver.scene.contacts import contact_probability, still_feet
from core_solver.scene.sampling import sample_bodies, sample_floor
from core_solver.scene.support import Support, build_support
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

# Share of the body's mass near each joint, after the usual segment tables.
_MASS = {
    "pelvis": 0.12, "left_hip": 0.05, "right_hip": 0.05, "spine1": 0.10, "spine2": 0.10, "spine3": 0.18, "head": 0.08,
    "left_knee": 0.07, "right_knee": 0.07, "left_ankle": 0.03, "right_ankle": 0.03, "left_shoulder": 0.02,
    "right_shoulder": 0.02, "left_elbow": 0.02, "right_elbow": 0.02, "left_wrist": 0.02, "right_wrist": 0.02,
}  # fmt: skip

_DRAFT_FRAMES = 48  # of the depth map that carries feet

# The keypoints that speak for a joint; joints of the trunk take the shoulders and hips.
_WITNESSES = {
    "head": ("nose", "left_ear", "right_ear"), "left_foot": ("left_toe", "left_heel"),
    "right_foot": ("right_toe", "right_heel"), "left_hand": ("left_index", "left_pinky"),
    "right_hand": ("right_index", "right_pinky"),
}  # fmt: skip
_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")


@single_thread()
def solve(
    modalities: Modalities, camera: Camera, body: BodyModel, progress: Progress, preset: AnyPreset, device: str = "cpu"
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
    if isinstance(preset, PaperPreset):
        return solve_paper(modalities, camera, body, progress, preset, device)
    evidence = gather_evidence(modalities, camera)
    solver_body = torch_body(body, torch.device(device))
    with progress.stage("Fit poses", pose_fit.ITERATIONS) as advance:
        smooth = preset.weights.temporal > 0
        fit = fit_poses(evidence, body, solver_body, camera, advance, smooth=smooth)
    still = still_feet(evidence.pixels, evidence.confidence, evidence.size, evidence.times)
    ground = _first_scales(fit, evidence, still, modalities, camera, body, solver_body, preset.weights)
    given = given_evidence(evidence, fit, ground, camera, body, solver_body, preset.weights)
    energy = JointEnergy(given, solver_body, preset.weights)
    onlooker = Onlooker(modalities, camera, evidence, still, ground.levels)
    variables = start_variables(fit, ground, solver_body)

    def look(v: Variables) -> None:
        onlooker.look(energy, v, preset.look)

    def look_last(v: Variables) -> None:
        onlooker.look(energy, v, preset.last_look)

    energy.look(filtered=_filtered_keypoints(energy, variables, evidence.times))
    with progress.stage("Solve scale and depth", preset.stage_one.iterations) as advance:
        variables = minimise(energy, variables, preset.stage_one, look, advance)
    energy.look(filtered=_filtered_keypoints(energy, variables, evidence.times))
    onlooker.stand_on(_support(modalities, camera, energy, variables, still * evidence.valid[..., None]))
    with progress.stage("Solve space and time", preset.stage_two.iterations) as advance:
        variables = minimise(energy, variables, preset.stage_two, look, advance)
    with progress.stage("Solve to the last pixel", preset.last_iterations.iterations) as advance:
        variables = minimise(energy, variables, preset.last_iterations, look_last, advance)
    return _solution(variables, energy, evidence, still, ground, onlooker)


def _support(modalities: Modalities, camera: Camera, energy: JointEnergy, v: Variables, rests: Array) -> Support | None:
    """The scene's surface, as far as the feet that rest agree with it; None without a depth map."""
    if modalities.disparity is None:
        return None
    far, gap = (torch.exp(x).cpu().double().numpy() for x in (v.log_inverse_far, v.log_inverse_gap))
    depth = median_depth(modalities, far, gap, _DRAFT_FRAMES)
    up = energy.up(v).cpu().double().numpy()
    ground = GroundFrame(-up, up, float(energy.given.offset * torch.exp(v.ground[2])))
    return build_support(depth, camera, ground).calibrated(lowest_soles(energy, v), rests)


def _filtered_keypoints(energy: JointEnergy, v: Variables, times: Array) -> Tensor:
    """(N, T, 25, 3) at unit scale: what velocities follow in stage II."""
    with torch.no_grad():
        points = pose(v.theta, v.betas, energy.body).skin(energy.body.keypoints, v.betas) + v.translation[:, :, None]
    filtered = np.stack([one_euro_zero_phase(p, times) for p in points.cpu().double().numpy()])
    return torch.as_tensor(filtered, dtype=points.dtype, device=points.device)


def _first_scales(
    fit: PoseFit, evidence: Evidence, still: Array, modalities: Modalities, camera: Camera, body: BodyModel,
    solver_body: TorchBody, weights: Weights,
) -> ScaleGround:  # fmt: skip
    unit = ScaleGround(np.ones(len(fit.betas)), np.array([0.0, -1.0, 0.0]), 1.6, np.zeros(len(fit.betas)), 0.05, 0.5)
    with torch.no_grad():
        points = pose_points(start_variables(fit, unit, solver_body), solver_body)
    proxy = points.proxy.cpu().double().numpy()
    joints = points.joints.cpu().double().numpy()
    soles = proxy[:, :, sole_rows(body)].mean(axis=3)
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


def _solution(
    variables: Variables,
    energy: JointEnergy,
    evidence: Evidence,
    still: Array,
    ground: ScaleGround,
    onlooker: Onlooker,
) -> Solution:
    heights, distance = foot_heights(energy, variables)
    heights = heights - onlooker.support(energy, variables)
    contacts = contact_probability(heights, still, distance)
    settled = heights[(contacts > 0.5) & evidence.valid[..., None]]
    # The plane takes its final height from the soles that stand on it.
    offset = ground.offset * math.exp(float(variables.ground[2])) - (float(np.median(settled)) if len(settled) else 0.0)
    up = energy.up(variables).cpu().double().numpy()
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
        ground=GroundFrame(-up, up, offset),
    )


def _joint_confidence(keypoint_confidence: Array) -> Array:
    columns = []
    for name in JOINT_NAMES:
        witnesses = _WITNESSES.get(name)
        if witnesses is None:
            witnesses = (name,) if name.startswith(("left_", "right_")) and "collar" not in name else _TRUNK
        columns.append(keypoint_confidence[..., [keypoint_index(w) for w in witnesses]].mean(axis=-1))
    return np.stack(columns, axis=-1)
