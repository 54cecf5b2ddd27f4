"""The paper's own solver: its energies, lambdas, stages and optimiser, as the measure for ours.

What the paper leaves open is settled where it is met, and always in its favour: a closed-form start instead of a few
descent steps, frames compared only with their neighbours, terms that hold once for a clip counted once.
"""

from dataclasses import dataclass, field

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn.functional import softplus

from core_solver.body.model import BodyModel
from core_solver.camera import Camera
from core_solver.energy import paper as energy
from core_solver.energy.paper import PaperWeights
from core_solver.energy.terms import CONTACT_RANGE_M
from core_solver.geometry import GroundFrame
from core_solver.optimise import paper_picture, pose_fit
from core_solver.optimise.evidence import Evidence, gather_evidence
from core_solver.optimise.one_euro import one_euro
from core_solver.optimise.paper_picture import DepthRange, Picture
from core_solver.optimise.pose_fit import PoseFit, fit_poses
from core_solver.optimise.posing import TorchBody, pose, torch_body
from core_solver.optimise.solution import Solution
from core_solver.optimise.switches import Switchable
from core_solver.progress import Progress
from core_solver.scene.aggregate import median_depth
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]

_DOWN = np.array([0.0, 1.0, 0.0])  # the paper takes the camera's y axis for gravity
_NEAREST_M = 0.05
_SMALLEST = 1e-3  # of scales, and of depths in metres
_BESIDE_M = 0.05  # a second foot stands when it is hardly higher than the first


@dataclass(frozen=True)
class PaperPreset(Switchable[PaperWeights]):
    """How the paper solves.

    Attributes:
        name: for the command line and the take.
        weights: lambdas.
        stage_one: iterations on E_I.
        stage_two: iterations on E_I + E_II.
        rate: of RMSprop at the start.
        decay: of the rate, an iteration.
        raster_size: pixels of the raster's longer side.
        batch: frames rasterised at a time; their gradients make one step, so that it changes nothing but memory.
        renew_every: iterations after which stage II looks again at the scene's cloud and the filtered vertices. Held
            from stage I on, both fall behind what is solved; in every iteration, the filter's lag feeds on itself.
    """

    name: str = "paper"
    weights: PaperWeights = field(default_factory=PaperWeights)
    stage_one: int = 30
    stage_two: int = 200
    rate: float = 0.01
    decay: float = 0.99
    raster_size: int = 96
    batch: int = 10
    renew_every: int = 25


def solve_paper(
    modalities: Modalities, camera: Camera, body: BodyModel, progress: Progress, preset: PaperPreset,
    device: str = "cpu",
) -> Solution:  # fmt: skip
    """Solve all people and the scene of a clip as the paper does.

    Without disparity there are neither depth nor scene, hence no E_depth, E_contact and E_slip.

    Args:
        modalities: at least one track.
        camera: intrinsics of the footage.
        body: body model.
        progress: shows the stages.
        preset: lambdas and iterations.
        device: "cpu" or "cuda".
    """
    evidence = gather_evidence(modalities, camera)
    solver_body = torch_body(body, torch.device(device))
    with progress.stage("Fit poses", pose_fit.ITERATIONS) as advance:
        fit = fit_poses(evidence, body, solver_body, camera, advance, smooth=False)
    picture = paper_picture.picture_on_grid(modalities, camera, solver_body.faces, preset.raster_size)
    clip = PaperEnergy(evidence, fit, picture, camera, solver_body, preset)
    variables = clip.start()
    optimiser = torch.optim.RMSprop(variables.leaves(), preset.rate, alpha=0.5, momentum=0.9)
    schedule = torch.optim.lr_scheduler.ExponentialLR(optimiser, preset.decay)

    def step(motion: Motion | None) -> None:
        optimiser.zero_grad()
        clip.accumulate(variables, motion)
        optimiser.step()
        schedule.step()

    def scene() -> KDTree | None:
        return _scene_cloud(modalities, camera, variables.depth_range())

    with progress.stage("Solve scale and depth", preset.stage_one) as advance:
        for _ in range(preset.stage_one):
            step(None)
            advance(1)
    motion = None
    with progress.stage("Solve space and time", preset.stage_two) as advance:
        for iteration in range(preset.stage_two):
            if iteration % preset.renew_every == 0:
                motion = Motion(clip.filtered(variables, evidence.times), scene())
            step(motion)
            advance(1)
    return _solution(clip, variables, evidence, scene())


@dataclass(frozen=True)
class PaperVariables:
    """What is solved for; leaf tensors. Scales and depths are softplus of theirs: positive, whatever the step.

    Attributes:
        theta: (N, T, 24, 3) radians.
        betas: (N, 10).
        gamma: (N, T, 3) metres.
        soft_scale: (N,).
        soft_near: (T,) of z_near.
        soft_range: (T,) of z_far - z_near.
    """

    theta: Tensor
    betas: Tensor
    gamma: Tensor
    soft_scale: Tensor
    soft_near: Tensor
    soft_range: Tensor

    def leaves(self) -> list[Tensor]:
        """What the optimiser moves."""
        return [self.theta, self.betas, self.gamma, self.soft_scale, self.soft_near, self.soft_range]

    def scales(self) -> Tensor:
        """(N,) > 0."""
        return _SMALLEST + softplus(self.soft_scale)

    def depth_range(self) -> DepthRange:
        """0 < z_near < z_far."""
        near = _SMALLEST + softplus(self.soft_near)
        return DepthRange(near, near + _SMALLEST + softplus(self.soft_range))


