"""The tree, its mirror and its levels."""

from itertools import pairwise

import pytest

from core_solver.body.skeleton import (
    JOINT_NAMES,
    KEYPOINT_MIRROR,
    KEYPOINT_NAMES,
    LEVELS,
    MIRROR,
    PARENTS,
    joint_index,
    keypoint_index,
)


def test_counts_and_order():
    assert len(JOINT_NAMES) == len(PARENTS) == len(MIRROR) == 24
    assert len(KEYPOINT_NAMES) == len(KEYPOINT_MIRROR) == 25
    assert all(parent < joint for joint, parent in enumerate(PARENTS))
    assert KEYPOINT_NAMES[:5] == ("nose", "left_eye", "right_eye", "left_ear", "right_ear")
    assert KEYPOINT_NAMES[17:] == tuple(
        f"{s}_{k}" for k in ("heel", "toe", "index", "pinky") for s in ("left", "right")
    )


@pytest.mark.parametrize(("names", "mirror"), [(JOINT_NAMES, MIRROR), (KEYPOINT_NAMES, KEYPOINT_MIRROR)])
def test_mirror_swaps_sides_and_undoes_itself(names, mirror):
    for i, name in enumerate(names):
        assert mirror[mirror[i]] == i
        assert (mirror[i] == i) == (not name.startswith(("left_", "right_")))


def test_the_mirrored_parent_is_the_parent_of_the_mirror():
    assert all(PARENTS[MIRROR[j]] == (MIRROR[p] if p >= 0 else -1) for j, p in enumerate(PARENTS))


def test_levels_cover_every_joint_once_below_its_parent():
    assert sorted(joint for level in LEVELS for joint in level) == list(range(24))
    assert len(LEVELS) == 9
    for above, level in pairwise(LEVELS):
        assert all(PARENTS[joint] in above for joint in level)


def test_lookup_by_name():
    assert joint_index("left_hand") == 22
    assert keypoint_index("right_pinky") == 24
    with pytest.raises(ValueError, match="not in tuple"):
        joint_index("tail")
