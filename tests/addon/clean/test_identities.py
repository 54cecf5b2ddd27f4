"""Swapping, merging and splitting people whose true motion is known."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError
from tests.addon.retarget.skeletons import make_person, walk

from .people import moved, performance, sole_ends, walker

CUT = 50


def two(addon: Any) -> tuple[Any, Any]:
    """Somebody and somebody smaller beside, on other ways."""
    first = walker(addon)
    rig = make_person(addon, 0.8)
    motion, contacts = walk(addon, rig, 120, heading=1.0)
    second = moved(performance(addon, rig, motion, contacts), np.tile([1.0, 0.5, 0.0], (120, 1)))
    return replace(first, name="First"), replace(second, name="Second")


def hips(person: Any) -> np.ndarray:
    return person.motion.heads[:, person.skeleton.index("hips")]


def test_swapped_people_go_on_in_each_others_place(addon: Any) -> None:
    first, second = two(addon)
    new_first, new_second = addon("clean.identities").swapped(first, second, CUT)
    after = slice(CUT + 5, None)
    for new, old, other in ((new_first, first, second), (new_second, second, first)):
        np.testing.assert_allclose(new.motion.heads[: CUT - 5], old.motion.heads[: CUT - 5], atol=1e-9)
        np.testing.assert_allclose(hips(new)[after, :2], hips(other)[after, :2], atol=1e-9)
        soles = [sole_ends(addon, p, p.motion)[:, after, :, 2].min(axis=(0, 2)) for p in (new, other)]
        np.testing.assert_allclose(*soles, atol=1e-9)
        np.testing.assert_array_equal(new.evidence.contacts[after], other.evidence.contacts[after])
        foot = new.skeleton.index("left_foot")
        lengths = np.linalg.norm(np.diff(new.motion.heads[:, [foot, new.skeleton.parents[foot]]], axis=1), axis=-1)
        np.testing.assert_allclose(lengths, lengths[:1].repeat(120, 0), atol=1e-9)


def test_swapping_twice_is_nothing_but_the_seam(addon: Any) -> None:
    first, second = two(addon)
    swapped = addon("clean.identities").swapped
    again, _ = swapped(*swapped(first, second, CUT), CUT)
    outside = np.r_[: CUT - 5, CUT + 5 : 120]
    np.testing.assert_allclose(again.motion.heads[outside], first.motion.heads[outside], atol=1e-6)


def test_a_split_person_merges_again(addon: Any) -> None:
    module = addon("clean.identities")
    person = walker(addon)
    before, after = module.split(person, CUT)
    assert before.evidence.present.sum() == CUT
    assert after.evidence.present.sum() == 120 - CUT
    np.testing.assert_array_equal(before.motion.heads[CUT:], before.motion.heads[[CUT - 1]].repeat(70, 0))
    np.testing.assert_array_equal(after.motion.heads[:CUT], after.motion.heads[[CUT]].repeat(CUT, 0))
    whole = module.merged(before, after)
    assert whole.evidence.present.all()
    assert np.abs(whole.motion.heads - person.motion.heads).max() < 0.08
    outside = np.r_[: CUT - 5, CUT + 5 : 120]
    np.testing.assert_allclose(whole.motion.heads[outside], person.motion.heads[outside], atol=1e-6)


def test_a_swap_puts_a_split_right(addon: Any) -> None:
    module = addon("clean.identities")
    person = walker(addon)
    before, after = module.split(person, CUT)
    nobody, whole = module.swapped(after, before, CUT)
    assert whole.evidence.present.all()
    assert not nobody.evidence.present.any()
    outside = np.r_[: CUT - 5, CUT + 5 : 120]
    np.testing.assert_allclose(whole.motion.heads[outside], person.motion.heads[outside], atol=1e-6)
    for change in (module.swapped, module.merged):
        with pytest.raises(UserError, match="never there"):
            change(whole, nobody, CUT)


def test_what_nobody_saw_between_two_parts_is_filled(addon: Any) -> None:
    module = addon("clean.identities")
    person = walker(addon)
    before, after = module.split(person, 40)[0], module.split(person, 70)[1]
    whole = module.merged(before, after)
    assert whole.evidence.present.all()
    np.testing.assert_array_equal(whole.evidence.seen, np.r_[np.ones(40), np.zeros(30), np.ones(50)].astype(bool))
    assert np.linalg.norm(np.diff(hips(whole), axis=0), axis=1).max() < 0.12
    with pytest.raises(UserError, match="who is there first"):
        module.merged(after, before)


def test_other_bones_and_places_outside_are_refused(addon: Any) -> None:
    module = addon("clean.identities")
    first, second = two(addon)
    names = tuple(name.upper() for name in second.skeleton.names)
    with pytest.raises(UserError, match="other bones"):
        module.swapped(first, replace(second, skeleton=replace(second.skeleton, names=names)), CUT)
    for cut in (0, 120, -3):
        with pytest.raises(UserError, match="inside the take"):
            module.split(first, cut)
