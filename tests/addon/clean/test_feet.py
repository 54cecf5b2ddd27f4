"""Feet that stand: smoothing, locking, snapping and drift on walkers whose truth is known."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.errors import UserError

from .people import bone_lengths, moved, performance, skate, sole_ends, stander, trembling, walker


def test_a_walker_who_is_right_stays_as_is(addon: Any) -> None:
    person = walker(addon)
    assert skate(addon, person, person.motion).max() < 1e-9
    locked = addon("clean.foot_lock").lock_feet(person)
    assert locked.left_alone == 0
    np.testing.assert_allclose(locked.motion.heads, person.motion.heads, atol=1e-6)
    np.testing.assert_allclose(locked.motion.rotations, person.motion.rotations, atol=1e-5)


@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 10_000), angle=st.floats(0.0, 0.02), way=st.floats(0.0, 0.01), blend=st.floats(0.0, 0.3))
def test_locked_feet_are_still(addon: Any, seed: int, angle: float, way: float, blend: float) -> None:
    person = trembling(addon, walker(addon), angle, way, seed)
    motion = addon("clean.foot_lock").lock_feet(person, blend).motion
    assert skate(addon, person, motion).max() < 0.001
    lengths = [bone_lengths(person.skeleton, m) for m in (motion, person.motion)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=1e-9)
    hips = person.skeleton.index("hips")
    assert np.linalg.norm(motion.heads[:, hips] - person.motion.heads[:, hips], axis=-1).max() < 0.1
    upper = person.skeleton.index("left_hand")
    np.testing.assert_allclose(motion.rotations[:, upper], person.motion.rotations[:, upper])


def test_a_locked_foot_stands_where_it_stood_on_average(addon: Any) -> None:
    person = trembling(addon, stander(addon), 0.0, 0.01, 3)
    motion = addon("clean.foot_lock").lock_feet(person).motion
    before, after = (sole_ends(addon, person, m) for m in (person.motion, motion))
    assert np.abs(after.mean(axis=1) - np.median(before, axis=1)).max() < 0.002
    assert skate(addon, person, person.motion).mean() > 0.01


def test_a_rolling_foot_still_rolls(addon: Any) -> None:
    """The foot pitches about its ball; only the slip is taken out."""
    person = walker(addon)
    noisy = trembling(addon, person, 0.03, 0.0, 5)
    motion = addon("clean.foot_lock").lock_feet(noisy).motion
    foot = person.skeleton.index("left_foot")
    np.testing.assert_allclose(motion.rotations[:, foot], noisy.motion.rotations[:, foot], atol=1e-9)


def test_feet_that_walk_in_a_contact_are_left_alone(addon: Any) -> None:
    person = walker(addon)
    wrong = performance(addon, person, person.motion, np.ones_like(person.evidence.contacts))
    locked = addon("clean.foot_lock").lock_feet(wrong)
    assert locked.left_alone == 2
    np.testing.assert_allclose(locked.motion.heads, person.motion.heads, atol=1e-6)


def test_a_leg_that_is_too_short_takes_the_hips_down(addon: Any) -> None:
    high = moved(walker(addon), np.tile([0.0, 0.0, 0.12], (120, 1)))
    ground = addon("retarget.ground").Ground.flat()
    motion = addon("clean.snapping").snap_to_ground(high, ground)
    lowest = sole_ends(addon, high, motion)[..., 2].min(axis=-1)
    assert np.abs(lowest[high.evidence.contacts.T >= 0.5]).max() < 0.005


def test_legs_that_are_not_known_are_refused(addon: Any) -> None:
    person = walker(addon)
    bones = tuple(pair for pair in person.bone_map.bones if pair[0] != "left_shin")
    without = type(person)(person.name, person.skeleton, type(person.bone_map)(bones), person.motion, person.evidence)
    with pytest.raises(UserError, match="Bone Map"):
        addon("clean.foot_lock").lock_feet(without)


# --- smoothing ---


def test_smoothing_takes_tremble_out_and_has_no_lag(addon: Any) -> None:
    truth = walker(addon, frames=240)
    noisy = trembling(addon, truth, 0.02, 0.005, 1)
    smooth = addon("clean.smoothing").smooth(noisy, 4.0)
    hand = truth.skeleton.index("left_hand")
    error = [np.linalg.norm(m.heads[5:-5] - truth.motion.heads[5:-5], axis=-1).mean() for m in (smooth, noisy.motion)]
    assert error[0] < 0.6 * error[1]
    jerk = [np.abs(np.diff(m.heads[:, hand], 3, axis=0)).mean() for m in (smooth, noisy.motion)]
    assert jerk[0] < 0.2 * jerk[1]
    swing = (m.heads[:, hand, 1] - m.heads[:, truth.skeleton.index("hips"), 1] for m in (smooth, truth.motion))
    assert _lag(*swing) == 0
    assert skate(addon, truth, smooth).max() < 0.001


def test_smoothing_without_contacts_lets_feet_go(addon: Any) -> None:
    person = walker(addon)
    smooth = addon("clean.smoothing").smooth
    assert skate(addon, person, smooth(person, 2.0, keep_contacts=False)).max() > 0.005
    kept = smooth(person, 2.0)
    assert skate(addon, person, kept).max() < 0.001
    before, after = (sole_ends(addon, person, m) for m in (person.motion, kept))
    stands = person.evidence.contacts.T >= 0.5
    assert np.linalg.norm((after - before).mean(axis=2)[stands], axis=-1).mean() < 0.02


def _lag(first: np.ndarray, second: np.ndarray) -> int:
    """Frames by which the first curve is later, by the peak of the cross-correlation."""
    first, second = first - first.mean(), second - second.mean()
    return int(np.correlate(first, second, "full").argmax()) - (len(first) - 1)


# --- snapping ---


@pytest.mark.parametrize("off", [0.05, -0.08])
def test_standing_feet_come_onto_stairs(addon: Any, off: float) -> None:
    """A tread below each footprint; the person climbs too high or too low, and smoothly instead of by steps."""
    tread, rise = 0.55, 0.15
    person = walker(addon, frames=150)
    soles = sole_ends(addon, person, person.motion).mean(axis=2)
    ahead = -soles[..., 1]
    phase = np.median((ahead % tread)[person.evidence.contacts.T >= 0.5])
    edges = phase - tread / 2

    def height(y: np.ndarray) -> np.ndarray:
        return rise * np.floor((-y - edges) / tread)

    way = -person.motion.heads[:, person.skeleton.index("hips"), 1]
    climbing = moved(person, np.outer(rise * ((way - edges) / tread - 0.5) + off, [0.0, 0.0, 1.0]))
    rng = np.random.default_rng(0)
    xy = rng.uniform([-1.0, -4.5], [2.0, 1.5], (150_000, 2))
    points = np.column_stack([xy, height(xy[:, 1])]) + 0.008 * rng.normal(size=(150_000, 3))
    ground = addon("retarget.ground").Ground.from_points(points)
    motion = addon("clean.snapping").snap_to_ground(climbing, ground)
    stands = person.evidence.contacts.T >= 0.5
    after = sole_ends(addon, person, motion)
    above = after[..., 2].min(axis=-1) - height(after[..., 1].mean(axis=-1))
    assert np.abs(above[stands]).max() < 0.015
    before = sole_ends(addon, person, climbing.motion)
    assert np.abs(before[..., 2].min(axis=-1) - height(before[..., 1].mean(axis=-1)))[stands].max() > 0.05
    hips = motion.heads[:, person.skeleton.index("hips"), 2]
    assert np.abs(np.diff(hips, 2)).max() < 0.02


def test_nobody_sinks(addon: Any) -> None:
    sunk = moved(walker(addon), np.tile([0.0, 0.0, -0.3], (120, 1)))
    motion = addon("clean.snapping").snap_to_ground(sunk, addon("retarget.ground").Ground.flat())
    assert sole_ends(addon, sunk, motion)[..., 2].min() > -1e-6
    assert motion.heads[..., 2].min() > -0.02


# --- drift ---


def test_a_creeping_stander_is_held_and_a_walk_is_left(addon: Any) -> None:
    remove = addon("clean.drift").remove_drift
    person = stander(addon)
    time = person.motion.times[:, None]
    creeping = moved(person, time * [0.03, -0.02, 0.01])
    still = remove(creeping).heads
    assert np.ptp(still[8:-8], axis=0).max() < 0.01
    np.testing.assert_allclose(still.mean(axis=0), creeping.motion.heads.mean(axis=0), atol=0.01)
    walking = walker(addon)
    np.testing.assert_allclose(remove(walking).heads, walking.motion.heads, atol=0.02)


def test_standers_come_level_with_the_ground(addon: Any) -> None:
    person = stander(addon)
    time = person.motion.times[:, None]
    rising = moved(person, time * [0.0, 0.0, 0.05])
    level = addon("clean.drift").remove_drift(rising, addon("retarget.ground").Ground.flat())
    assert np.abs(sole_ends(addon, person, level)[:, 10:-10, :, 2]).max() < 0.02
