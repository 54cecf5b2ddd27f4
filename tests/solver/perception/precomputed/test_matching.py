"""Poses and masks find their people."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.perception.observations import Detection
from core_solver.perception.precomputed.join import detection_from
from core_solver.perception.precomputed.joint_tables import COCO_JOINTS, SMPL_JOINTS
from core_solver.perception.precomputed.joints import GivenPerson
from core_solver.perception.precomputed.matching import cropped, match_poses, share_masks
from tests.solver.perception.people import standing_body, standing_pose

PICTURE = (1000, 500)


def person_at(x: float, confidence: float = 0.9) -> Detection:
    body = standing_body(standing_pose(x, 50))
    made = detection_from(GivenPerson(0.8, body.keypoints, np.full(25, confidence, np.float32)), PICTURE)
    assert made is not None
    return made


def pose_of(person: Detection, off: float = 0.0) -> np.ndarray:
    pixels = np.full((24, 2), -1e4)
    pixels[SMPL_JOINTS] = person.keypoints[COCO_JOINTS] + off
    return pixels


@given(st.permutations(range(4)), st.floats(-15, 15))
@settings(deadline=None, max_examples=30)
def test_poses_in_any_order_find_their_people(order: list[int], off: float) -> None:
    people = [person_at(x) for x in (150, 300, 420, 800)]
    assert match_poses(people, [pose_of(people[i], off) for i in order]) == {p: order.index(p) for p in range(4)}


def test_the_whole_counts_and_not_each_ones_nearest() -> None:
    left, right = person_at(400), person_at(470)
    # Both poses lie nearer to the left person; together they fit best one each.
    assert match_poses([left, right], [pose_of(left, 5), pose_of(left, 30)]) == {0: 0, 1: 1}


def test_a_pose_far_from_everybody_is_nobodys() -> None:
    people = [person_at(200)]
    assert match_poses(people, [pose_of(people[0], 300)]) == {}
    assert match_poses(people, []) == {}
    assert match_poses([], [pose_of(people[0])]) == {}


def test_joints_that_are_not_confident_do_not_count() -> None:
    one = person_at(200)
    confidence = np.full(25, 0.9, np.float32)
    confidence[5:15] = 0.1
    unsure = detection_from(GivenPerson(0.8, one.keypoints, confidence), PICTURE)
    assert unsure is not None
    assert match_poses([unsure], [pose_of(one)]) == {}, "two ankles are too few"


def rectangle(left: int, right: int) -> np.ndarray:
    mask = np.zeros((50, 100), np.uint8)
    mask[4:46, left:right] = 255
    return mask


def test_masks_go_to_whose_joints_they_hold_and_else_to_nobody() -> None:
    people = [person_at(200), person_at(500)]
    torso_and_arms, hand_of_right, empty_corner = rectangle(10, 32), rectangle(40, 62), rectangle(80, 95)
    piece = np.zeros((50, 100), np.uint8)
    piece[40:50, 14:24] = 255
    shared = share_masks(people, [empty_corner, piece, hand_of_right, torso_and_arms], PICTURE)
    assert shared.owned == ((3, 1), (2,))
    assert shared.nobodys == (0,)
    assert share_masks([], [piece], PICTURE).nobodys == (0,)
    assert share_masks(people, [], PICTURE).owned == ((), ())


def test_somebody_without_a_mask_owns_none() -> None:
    shared = share_masks([person_at(200), person_at(205)], [rectangle(10, 32)], PICTURE)
    assert sorted(map(len, shared.owned)) == [0, 1]


def test_a_mask_is_cut_to_where_it_is() -> None:
    mask = cropped(rectangle(10, 32))
    assert (mask.top, mask.left, mask.values.shape) == (4, 10, (42, 22))
    assert cropped(np.zeros((5, 5), np.uint8)).values.size == 0


def test_joints_outside_the_picture_are_not_seen() -> None:
    keypoints = np.full((25, 2), 100, np.float32)
    keypoints[3] = (-5, 10)
    keypoints[4] = (1000, 10)
    made = detection_from(GivenPerson(0.5, keypoints, np.full(25, 0.9, np.float32), 3), PICTURE)
    assert made is not None
    assert (made.confidence[[3, 4]] == 0).all()
    assert (made.box >= 0).all()
    assert made.identity == 3
    assert detection_from(GivenPerson(0.5, keypoints - 500, np.full(25, 0.9, np.float32)), PICTURE) is None
