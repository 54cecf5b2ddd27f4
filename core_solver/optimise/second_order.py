"""Levenberg-Marquardt on a whole clip: bands in time for each person, a border for what all frames share."""

import logging
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import LinAlgError
from torch import Tensor

from core_solver.optimise.bordered import Step, reduce_person, solve_border
from core_solver.optimise.curvature import OWN, person_curvature
from core_solver.optimise.depth_range import fit_depth_range
from core_solver.optimise.joint_energy import JointEnergy
from core_solver.optimise.variables import Variables

Array = NDArray[np.float64]

_LOG = logging.getLogger(__name__)
_ATTEMPTS = 10
_FIRST_DAMPING = 1e-3
_LEAST_DAMPING, _MOST_DAMPING = 1e-7, 1e6
_LARGEST_TURN = 1.0  # radians a joint may turn in one step
_WORKERS = 2


@dataclass(frozen=True)
class Schedule:
    """How long to go on.

    Attributes:
        iterations: at most.
        tolerance: stop when an iteration lowers the energy by less than this share.
    """

    iterations: int
    tolerance: float


@dataclass(frozen=True)
class _Gradient:
    """Half the gradient: (N, T, 75), (N, 11), (4,)."""

    frames: Array
    own: Array
    shared: Array


def minimise(
    energy: JointEnergy,
    v: Variables,
    schedule: Schedule,
    look: Callable[[Variables], None] = lambda _v: None,
    advance: Callable[[int], None] = lambda _steps: None,
) -> Variables:
    """Lower the energy until it stays where it is.

    Args:
        energy: of the clip.
        v: where to start.
        schedule: when to stop.
        look: called before each iteration; it renews what the energy has linearised.
        advance: told after each iteration; it is told of all of them even when the solve ends early.
    """
    damping, iteration = _FIRST_DAMPING, 0
    while iteration < schedule.iterations:
        look(v)
        v, damping, before, after = _iterate(energy, fit_depth_range(energy, v), damping)
        _LOG.debug("iteration %d: energy %.6g to %.6g, damping %.1g", iteration, before, after, damping)
        iteration += 1
        advance(1)
        if before - after <= schedule.tolerance * abs(before):
            break
    advance(schedule.iterations - iteration)
    return v


def _iterate(energy: JointEnergy, v: Variables, damping: float) -> tuple[Variables, float, float, float]:
    """One accepted step, or none when no damping helps; also the next damping and the energies before and after."""
    with ThreadPoolExecutor(_WORKERS) as pool:
        before, gradient = _gradient(energy, v, pool)
        curvatures = list(pool.map(lambda n: person_curvature(energy, v, n), range(energy.people)))
        shared = _shared_curvature(energy)
        for _ in range(_ATTEMPTS):
            try:
                reduce = _Reduce(curvatures, gradient, damping)
                step = solve_border(list(pool.map(reduce, range(energy.people))), shared, gradient.shared)
            except (LinAlgError, np.linalg.LinAlgError):
                damping = min(damping * 10, _MOST_DAMPING)
                continue
            trial = _moved(v, step)
            after = energy.value(trial)
            if after < before:
                return trial, max(damping / 5, _LEAST_DAMPING), before, after
            damping = min(damping * 6, _MOST_DAMPING)
    return v, damping, before, before


@dataclass(frozen=True)
class _Reduce:
    curvatures: list
    gradient: _Gradient
    damping: float

    def __call__(self, n: int):
        return reduce_person(self.curvatures[n], self.gradient.frames[n], self.gradient.own[n], self.damping)


def _gradient(energy: JointEnergy, v: Variables, pool: ThreadPoolExecutor) -> tuple[float, _Gradient]:
    """The energy, and half its gradient by everything but the depth range, which is solved for on its own."""

    def person(n: int) -> tuple[float, Array, Array, Array]:
        leaves = v.leaves()
        value = energy.person(leaves, n)
        value.backward()
        frames = torch.cat([_grad(leaves.theta)[n].flatten(1), _grad(leaves.translation)[n]], -1)
        own = torch.cat([_grad(leaves.log_scale)[n : n + 1], _grad(leaves.betas)[n]])
        shared = torch.cat([_grad(leaves.ground), _grad(leaves.log_focal)[None]])
        return float(value.detach()), _numbers(frames), _numbers(own), _numbers(shared)

    values, frames, own, shared = zip(*pool.map(person, range(energy.people)), strict=True)
    leaves = v.leaves()
    value = energy.shared(leaves)
    value.backward()
    scene = _numbers(torch.cat([_grad(leaves.ground), _grad(leaves.log_focal)[None]]))
    return sum(values) + float(value.detach()), _Gradient(
        np.stack(frames) / 2, np.stack(own) / 2, (np.sum(shared, axis=0) + scene) / 2
    )


def _grad(leaf: Tensor) -> Tensor:
    return leaf.grad if leaf.grad is not None else torch.zeros_like(leaf)


def _numbers(values: Tensor) -> Array:
    # A frame whose evidence contradicts itself must not poison the clip: its gradient is dropped, not spread.
    return np.nan_to_num(values.cpu().double().numpy(), nan=0.0, posinf=0.0, neginf=0.0)


def _shared_curvature(energy: JointEnergy) -> Array:
    w, count = energy.weights, energy.given.valid.numel()
    # A known focal length stays where it is.
    focal = w.focal_sigma**-2 if w.focal_sigma > 0 else 1.0
    return np.array([count / w.tilt_sigma**2, count / w.tilt_sigma**2, count / w.guard_sigma**2, focal])


def _moved(v: Variables, step: Step) -> Variables:
    def like(values: Array) -> Tensor:
        return torch.as_tensor(values, dtype=v.theta.dtype, device=v.theta.device)

    turn = step.frames[..., :-3]
    turn = turn * np.minimum(1, _LARGEST_TURN / np.maximum(np.abs(turn), 1e-9))
    return replace(
        v,
        theta=v.theta + like(turn).unflatten(-1, (24, 3)),
        translation=v.translation + like(step.frames[..., -3:]),
        log_scale=v.log_scale + like(step.own[:, 0]),
        betas=v.betas + like(step.own[:, 1:OWN]),
        ground=v.ground + like(step.shared[:3]),
        log_focal=v.log_focal + like(step.shared[3]),
    )
