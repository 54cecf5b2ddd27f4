"""Standing feet found in motions that do not say."""

from typing import Any

import numpy as np
import pytest

from .skeletons import gestures, make_person, walk


@pytest.mark.parametrize("size", [0.6, 1.0, 1.5])
def test_a_walkers_steps_are_found(addon: Any, size: float) -> None:
    """The true ones are those of the walk itself; at either end of a step feet are slow already."""
    person = make_person(addon, size)
    motion, contacts = walk(addon, person, frames=150)
    found = addon("retarget.contacts").detect_contacts(person.skeleton, person.bone_map, motion)
    assert found.shape == contacts.shape
    assert np.mean(found == contacts) > 0.85
    assert np.all(found[contacts == 1].mean() > 0.95)


def test_noise_breaks_no_step_in_two(addon: Any) -> None:
    person = make_person(addon)
    motion, contacts = walk(addon, person, frames=150)
    rng = np.random.default_rng(0)
    shaken = type(motion)(motion.times, motion.rotations, motion.heads + rng.normal(scale=0.002, size=(150, 1, 3)))
    found = addon("retarget.contacts").detect_contacts(person.skeleton, person.bone_map, shaken)
    starts = [int(np.sum(np.diff(feet, axis=0) > 0)) for feet in (contacts, found)]
    assert abs(starts[0] - starts[1]) <= 1


def test_a_single_frame_stands(addon: Any) -> None:
    person = make_person(addon)
    motion = gestures(addon, person, frames=1)
    assert addon("retarget.contacts").detect_contacts(person.skeleton, person.bone_map, motion).shape == (1, 2)
