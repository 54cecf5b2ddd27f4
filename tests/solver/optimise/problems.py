"""A clip at its truth as the joint energy sees it, in double precision."""

import math
from dataclasses import replace

import numpy as np
import torch

from core_solver.body.model import BodyModel
from core_solver.energy.weights import Weights
from core_solver.optimise.evidence import gather_evidence
from core_solver.optimise.joint_energy import JointEnergy, given_evidence
from core_solver.optimise.looking import Look, Onlooker
from core_solver.optimise.picture_terms import PictureTerms
from core_solver.optimise.pose_fit import PoseFit
from core_solver.optimise.posing import pose, torch_body
from core_solver.optimise.scale_ground import ScaleGround
from core_solver.optimise.variables import Variables, start_variables
from tests.solver.scenes import SyntheticClip

FAR, GAP = 1 / 30, 1 / 1.5 - 1 / 30  # the synthetic disparity's true range
CLOSELY = Look(160, 32, each_pixel=True)
SWITCHES = Weights.terms()
_NO_GUARD = math.inf


class Problem:
    """Energy and variables of a clip; `variables` are the truth, `still` says that feet rest wherever they are low."""

    def __init__(self, clip: SyntheticClip, body: BodyModel, weights: Weights | None = None, levels=None) -> None:
        people = len(clip.scales)
        self.clip, self.body, self.weights = clip, body, weights or Weights()
        self.solver_body = torch_body(body, torch.device("cpu"), torch.float64)
        self.fit = PoseFit(clip.theta, clip.gamma / clip.scales[:, None, None], np.zeros((people, 10)))
        self.ground = ScaleGround(clip.scales, clip.up, clip.camera_height, np.zeros(people), FAR, GAP)
        self.evidence = gather_evidence(clip.modalities, clip.camera)
        self.energy = self.energy_with(self.weights)
        self.variables = start_variables(self.fit, self.ground, self.solver_body)
        still = np.ones((people, len(clip.modalities.times), 2))
        levels = np.zeros(people) if levels is None else np.array(levels)
        self.onlooker = Onlooker(clip.modalities, clip.camera, self.evidence, still, levels)

    def energy_with(self, weights: Weights) -> JointEnergy:
        """The same evidence, weighed differently; it has not looked at anything yet."""
        given = given_evidence(
            self.evidence, self.fit, self.ground, self.clip.camera, self.body, self.solver_body, weights
        )
        return JointEnergy(given, self.solver_body, weights)

    def look(self, v: Variables | None = None, closely: Look = CLOSELY) -> None:
        """Switch on all terms that need a look: picture, contacts, supports, spheres, filtered points."""
        v = v or self.variables
        self.onlooker.look(self.energy, v, closely)
        self.energy.look(filtered=unit_points(v, self.energy))

    @property
    def picture(self) -> PictureTerms:
        """What the last look saw."""
        assert self.energy.motion.picture is not None
        return self.energy.motion.picture

    def changed(self, **changes: torch.Tensor) -> Variables:
        return replace(self.variables, **changes)


def unit_points(v: Variables, energy: JointEnergy) -> torch.Tensor:
    """(N, T, P, 3) at unit scale."""
    with torch.no_grad():
        return pose(v.theta, v.betas, energy.body).skin(energy.body.followed, v.betas) + v.translation[:, :, None]


def only(*terms: str, **changes: float) -> Weights:
    """All terms off but these; what guards the scales, which has no switch, is as good as off."""
    silent = {name: 0.0 for name in SWITCHES if name not in terms}
    return replace(Weights(), **silent, **{"guard_sigma": _NO_GUARD, **changes})


def total(energy: JointEnergy, v: Variables) -> torch.Tensor:
    """The whole energy, differentiable."""
    return torch.stack([energy.person(v, n) for n in range(energy.people)]).sum() + energy.shared(v)


def disturbed(v: Variables, angle: float = 0.05, shift: float = 0.05, seed: int = 0) -> Variables:
    """Angles and translations with noise."""
    rng = np.random.default_rng(seed)
    return replace(
        v,
        theta=v.theta + angle * torch.as_tensor(rng.normal(size=v.theta.shape)),
        translation=v.translation + shift * torch.as_tensor(rng.normal(size=v.translation.shape)),
    )


def disturbed_alike(v: Variables, angle: float = 0.1, shift: float = 0.1, seed: int = 0) -> Variables:
    """The same error in all frames: nothing trembles."""
    rng = np.random.default_rng(seed)
    people = len(v.theta)
    return replace(
        v,
        theta=v.theta + angle * torch.as_tensor(rng.normal(size=(people, 1, 24, 3))),
        translation=v.translation + shift * torch.as_tensor(rng.normal(size=(people, 1, 3))),
    )
