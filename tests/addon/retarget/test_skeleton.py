"""Pose channels against Blender's own evaluation, and round trips without it."""

from typing import Any

import numpy as np
import pytest

from core_solver.geometry import Similarity, matrix_from_rotvec


def skeleton_of(addon: Any, seed: int = 0, scale: float = 0.01) -> Any:
    """Five bones with arbitrary rolls, one of which does not turn with its parent; a second root."""
    rng = np.random.default_rng(seed)
    axes = matrix_from_rotvec(rng.normal(size=(5, 3)))
    to_world = Similarity(matrix_from_rotvec(rng.normal(size=3)), rng.normal(size=3), scale)
    return addon("retarget.skeleton").Skeleton(
        names=("a", "b", "c", "d", "e"),
        parents=(-1, 0, 1, 0, -1),
        heads=rng.normal(size=(5, 3)),
        axes=axes,
        lengths=np.full(5, 0.3),
        to_world=to_world,
        turns_with_parent=np.array([True, True, False, True, True]),
    )


@pytest.mark.parametrize("seed", range(4))
def test_channels_and_pose_are_inverse(addon: Any, seed: int) -> None:
    module = addon("retarget.skeleton")
    skeleton = skeleton_of(addon, seed)
    rng = np.random.default_rng(seed + 10)
    turns = matrix_from_rotvec(rng.normal(size=(7, 5, 3)))
    locations = rng.normal(size=(7, 5, 3)) * 100
    motion = module.pose(skeleton, np.arange(7.0), turns, locations)
    channels = module.channels_of(skeleton, motion)
    np.testing.assert_allclose(matrices(channels.quaternions), turns, atol=1e-9)
    np.testing.assert_allclose(channels.locations, locations, atol=1e-9)
    again = module.pose(skeleton, np.arange(7.0), matrices(channels.quaternions), channels.locations)
    np.testing.assert_allclose(again.heads, motion.heads, atol=1e-9)
    np.testing.assert_allclose(again.rotations, motion.rotations, atol=1e-9)


def test_bones_that_only_turn_keep_their_distance_to_the_parent(addon: Any) -> None:
    module = addon("retarget.skeleton")
    skeleton = skeleton_of(addon)
    rotations = matrix_from_rotvec(np.random.default_rng(3).normal(size=(6, 5, 3)))
    motion = module.place(skeleton, np.arange(6.0), rotations, np.zeros((6, 5, 3)))
    at_rest = np.linalg.norm(skeleton.heads[2] - skeleton.heads[1])
    np.testing.assert_allclose(np.linalg.norm(motion.heads[:, 2] - motion.heads[:, 1], axis=-1), at_rest)
    assert np.abs(module.channels_of(skeleton, motion).locations).max() < 1e-9


def matrices(quaternions: np.ndarray) -> np.ndarray:
    """Rotation matrices by the textbook's formula."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array([[np.asarray(v) for v in row] for row in rows]), (0, 1), (-2, -1))


def test_a_bone_leads_to_what_hangs_on_its_end(addon: Any) -> None:
    """Fingers say where a forearm goes, a bone that only twists it does not; with neither it is its own tail."""
    forearm, twist, finger, thumb = [0.0, 0, 0], [0.1, 0, 0], [0.25, 0.02, 0], [0.25, -0.02, 0]
    for heads, parents, end in (
        ([forearm, twist, finger, thumb], (-1, 0, 0, 0), [0.25, 0, 0]),
        ([forearm, twist], (-1, 0), [0, 0.3, 0]),
        ([forearm], (-1,), [0, 0.3, 0]),
    ):
        count = len(heads)
        skeleton = addon("retarget.skeleton").Skeleton(
            names=tuple("abcd"[:count]),
            parents=parents,
            heads=np.array(heads),
            axes=np.tile(np.eye(3), (count, 1, 1)),
            lengths=np.full(count, 0.3 if count < 4 else 0.01),
            to_world=Similarity(np.eye(3), np.zeros(3)),
            turns_with_parent=np.ones(count, bool),
        )
        np.testing.assert_allclose(skeleton.end(0), end, atol=1e-12)
