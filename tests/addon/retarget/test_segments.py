"""Distances between pieces of lines against a fine search, and the sizes of bodies."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from .skeletons import Build, make_rig


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), flat=st.booleans())
def test_nearest_places_are_nearest(addon: Any, seed: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    a, b, c, d = rng.normal(size=(4, 5, 3)) * ([1, 1, 0] if flat else [1, 1, 1])
    s, t = addon("retarget.segments").closest_between(a, b, c, d)
    found = np.linalg.norm(a + s[:, None] * (b - a) - c - t[:, None] * (d - c), axis=1)
    grid = np.linspace(0, 1, 101)
    first = a[:, None, None] + grid[None, :, None, None] * (b - a)[:, None, None]
    second = c[:, None, None] + grid[None, None, :, None] * (d - c)[:, None, None]
    best = np.linalg.norm(first - second, axis=-1).min(axis=(1, 2))
    assert (found <= best + 1e-9).all()
    assert (found >= best - 0.05).all()


def test_parallel_and_vanishing_lines(addon: Any) -> None:
    zero = np.zeros((1, 3))
    x, y = np.array([[1.0, 0, 0]]), np.array([[0, 1.0, 0]])
    closest = addon("retarget.segments").closest_between
    for lines in ((zero, x, y, x + y), (zero, zero, y, y), (zero, x, y, y)):
        s, t = closest(*lines)
        a, b, c, d = lines
        assert np.linalg.norm(a + s[:, None] * (b - a) - c - t[:, None] * (d - c)) == pytest.approx(1.0)


@pytest.mark.parametrize("size", [0.6, 1.0, 1.5])
def test_height_is_that_of_an_adult_of_such_joints(addon: Any, size: float) -> None:
    rig = make_rig(addon, Build(size=size))
    assert addon("retarget.segments").height(rig.skeleton, rig.bone_map) == pytest.approx(1.78 * size, rel=0.02)


def test_every_build_has_the_same_parts(addon: Any) -> None:
    module = addon("retarget.segments")
    builds = [Build(), Build(spine=1, without=("neck", "clavicle", "toe")), Build(spine=5, extras=True)]
    rigs = [make_rig(addon, build) for build in builds]
    roles = [[part.role for part in module.segments(rig.skeleton, rig.bone_map)] for rig in rigs]
    assert roles[0] == roles[1] == roles[2]
    assert len(roles[0]) == 10
