"""Each frame's z_near and z_far, given where the bodies are: two unknowns a frame, tied to the clip's."""

from dataclasses import replace

import torch
from torch import Tensor

from core_solver.optimise.joint_energy import DEPTH_RANGE_SIGMA, JointEnergy
from core_solver.optimise.variables import Variables

_PASSES = 3


def fit_depth_range(energy: JointEnergy, v: Variables) -> Variables:
    """Minimise the energy over the depth ranges alone: iteratively reweighted least squares in closed form."""
    picture = energy.motion.picture
    if picture is None or energy.weights.depth == 0:
        return v
    for _ in range(_PASSES):
        v = _pass(energy, v)
    return v


@torch.no_grad()
def _pass(energy: JointEnergy, v: Variables) -> Variables:
    given, w, picture = energy.given, energy.weights, energy.motion.picture
    pairs = [picture.log_depths(v, n) for n in range(energy.people)]
    residual = torch.cat([(scene - body) / w.depth_sigma for body, scene in pairs])
    weight = w.depth * picture.depth_weight * given.per_clip * torch.rsqrt(1 + residual**2)
    rows = picture.scene_rows / w.depth_sigma
    system = torch.einsum("nt,nta,ntb->tab", weight, rows, rows)
    right = torch.einsum("nt,nta,nt->ta", weight, rows, residual)
    ranges = torch.stack([v.log_inverse_far, v.log_inverse_gap], -1)
    ties = (ranges - given.log_range) / DEPTH_RANGE_SIGMA
    tie = (given.per_clip.mean() * torch.rsqrt(1 + ties**2)) / DEPTH_RANGE_SIGMA
    system = system + torch.diag_embed(tie / DEPTH_RANGE_SIGMA)
    step = torch.linalg.solve(system, right + tie * ties)
    return replace(v, log_inverse_far=v.log_inverse_far - step[:, 0], log_inverse_gap=v.log_inverse_gap - step[:, 1])


def clip_range(v: Variables) -> Tensor:
    """(2,) the clip's own range: the median of its frames'."""
    return torch.stack([v.log_inverse_far.median(), v.log_inverse_gap.median()])
