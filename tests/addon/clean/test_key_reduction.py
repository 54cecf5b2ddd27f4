"""Fewer keys, and the error that was promised."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from .people import stander, trembling, walker

MODES = {"quaternions": ("QUATERNION",), "mixed": ("QUATERNION", "XYZ", "AXIS_ANGLE", "ZXY")}


def off(first: Any, second: Any) -> tuple[float, float]:
    """Largest distance of joints (metres) and angle of bones (radians)."""
    distance = np.linalg.norm(first.heads - second.heads, axis=-1).max()
    cosine = (np.trace(np.swapaxes(first.rotations, -1, -2) @ second.rotations, axis1=-2, axis2=-1) - 1) / 2
    return float(distance), float(np.arccos(np.clip(cosine, -1, 1)).max())


@pytest.mark.parametrize("kind", MODES)
@settings(max_examples=5, deadline=None)
@given(
    distance=st.floats(0.0005, 0.02), angle=st.floats(0.001, 0.05), tremble=st.floats(0, 0.01), seed=st.integers(0, 99)
)
def test_the_bound_holds(addon: Any, kind: str, distance: float, angle: float, tremble: float, seed: int) -> None:
    module = addon("clean.key_reduction")
    person = trembling(addon, walker(addon, frames=60), tremble, 0.0, seed)
    bones = len(person.skeleton.names)
    modes = (MODES[kind] * bones)[:bones]
    few = module.reduce_keys(person.skeleton, person.motion, modes, module.Bound(distance, angle))
    moved, turned = off(few.motion(person.skeleton, person.motion.times), person.motion)
    assert moved <= distance
    assert turned <= angle
    assert few.keyed[[0, -1]].all()


def test_a_larger_bound_leaves_fewer_keys(addon: Any) -> None:
    module = addon("clean.key_reduction")
    person = walker(addon)
    modes = ("QUATERNION",) * len(person.skeleton.names)
    left = [
        module.reduce_keys(person.skeleton, person.motion, modes, module.Bound(distance, 0.02)).keyed.mean()
        for distance in (0.0005, 0.002, 0.01)
    ]
    assert left[0] > left[1] > left[2]
    assert left[1] < 0.4


def test_who_stands_needs_two_keys(addon: Any) -> None:
    module = addon("clean.key_reduction")
    person = stander(addon)
    modes = ("QUATERNION",) * len(person.skeleton.names)
    assert module.reduce_keys(person.skeleton, person.motion, modes, module.Bound()).keyed.sum() == 2 * len(modes)
