"""Modalities in, solution out: pose fit, scale and ground, stage I, stage II."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from core_solver.body.model import BodyModel
from core_solver.body.skeleton import JOINT_NAMES, keypoint_index
from core_solver.camera import Camera
from core_solver.geometry import GroundFrame
from core_solver.optimise import pose_fit
from core_solver.optimise.evidence import gather_evidence
from core_solver.optimise.joint_energy import JointEnergy, given_evidence
from core_solver.optimise.looking import Look, Onlooker, foot_heights, lowest_soles
from core_solver.optimise.one_euro import one_euro_zero_phase
from core_solver.optimise.paper import PaperPreset, solve_paper
from core_solver.optimise.pose_fit import PoseFit, fit_poses
from core_solver.optimise.posing import pose, torch_body
from core_solver.optimise.presets import AnyPreset, Preset
from core_solver.optimise.scale_ground import ScaleGround
from core_solver.optimise.second_order import Schedule, minimise
from core_solver.optimise.sizes import Clip, estimate_sizes
from core_solver.optimise.solution import Solution
from core_solver.optimise.threads import single_thread
from core_solver.optimise.variables import Variables, start_variables
from core_solver.progress import Progress
from core_solver.scene.aggregate import median_depth
from core_solver.scene.contacts import contact_probability, still_feet
from core_solver.scene.support import build_support
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

_DRAFT_FRAMES = 48  # of the depth map that carries feet
_SAME_STEP_M = 0.05

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
    clip = _read_clip(modalities, camera, body, device)
    with progress.stage("Fit poses", pose_fit.ITERATIONS) as advance:
        smooth = preset.weights.temporal > 0
        fit = fit_poses(clip.evidence, body, clip.solver_body, camera, advance, smooth=smooth)
    with progress.stage("Solve scale and depth", preset.stage_one.iterations) as advance:
        problem = _Problem(clip, fit, estimate_sizes(clip, fit, preset.weights), preset)
        variables = problem.minimise(start_variables(fit, problem.ground, clip.solver_body), preset.stage_one, advance)
    with progress.stage("Solve space and time", preset.stage_two.iterations) as advance:
        problem.stand_on_scene(variables)
        variables = problem.minimise(variables, preset.stage_two, advance)
    with progress.stage("Solve to the last pixel", preset.last_iterations.iterations) as advance:
        variables = problem.minimise(variables, preset.last_iterations, advance, preset.last_look)
    return _solution(problem, variables)


def _read_clip(modalities: Modalities, camera: Camera, body: BodyModel, device: str) -> Clip:
    evidence = gather_evidence(modalities, camera)
    still = still_feet(evidence.pixels, evidence.confidence, evidence.size, evidence.times)
    return Clip(modalities, camera, body, torch_body(body, torch.device(device)), evidence, still)


class _Problem:
    """One energy with what renews it."""

    def __init__(self, clip: Clip, fit: PoseFit, ground: ScaleGround, preset: Preset) -> None:
        self.clip, self.ground = clip, ground
        self._preset = preset
        given = given_evidence(clip.evidence, fit, ground, clip.camera, clip.body, clip.solver_body, preset.weights)
        self.energy = JointEnergy(given, clip.solver_body, preset.weights)
        self.onlooker = Onlooker(clip.modalities, clip.camera, clip.evidence, clip.still, ground.levels)

    def minimise(
        self, v: Variables, schedule: Schedule, advance: Callable[[int], None], look: Look | None = None
    ) -> Variables:
        """Lower the energy; velocities follow the filtered ones of where it starts."""
        self.energy.look(filtered=_filtered_points(self.energy, v, self.clip.evidence.times))
        closely = look or self._preset.look
        return minimise(self.energy, v, schedule, lambda now: self.onlooker.look(self.energy, now, closely), advance)

    def stand_on_scene(self, v: Variables) -> None:
        """Let feet stand on the scene's surface, as far as those that rest agree with it."""
        clip, energy = self.clip, self.energy
        if clip.modalities.disparity is None:
            return
        far, gap = (torch.exp(x).cpu().double().numpy() for x in (v.log_inverse_far, v.log_inverse_gap))
        depth = median_depth(clip.modalities, far, gap, _DRAFT_FRAMES)
        support = build_support(depth, clip.camera, ground_frame(energy, v))
        soles = lowest_soles(energy, v)
        heights = soles @ support.up
        # Of two still feet the lower one stands: a raised leg can be as still.
        carries = heights < heights.min(axis=-1, keepdims=True) + _SAME_STEP_M
        rests = clip.still * clip.evidence.valid[..., None] * carries
        self.onlooker.stand_on(support.calibrated(soles, rests))


def ground_frame(energy: JointEnergy, v: Variables) -> GroundFrame:
    """The common ground as it now stands."""
    up = energy.up(v).cpu().double().numpy()
    return GroundFrame(-up, up, float(energy.given.offset * torch.exp(v.ground[2])))


def _filtered_points(energy: JointEnergy, v: Variables, times: Array) -> Tensor:
    """(N, T, P, 3) at unit scale: what velocities follow in stage II."""
    with torch.no_grad():
        points = pose(v.theta, v.betas, energy.body).skin(energy.body.followed, v.betas) + v.translation[:, :, None]
    filtered = np.stack([one_euro_zero_phase(p, times) for p in points.cpu().double().numpy()])
    return torch.as_tensor(filtered, dtype=points.dtype, device=points.device)


def _solution(problem: _Problem, variables: Variables) -> Solution:
    clip, energy = problem.clip, problem.energy
    heights, distance = foot_heights(energy, variables)
    heights = heights - problem.onlooker.support(energy, variables)
    contacts = contact_probability(heights, clip.still, distance)
    settled = heights[(contacts > 0.5) & clip.evidence.valid[..., None]]
    ground = ground_frame(energy, variables)
    # The plane takes its final height from the soles that stand on it.
    offset = ground.offset - (float(np.median(settled)) if len(settled) else 0.0)
    scales = torch.exp(variables.log_scale).cpu().double().numpy()
    return Solution(
        theta=variables.theta.cpu().double().numpy(),
        gamma=scales[:, None, None] * variables.translation.cpu().double().numpy(),
        betas=variables.betas.cpu().double().numpy(),
        scales=scales,
        confidence=_joint_confidence(clip.evidence.confidence),
        contacts=contacts,
        inverse_far=np.exp(variables.log_inverse_far.cpu().double().numpy()),
        inverse_gap=np.exp(variables.log_inverse_gap.cpu().double().numpy()),
        ground=replace(ground, offset=offset),
    )


def _joint_confidence(keypoint_confidence: Array) -> Array:
    columns = []
    for name in JOINT_NAMES:
        witnesses = _WITNESSES.get(name)
        if witnesses is None:
            witnesses = (name,) if name.startswith(("left_", "right_")) and "collar" not in name else _TRUNK
        columns.append(keypoint_confidence[..., [keypoint_index(w) for w in witnesses]].mean(axis=-1))
    return np.stack(columns, axis=-1)
