"""A bent body against finite differences, and what has to stay as it is."""

from typing import Any

import numpy as np
import pytest

from .skeletons import RIGS, Rig, gestures, make_rig


@pytest.fixture(params=["mixamo", "a pose", "unreal", "short"])
def rig(request: pytest.FixtureRequest, addon: Any) -> Rig:
    return make_rig(addon, RIGS[request.param])


def bent_at_random(addon: Any, rig: Rig, size: float) -> tuple[Any, np.ndarray]:
    style = gestures(addon, rig, frames=3, seed=2)
    body = addon("retarget.full_body_ik").body_of(rig.skeleton, rig.bone_map, style)
    changes = size * np.random.default_rng(5).normal(size=(3, body.size))
    changes[:, :3] *= 0.02
    return body, changes


def test_steps_follow_the_true_derivatives(addon: Any, rig: Rig) -> None:
    """One step for a single goal must equal damped Gauss-Newton with a numerical Jacobian."""
    module, marks = addon("retarget.full_body_ik"), addon("retarget.landmarks")
    body, changes = bent_at_random(addon, rig, 0.08)
    compared = 0
    palm = marks.palms(rig.skeleton, rig.bone_map)[1]
    heel = marks.soles(rig.skeleton, rig.bone_map)[0].heel
    for point in (palm, heel):
        place = point.positions(module.bend(body, changes))
        target = place + np.array([0.004, -0.003, 0.005])
        goal = module.Goal((point,), np.ones((1, 3)), target, np.full(3, 50.0))
        stepped = module.improve(body, changes, changes, [goal])
        for frame in range(3):
            jacobian = np.empty((3, body.size))
            for index in range(body.size):
                moved = []
                for sign in (1, -1):
                    nudged = changes.copy()
                    nudged[:, index] += sign * 1e-5
                    moved.append(point.positions(module.bend(body, nudged))[frame])
                jacobian[:, index] = (moved[0] - moved[1]) / 2e-5
            normal = 50.0 * jacobian.T @ jacobian + np.diag(body.stiffness)
            step = np.linalg.solve(normal, 50.0 * jacobian.T @ (target - place)[frame])
            if inside(body, frame, changes[frame] + step):
                np.testing.assert_allclose((stepped - changes)[frame], step, atol=2e-7)
                compared += 1
    assert compared


def inside(body: Any, frame: int, change: np.ndarray) -> bool:
    hinges = [joint for joint in body.joints if joint.hinge is not None]
    return bool(
        (np.abs(change[:2]) <= 0.006).all()
        and all(joint.least[frame] <= change[joint.first] <= joint.most[frame] for joint in hinges)
    )


def test_no_changes_is_the_given_pose(addon: Any, rig: Rig) -> None:
    body, changes = bent_at_random(addon, rig, 0.0)
    bent = addon("retarget.full_body_ik").bend(body, changes)
    np.testing.assert_allclose(bent.heads, body.style.heads, atol=1e-12)
    np.testing.assert_allclose(bent.rotations, body.style.rotations, atol=1e-12)


def test_bones_keep_their_lengths_and_feet_their_turn(addon: Any, rig: Rig) -> None:
    body, changes = bent_at_random(addon, rig, 0.3)
    bent = addon("retarget.full_body_ik").bend(body, changes)
    for bone, parent in enumerate(rig.skeleton.parents):
        if parent >= 0 and bone != body.hips:
            before, after = (np.linalg.norm(m.heads[:, bone] - m.heads[:, parent], axis=1) for m in (body.style, bent))
            np.testing.assert_allclose(after, before, atol=1e-9)
    turned = np.abs(bent.rotations - body.style.rotations).max(axis=(0, 2, 3))
    for name in ("left_foot", "right_foot"):
        assert turned[rig.skeleton.index(name)] < 1e-12
    assert turned[rig.skeleton.index("left_shin")] > 0.05


def test_a_reachable_goal_is_reached_and_an_unreachable_one_does_not_break_elbows(addon: Any, rig: Rig) -> None:
    module = addon("retarget.full_body_ik")
    body, changes = bent_at_random(addon, rig, 0.0)
    palm = addon("retarget.landmarks").palms(rig.skeleton, rig.bone_map)[0]
    shoulder = body.style.heads[:, rig.skeleton.index("left_upper_arm")]
    tall = float(np.ptp(rig.skeleton.heads[:, 2]))
    for distance, tolerance in ((0.25 * tall, 0.002), (3.0, np.inf)):
        target = shoulder + distance * np.array([0.6, -0.64, 0.48])
        goal = module.Goal((palm,), np.ones((1, 3)), target, np.full(3, 1e5))
        found = changes
        for _ in range(30):
            found = module.improve(body, found, changes, [goal])
        bent = module.bend(body, found)
        assert np.linalg.norm(palm.positions(bent) - target, axis=1).max() < tolerance
        assert np.isfinite(bent.heads).all()
        upper, fore = (bent.heads[:, rig.skeleton.index(f"left_{n}")] for n in ("forearm", "hand"))
        straight = np.linalg.norm(fore - upper, axis=1) + np.linalg.norm(upper - bent_shoulder(rig, bent), axis=1)
        assert (np.linalg.norm(fore - bent_shoulder(rig, bent), axis=1) <= straight + 1e-9).all()
        assert np.linalg.norm(bent.heads - body.style.heads, axis=2)[:, rig.skeleton.index("hips")].max() < 1.5


def bent_shoulder(rig: Rig, motion: Any) -> np.ndarray:
    return motion.heads[:, rig.skeleton.index("left_upper_arm")]
