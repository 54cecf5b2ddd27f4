"""Damped linear systems with the structure of a clip: a band for each person, a small border all frames share."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

from core_solver.optimise.curvature import BORDER, FRAME, OWN, SHARED, Curvature

Array = NDArray[np.float64]

_BELOW = 2 * FRAME  # translations two frames apart are the farthest from the diagonal
_PLACE = FRAME - 3
_FLOOR = 1e-6  # keeps what no term sees where it is


@dataclass(frozen=True)
class Step:
    """A change of all variables.

    Attributes:
        frames: (N, T, 75) angles, then translation.
        own: (N, 11) log scale, then betas.
        shared: (4,) ground, then log focal length.
    """

    frames: Array
    own: Array
    shared: Array


@dataclass(frozen=True)
class PersonSystem:
    """One person's part of the normal equations; `reduced` is what the border feels of it.

    Attributes:
        frames: (T, 75) answer to the gradient alone.
        response: (T, 75, 15) answer to each unknown of the border.
        corner: (15, 15) Schur complement.
        right: (15,) its right-hand side.
    """

    frames: Array
    response: Array
    corner: Array
    right: Array


def reduce_person(curvature: Curvature, frame_gradient: Array, own_gradient: Array, damping: float) -> PersonSystem:
    """Eliminate one person's frames.

    Args:
        curvature: half the second derivatives.
        frame_gradient: (T, 75) half the gradient.
        own_gradient: (11,) half the gradient.
        damping: Marquardt's factor on the diagonal.

    Raises:
        LinAlgError: not positive definite, damp more.
    """
    band = _band(curvature)
    band[0] += damping * band[0] + _FLOOR
    frames = len(curvature.blocks)
    sides = curvature.sides.cpu().float().numpy()
    factor = cholesky_banded(band, overwrite_ab=True, lower=True, check_finite=False)
    right = np.concatenate([frame_gradient[..., None].astype(np.float32), sides], -1).reshape(
        frames * FRAME, 1 + BORDER
    )
    answer = cho_solve_banded((factor, True), right, check_finite=False).reshape(frames, FRAME, 1 + BORDER)
    if not np.isfinite(answer).all():
        raise LinAlgError("the normal equations have no finite answer")
    corner = curvature.corner.cpu().double().numpy().copy()
    corner[np.diag_indices(BORDER)] *= 1 + damping
    corner -= np.einsum("tfa,tfb->ab", sides, answer[..., 1:])
    gradient = np.concatenate([own_gradient, np.zeros(SHARED)])
    return PersonSystem(
        answer[..., 0], answer[..., 1:], corner, gradient - np.einsum("tfa,tf->a", sides, answer[..., 0])
    )


def solve_border(people: Sequence[PersonSystem], shared_curvature: Array, shared_gradient: Array) -> Step:
    """Solve for what all frames share, then for every frame; descends along the negative gradient.

    Args:
        people: one system each.
        shared_curvature: (4,) half the second derivatives of the scene's own terms.
        shared_gradient: (4,) half the gradient with respect to ground and focal length.
    """
    count = len(people)
    size = count * OWN + SHARED
    system, right = np.zeros((size, size)), np.zeros(size)
    shared = np.arange(count * OWN, size)
    for n, person in enumerate(people):
        rows = np.concatenate([np.arange(n * OWN, (n + 1) * OWN), shared])
        system[np.ix_(rows, rows)] += person.corner
        right[rows] += person.right
    system[shared, shared] += shared_curvature
    right[shared] += shared_gradient
    system[np.diag_indices(size)] += _FLOOR
    border = np.linalg.solve(system, right)
    own, common = border[: count * OWN].reshape(count, OWN), border[shared]
    frames = [person.frames - person.response @ np.concatenate([own[n], common]) for n, person in enumerate(people)]
    return Step(-np.stack(frames), -own, -common)


def _band(curvature: Curvature) -> NDArray[np.float32]:
    """Lower band (151, 75 T) of the frames' matrix: row d, column j holds the entry (j + d, j)."""
    blocks, following = curvature.blocks.cpu().numpy(), curvature.next.cpu().numpy()
    frames = len(blocks)
    band = np.zeros((frames, FRAME, _BELOW + 1), np.float32)
    for column in range(FRAME):
        band[:, column, : FRAME - column] = blocks[:, column:, column]
        band[:-1, column, FRAME - column : 2 * FRAME - column] = following[:, :, column]
    band[:-2, _PLACE:, _BELOW] = curvature.after_next.cpu().numpy()[:, None]
    return np.ascontiguousarray(band.reshape(frames * FRAME, _BELOW + 1).T)