def _soft(value: Array) -> Array:
    """The x with value = smallest + softplus(x); written so that large values do not overflow."""
    value = np.maximum(value - _SMALLEST, 1e-6)
    return value + np.log(-np.expm1(-value))


@dataclass(frozen=True)
class Motion:
    """What stage II adds.

    Attributes:
        filtered: (N, T, V, 3) metres, vertices through the one-euro filter.
        scene: points of the static scene; None where nothing is known of it.
    """

    filtered: Tensor
    scene: KDTree | None


class PaperEnergy:
    """E_I and E_II of a clip, with their constants on the device."""

    def __init__(
        self, evidence: Evidence, fit: PoseFit, picture: Picture, camera: Camera, body: TorchBody, preset: PaperPreset
    ) -> None:
        self.body, self.picture, self.preset = body, picture, preset
        self._like = body.keypoints.template
        self._fit = fit
        self._pixels, self._confidence = self._tensor(evidence.pixels), self._tensor(evidence.confidence)
        self._valid = self._tensor(evidence.valid)
        self._theta_hat, self._betas_hat = self._tensor(fit.theta), self._tensor(fit.betas)
        self._focal = self._tensor(np.array([camera.fx, camera.fy]))
        self._centre = self._tensor(np.array([camera.cx, camera.cy]))
        self._image_size = (camera.width, camera.height)

    def start(self) -> PaperVariables:
        """Regressed poses at unit scale where their keypoints put them, and the depth range that suits these."""
        fit, people, frames = self._fit, len(self._fit.betas), self._fit.theta.shape[1]
        near, far = paper_picture.first_range(self.picture, fit.translation[..., 2])
        values = (
            fit.theta, fit.betas, fit.translation, _soft(np.ones(people)), _soft(np.full(frames, near)),
            _soft(np.full(frames, far - near)),
        )  # fmt: skip
        return PaperVariables(*(self._tensor(value).requires_grad_() for value in values))

    def accumulate(self, v: PaperVariables, motion: Motion | None) -> float:
        """Add the gradient of the whole clip's energy to the variables', and give its value.

        Raster terms take a few frames at a time. All of one step's batches are summed before anything moves.
        """
        keypoints, vertices = self.points(v)
        rest = self._point_terms(v, keypoints, vertices, motion)
        corners = vertices.detach().requires_grad_()
        total = float(rest.detach())
        for frames in self.picture.frame_batches(self.preset.batch):
            seen = self._picture_terms(v, frames, corners)
            if seen.requires_grad:
                seen.backward()
            total += float(seen.detach())
        pull = torch.zeros_like(corners) if corners.grad is None else corners.grad
        torch.autograd.backward([rest, vertices], [None, pull])
        for leaf in v.leaves():
            # What cannot be measured must not poison the clip.
            if leaf.grad is not None:
                torch.nan_to_num_(leaf.grad, nan=0.0, posinf=0.0, neginf=0.0)
        return total

    def points(self, v: PaperVariables) -> tuple[Tensor, Tensor]:
        """Keypoints (N, T, 25, 3) and all vertices (N, T, V, 3), metres."""
        posed = pose(v.theta, v.betas, self.body)
        scales, shift = v.scales()[:, None, None, None], v.gamma[:, :, None]
        keypoints = scales * posed.skin(self.body.keypoints, v.betas) + shift
        return keypoints, scales * posed.skin(self.body.surface, v.betas) + shift

    def feet(self, v: PaperVariables) -> tuple[Array, Array]:
        """Lowest sole point (N, T, 2, 3) of each foot, and y (N, T) of each person's lowest vertex, metres."""
        posed = pose(v.theta, v.betas, self.body)
        soles = v.scales()[:, None, None, None] * posed.skin(self.body.soles, v.betas) + v.gamma[:, :, None]
        soles = soles.unflatten(2, (2, -1))
        rows = energy.lowest(soles)[..., None, None].expand(-1, -1, -1, 1, 3)
        lowest = torch.gather(soles, 3, rows)[:, :, :, 0]
        return lowest.cpu().double().numpy(), self.points(v)[1][..., 1].amax(-1).cpu().double().numpy()

    def filtered(self, v: PaperVariables, times: Array) -> Tensor:
        """Vertices (N, T, V, 3) through the one-euro filter, metres."""
        with torch.no_grad():
            vertices = self.points(v)[1].cpu().double().numpy()
        return self._tensor(np.stack([one_euro(person, times) for person in vertices]))

    def _point_terms(self, v: PaperVariables, keypoints: Tensor, vertices: Tensor, motion: Motion | None) -> Tensor:
        w = self.preset.weights
        projected = keypoints[..., :2] / keypoints[..., 2:].clamp_min(_NEAREST_M) * self._focal + self._centre
        total = (
            w.joints * energy.joints(projected, self._pixels, self._confidence, self._image_size)
            + w.smpl * energy.smpl(v.theta, self._theta_hat, v.betas, self._betas_hat, self._valid)
            + w.scale * energy.scale(v.scales(), w.scale_each)
            + w.speed * energy.speed(v.gamma)
        )
        if motion is None:
            return total
        total = total + w.temporal * energy.temporal(vertices, motion.filtered)
        return total if motion.scene is None else total + self._contact_terms(vertices, motion.scene)

    def _contact_terms(self, vertices: Tensor, scene: KDTree) -> Tensor:
        w, rows = self.preset.weights, energy.lowest(vertices.detach())
        points = torch.gather(vertices, 2, rows[..., None, None].expand(-1, -1, 1, 3))[:, :, 0]
        nearest = self._tensor(_nearest(scene, points.detach().cpu().numpy())[0])
        touching = energy.is_touching(points.detach(), nearest)
        return w.contact * energy.contact(points, nearest) + w.slip * energy.slip(vertices, rows, touching)

    def _picture_terms(self, v: PaperVariables, frames: slice, vertices: Tensor) -> Tensor:
        w, total = self.preset.weights, vertices.new_zeros(())
        with_depth = w.depth > 0 and self.picture.disparity is not None
        if not (self.picture.valid[:, frames].any() and (w.silhouette > 0 or with_depth)):
            return total
        bodies = paper_picture.bodies_in(self.picture, frames, vertices[:, frames])
        if w.silhouette > 0:
            total = total + w.silhouette * paper_picture.silhouette(self.picture, bodies)
        if with_depth:
            total = total + w.depth * paper_picture.depth(self.picture, bodies, v.depth_range())
        return total

    def _tensor(self, values: NDArray) -> Tensor:
        return torch.as_tensor(np.array(values), dtype=self._like.dtype, device=self._like.device)


