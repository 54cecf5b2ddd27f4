"""Reaching: where the ends come to be, by forward kinematics of the turned bones, and that nothing pops."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix

from .skeletons import UNREAL, make_rig, walk

HINT = np.array([[0.0, -1.0, 0.0]])


def limbs(addon: Any, seed: int, count: int = 50) -> Any:
    """Legs of 0.4 + 0.42 m bent in all ways, from nearly straight to folded."""
    rng = np.random.default_rng(seed)
    first = _unit(rng.normal(size=(count, 3)))
    bend = rng.uniform(0.001, 2.5, (count, 1)) * _unit(np.cross(first, rng.normal(size=(count, 3))))
    start = rng.normal(size=(count, 3))
    middle = start + 0.4 * first
    end = middle + 0.42 * np.einsum("tab,tb->ta", matrix_from_rotvec(bend), first)
    return addon("retarget.limb_ik").Limb(start, middle, end)


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10_000), far=st.floats(0.05, 0.95))
def test_goals_within_reach_are_reached_by_the_turned_bones(addon: Any, seed: int, far: float) -> None:
    limb = limbs(addon, seed)
    goal = limb.start + far * 0.82 * _unit(np.random.default_rng(seed + 1).normal(size=limb.start.shape))
    reached = addon("retarget.limb_ik").reach(limb, goal, HINT)
    knee = limb.start + np.einsum("tab,tb->ta", reached.upper, limb.middle - limb.start)
    end = knee + np.einsum("tab,tb->ta", reached.lower, limb.end - limb.middle)
    np.testing.assert_allclose(knee, reached.middle, atol=1e-9)
    np.testing.assert_allclose(end, reached.end, atol=1e-9)
    np.testing.assert_allclose(end, goal, atol=1e-9)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_a_goal_where_the_end_is_turns_nothing(addon: Any, seed: int) -> None:
    limb = limbs(addon, seed)
    reached = addon("retarget.limb_ik").reach(limb, limb.end, HINT)
    assert np.abs(rotvec_from_matrix(reached.upper)).max() < 1e-6
    assert np.abs(rotvec_from_matrix(reached.lower)).max() < 1e-6


def test_the_knee_stays_on_its_side(addon: Any) -> None:
    limb = limbs(addon, 5)
    goal = limb.start + 0.8 * (limb.end - limb.start)
    reached = addon("retarget.limb_ik").reach(limb, goal, HINT)
    normal = np.cross(limb.middle - limb.start, limb.end - limb.middle)
    after = np.cross(reached.middle - limb.start, reached.end - reached.middle)
    alike = np.sum(normal * after, axis=1) / (np.linalg.norm(normal, axis=1) * np.linalg.norm(after, axis=1))
    bent = np.linalg.norm(normal, axis=1) > 0.02
    assert alike[bent].min() > 1 - 1e-6


@pytest.mark.parametrize("straightness", [0.0, 0.0005])
def test_a_straight_leg_bends_to_the_front(addon: Any, straightness: float) -> None:
    start = np.zeros((1, 3))
    middle = np.array([[straightness, 0.0, -0.4]])
    end = np.array([[0.0, 0.0, -0.8]])
    limb = addon("retarget.limb_ik").Limb(start, middle, end)
    reached = addon("retarget.limb_ik").reach(limb, np.array([[0.0, 0.0, -0.6]]), HINT)
    assert reached.middle[0, 1] < -0.25


def test_stretching_beyond_reach_does_not_pop(addon: Any) -> None:
    """A foot that is drawn away at an even pace: knee and hip turn at most a few degrees in each step."""
    goal = np.linspace([0.0, 0.0, -0.7], [0.0, 0.0, -1.1], 200)
    shape = np.ones((len(goal), 1))
    limb = addon("retarget.limb_ik").Limb(
        0 * shape * goal[:1], shape * np.array([[0.0, -0.2, -0.35]]), shape * np.array([[0.0, 0.0, -0.7]])
    )
    reached = addon("retarget.limb_ik").reach(limb, goal, HINT)
    steps = np.linalg.norm(np.diff(reached.middle, axis=0), axis=1)
    full = 2 * np.hypot(0.2, 0.35)
    assert steps.max() < 0.012
    assert np.all(np.diff(np.linalg.norm(reached.end, axis=1)) > -1e-12)
    assert np.linalg.norm(reached.end[-1]) < full
    assert np.linalg.norm(reached.end[-1]) > 0.999 * full


def test_bending_a_leg_of_a_motion_leaves_a_pose_of_the_same_skeleton(addon: Any) -> None:
    """All bones stay as long and as joined as they were, the foot keeps its heading, and nothing else moves."""
    module, rig = addon("retarget.limb_ik"), make_rig(addon, UNREAL)
    motion, _ = walk(addon, rig, frames=20)
    chain = module.chain_of(rig.skeleton, rig.bone_map, "left", ("thigh", "shin", "foot"))
    goal = motion.heads[:, chain.end] + [0.02, 0.03, 0.06]
    after = module.bent(motion, chain, module.reach(chain.limb(motion), goal, HINT))
    np.testing.assert_allclose(after.heads[:, chain.end], goal, atol=1e-9)
    np.testing.assert_allclose(after.rotations[:, chain.end], motion.rotations[:, chain.end], atol=1e-12)
    placed = addon("retarget.skeleton").channels_of(rig.skeleton, after).locations
    before = addon("retarget.skeleton").channels_of(rig.skeleton, motion).locations
    np.testing.assert_allclose(placed, before, atol=1e-9)
    others = ~rig.skeleton.below(chain.upper)
    np.testing.assert_array_equal(after.heads[:, others], motion.heads[:, others])


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
