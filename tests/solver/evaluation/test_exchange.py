from dataclasses import fields, replace

import numpy as np
import pytest

from core_solver.evaluation.exchange import Outcome, Problem, read_outcome, read_problem, write_outcome, write_problem
from tests.solver.evaluation.fakes import make_fake


def assert_same(first, second) -> None:
    """Two dataclasses agree in every field, arrays to the last bit and in their type."""
    for field in fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_array_equal(a, b)
            assert a.dtype == b.dtype
        elif hasattr(a, "__dataclass_fields__"):
            assert_same(a, b)
        elif isinstance(a, tuple) and a and hasattr(a[0], "__dataclass_fields__"):
            for x, y in zip(a, b, strict=True):
                assert_same(x, y)
        else:
            assert a == b, field.name


@pytest.mark.parametrize("with_depth", [True, False])
def test_a_problem_comes_back_whole(tmp_path, with_depth):
    scene = make_fake().scene
    modalities = scene.modalities if with_depth else replace(scene.modalities, disparity=None)
    camera = replace(scene.camera, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    directions = None if with_depth else np.ones((len(scene.body.template), 3, 207))
    body = replace(scene.body, pose_directions=directions)
    problem = Problem(modalities, camera, body)
    write_problem(tmp_path / "p.npz", problem)
    assert_same(problem, read_problem(tmp_path / "p.npz"))


def test_the_kind_of_the_landmarks_comes_back(tmp_path):
    fake = make_fake().scene
    kinds = [np.arange(len(t.valid)) % 3 == n for n, t in enumerate(fake.modalities.tracks)]
    tracks = tuple(replace(t, regressed=kind) for t, kind in zip(fake.modalities.tracks, kinds, strict=True))
    problem = Problem(replace(fake.modalities, tracks=tracks), fake.camera, fake.body)
    write_problem(tmp_path / "p.npz", problem)
    assert_same(problem, read_problem(tmp_path / "p.npz"))


def test_an_outcome_comes_back_whole(tmp_path):
    outcome = Outcome(make_fake().solution, 12.5, 20.5, 345.0)
    write_outcome(tmp_path / "o.npz", outcome)
    assert_same(outcome, read_outcome(tmp_path / "o.npz"))