def _scene_cloud(modalities: Modalities, camera: Camera, depth_range: DepthRange) -> KDTree | None:
    """The static scene (paper, scene point cloud), or None where nothing of it was seen."""
    if modalities.disparity is None:
        return None
    inverse_far, inverse_gap = (value.detach().cpu().double().numpy() for value in depth_range.inverse())
    depth = median_depth(modalities, inverse_far, inverse_gap)
    points = (camera.grid_rays(*depth.shape) * depth[..., None])[np.isfinite(depth)]
    return KDTree(points) if len(points) else None


def _nearest(scene: KDTree, points: Array) -> tuple[Array, Array]:
    """Nearest scene points (..., 3) of points (..., 3) and their distances (...), metres, in the L1 norm."""
    distance, index = scene.query(np.nan_to_num(points), p=1)
    return np.asarray(scene.data)[index], np.asarray(distance)


def _solution(clip: PaperEnergy, v: PaperVariables, evidence: Evidence, scene: KDTree | None) -> Solution:
    with torch.no_grad():
        soles, lowest = clip.feet(v)
        inverse_far, inverse_gap = v.depth_range().inverse()
        values = (v.theta, v.gamma, v.betas, v.scales(), inverse_far, inverse_gap)
        theta, gamma, betas, scales, far, gap = (value.cpu().double().numpy() for value in values)
    contacts = _contacts(soles, lowest, scene) & evidence.valid[..., None]
    return Solution(
        theta=theta,
        gamma=gamma,
        betas=betas,
        scales=scales,
        confidence=np.repeat(evidence.confidence.mean(axis=-1, keepdims=True), 24, axis=-1),
        contacts=contacts.astype(float),
        inverse_far=far,
        inverse_gap=gap,
        ground=GroundFrame(_DOWN, -_DOWN, _ground_height(soles[..., 1], contacts, evidence.valid)),
    )


def _contacts(soles: Array, lowest: Array, scene: KDTree | None) -> NDArray[np.bool_]:
    """Which feet (N, T, 2) stand. The paper knows only people in contact: their lowest vertex is near the scene.

    Here a foot stands when its lowest sole point is as near, and hardly higher than the person's lowest vertex.

    Args:
        soles: (N, T, 2, 3) metres, lowest sole point of each foot.
        lowest: (N, T) metres, y of the lowest vertex.
        scene: static points; nobody stands on an unknown one.
    """
    if scene is None:
        return np.zeros(soles.shape[:3], bool)
    _, distance = _nearest(scene, soles)
    return (distance < CONTACT_RANGE_M) & (soles[..., 1] > lowest[..., None] - _BESIDE_M)


def _ground_height(soles: Array, contacts: NDArray[np.bool_], valid: NDArray[np.bool_]) -> float:
    """Metres from the camera down to the ground: the median of the soles (N, T, 2) that stand, or else are seen."""
    for chosen in (soles[contacts], soles[valid].max(axis=-1), soles.max(axis=-1)):
        if chosen.size:
            return float(np.median(chosen))
    raise ValueError("a solution needs people")
