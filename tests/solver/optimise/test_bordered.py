"""The bordered band against a dense solve of the same damped system."""

from dataclasses import dataclass

import numpy as np
import pytest
import torch
from scipy.linalg import LinAlgError

from core_solver.optimise.bordered import Step, reduce_person, solve_border
from core_solver.optimise.curvature import BORDER, FRAME, OWN, SHARED, Curvature

DAMPING = 0.05


@dataclass(frozen=True)
class Person:
    """Random rows with the structure of a clip; `matrix` is dense: T frames of 75, then the border's 15."""

    curvature: Curvature
    matrix: np.ndarray
    frame_gradient: np.ndarray
    own_gradient: np.ndarray


def random_person(frames: int, seed: int) -> Person:
    """Normal equations of residuals that see one frame, two neighbours, or the places of three."""
    rng = np.random.default_rng(seed)
    size = frames * FRAME + BORDER
    border = np.arange(frames * FRAME, size)
    matrix = np.zeros((size, size))
    for t in range(frames):
        seen = np.concatenate([np.arange(t * FRAME, (t + 1) * FRAME), border])
        rows = rng.normal(size=(120, len(seen)))
        matrix[np.ix_(seen, seen)] += rows.T @ rows
    for t in range(frames - 1):
        seen = np.arange(t * FRAME, (t + 2) * FRAME)
        rows = rng.normal(size=(40, len(seen)))
        matrix[np.ix_(seen, seen)] += rows.T @ rows
    second = np.zeros(max(frames - 2, 0))
    for t in range(frames - 2):
        row = rng.normal(size=3)
        second[t] = row[0] * row[2]
        for axis in range(3):
            seen = [(t + k) * FRAME + FRAME - 3 + axis for k in range(3)]
            matrix[np.ix_(seen, seen)] += np.outer(row, row)
    curvature = Curvature(
        blocks=torch.as_tensor(np.stack([_block(matrix, t, t) for t in range(frames)])),
        next=torch.as_tensor(np.array([_block(matrix, t + 1, t) for t in range(frames - 1)]).reshape(-1, FRAME, FRAME)),
        after_next=torch.as_tensor(second),
        sides=torch.as_tensor(matrix[: frames * FRAME, border].reshape(frames, FRAME, BORDER).copy()),
        corner=torch.as_tensor(matrix[np.ix_(border, border)]),
    )
    return Person(curvature, matrix, rng.normal(size=(frames, FRAME)), rng.normal(size=OWN))


def _block(matrix: np.ndarray, row: int, column: int) -> np.ndarray:
    return matrix[row * FRAME : (row + 1) * FRAME, column * FRAME : (column + 1) * FRAME]


def dense_step(people: list[Person], shared_curvature: np.ndarray, shared_gradient: np.ndarray) -> Step:
    """The same by one dense matrix: all frames of all people, then everybody's own unknowns, then what all share."""
    frames = len(people[0].frame_gradient)
    inner, count = frames * FRAME, len(people)
    size = count * (inner + OWN) + SHARED
    matrix, right = np.zeros((size, size)), np.zeros(size)
    shared = np.arange(size - SHARED, size)
    for n, person in enumerate(people):
        own = np.arange(count * inner + n * OWN, count * inner + (n + 1) * OWN)
        rows = np.concatenate([np.arange(n * inner, (n + 1) * inner), own, shared])
        # Marquardt's damping is each person's, before the scene's own terms.
        matrix[np.ix_(rows, rows)] += person.matrix + DAMPING * np.diag(np.diag(person.matrix))
        right[rows[:-SHARED]] += np.concatenate([person.frame_gradient.ravel(), person.own_gradient])
    matrix[shared, shared] += shared_curvature
    right[shared] += shared_gradient
    answer = np.asarray(-np.linalg.solve(matrix + 1e-6 * np.eye(size), right), np.float64)
    return Step(
        answer[: count * inner].reshape(count, frames, FRAME),
        answer[count * inner : -SHARED].reshape(count, OWN),
        answer[-SHARED:],
    )


@pytest.mark.parametrize("people", [1, 2])
@pytest.mark.parametrize("frames", [1, 2, 3, 5])
def test_the_answer_of_a_dense_solve(people, frames):
    crowd = [random_person(frames, seed) for seed in range(people)]
    shared_curvature, shared_gradient = np.array([3.0, 4.0, 50.0, 1.0]), np.array([1.0, -2.0, 0.5, 3.0])
    systems = [reduce_person(p.curvature, p.frame_gradient, p.own_gradient, DAMPING) for p in crowd]
    found = solve_border(systems, shared_curvature, shared_gradient)
    truth = dense_step(crowd, shared_curvature, shared_gradient)
    assert found.frames.shape == (people, frames, FRAME)
    for name in ("frames", "own", "shared"):
        exact = getattr(truth, name)
        # The factorisation is in single precision.
        np.testing.assert_allclose(getattr(found, name), exact, atol=1e-5 * np.abs(exact).max(), err_msg=name)


def test_what_no_term_sees_stays_where_it_is():
    person = random_person(3, 0)
    empty = Curvature(*(torch.zeros_like(getattr(person.curvature, name)) for name in Curvature.__dataclass_fields__))
    step = solve_border([reduce_person(empty, np.zeros((3, FRAME)), np.zeros(OWN), 0.0)], np.zeros(4), np.zeros(4))
    for values in (step.frames, step.own, step.shared):
        assert (values == 0).all()


def test_a_step_goes_down():
    person = random_person(4, 3)
    system = reduce_person(person.curvature, person.frame_gradient, person.own_gradient, DAMPING)
    step = solve_border([system], np.ones(4), np.zeros(4))
    assert (step.frames[0] * person.frame_gradient).sum() + (step.own[0] * person.own_gradient).sum() < 0


def test_single_precision_is_taken_as_it_comes():
    person = random_person(3, 1)
    single = Curvature(*(getattr(person.curvature, name).float() for name in Curvature.__dataclass_fields__))
    systems = [
        reduce_person(curvature, person.frame_gradient, person.own_gradient, DAMPING)
        for curvature in (person.curvature, single)
    ]
    exact, rounded = (solve_border([system], np.ones(4), np.zeros(4)) for system in systems)
    np.testing.assert_allclose(rounded.frames, exact.frames, atol=2e-3 * np.abs(exact.frames).max())


def test_an_indefinite_matrix_is_refused():
    person = random_person(3, 2)
    blocks = person.curvature.blocks.clone()
    blocks[1, 10, 10] = -1000
    broken = Curvature(**{**vars(person.curvature), "blocks": blocks})
    with pytest.raises(LinAlgError):
        reduce_person(broken, person.frame_gradient, person.own_gradient, DAMPING)


def test_a_matrix_with_a_nan_is_refused():
    person = random_person(3, 2)
    blocks = person.curvature.blocks.clone()
    blocks[1, 10, 10] = np.nan
    broken = Curvature(**{**vars(person.curvature), "blocks": blocks})
    with pytest.raises(LinAlgError):
        reduce_person(broken, person.frame_gradient, person.own_gradient, DAMPING)
