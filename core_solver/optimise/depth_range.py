"""The depth range of the clip and of each frame, given where the bodies are: two unknowns each, tied to each other."""

from dataclasses import replace

import torch

from core_solver.optimise.joint_energy import DEPTH_RANGE_SIGMA, JointEnergy
from core_solver.optimise.variables import Variables

_PASSES = 3
_STIFFNESS = 1e-3  # keeps a range where it is that no body says anything of


@torch.no_grad()
def fit_depth_range(energy: JointEnergy, v: Variables) -> Variables:
    """Minimise the energy over the depth ranges alone: iteratively reweighted least squares in closed form."""
    if energy.motion.picture is None or energy.weights.depth == 0:
        return v
    for _ in range(_PASSES):
        v = _pass(energy, v)
    return v


def _pass(energy: JointEnergy, v: Variables) -> Variables:
    given, w, picture = energy.given, energy.weights, energy.motion.picture
    assert picture is not None  # noqa: S101 - asked by the caller
    pairs = [picture.depth.log_depths(v, n) for n in range(energy.people)]
    residual = torch.cat([(scene - body) / w.depth_sigma for body, scene in pairs])
    weight = w.depth * picture.depth.weight * given.per_clip * torch.rsqrt(1 + residual**2)
    rows = picture.depth.scene_rows / w.depth_sigma
    system = torch.einsum("nt,nta,ntb->tab", weight, rows, rows)
    gradient = torch.einsum("nt,nta,nt->ta", weight, rows, residual)
    slack = torch.stack([v.log_inverse_far, v.log_inverse_gap], -1) - v.log_range
    tie = given.per_clip.mean() * torch.rsqrt(1 + (slack / DEPTH_RANGE_SIGMA) ** 2) / DEPTH_RANGE_SIGMA**2
    # Frames are eliminated first: what remains are the two unknowns of the clip.
    answer = torch.linalg.solve(
        system + torch.diag_embed(tie), torch.cat([(-gradient - tie * slack)[..., None], torch.diag_embed(tie)], -1)
    )
    reduced = (torch.diag_embed(tie) - tie[..., None] * answer[..., 1:]).sum(0)
    right = (tie * slack + tie * answer[..., 0]).sum(0)
    stiffness = _STIFFNESS * tie.sum() * torch.eye(2).to(tie)
    clip = torch.linalg.solve(reduced + stiffness, right)
    frames = answer[..., 0] + answer[..., 1:] @ clip
    return replace(
        v,
        log_inverse_far=v.log_inverse_far + frames[:, 0],
        log_inverse_gap=v.log_inverse_gap + frames[:, 1],
        log_range=v.log_range + clip,
    )
