"""Two opinions on one person, made to agree or disagree."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.perception.blazepose import MIRRORED, MIRRORED_COCO, BodyLandmarks
from core_solver.perception.fusion import blended_keypoints, fuse, warp_mask, without_doubles
from core_solver.perception.multipose import Pose
from core_solver.perception.observations import Detection
from core_solver.perception.perceive import label_size
from tests.solver.perception.people import standing_body, standing_pose

PICTURE = (800, 600)
LABELS = label_size(*PICTURE)


def test_two_networks_that_agree_give_full_confidence() -> None:
    pose = standing_pose(300, 100)
    detection = fuse(pose, standing_body(pose), PICTURE, LABELS)
    assert detection is not None
    np.testing.assert_allclose(detection.confidence, 1)
    assert detection.score == pose.score
    assert np.all(detection.box[:2] <= detection.keypoints.min(axis=0))
    assert np.all(detection.box[2:] >= detection.keypoints.max(axis=0))
    assert np.linalg.norm(detection.appearance) == pytest.approx(1, abs=1e-5)


def test_a_disputed_wrist_casts_doubt_on_its_hand_only() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[9] += (80, 0)  # left wrist
    _, confidence = blended_keypoints(pose, body, PICTURE)
    doubted = [9, 21, 23]
    assert confidence[doubted].max() < 0.1
    assert np.delete(confidence, doubted).min() > 0.99


def test_small_differences_are_averaged_and_hands_move_with_wrists() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[[9, 21, 23]] += (8, 0)
    keypoints, confidence = blended_keypoints(pose, body, PICTURE)
    moved = body.keypoints - keypoints
    assert 2 < moved[9, 0] < 6
    np.testing.assert_allclose(moved[[21, 23]], moved[[9, 9]], atol=1e-4)
    assert confidence[9] > 0.99
    np.testing.assert_allclose(np.delete(moved, [9, 21, 23], axis=0), 0, atol=1e-4)


def test_a_disputed_point_is_not_dragged_halfway() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[9] += (120, 0)
    keypoints, _ = blended_keypoints(pose, body, PICTURE)
    np.testing.assert_allclose(keypoints[9], body.keypoints[9], atol=1)


def test_what_movenet_did_not_see_is_not_disputed() -> None:
    pose = standing_pose(300, 100)
    pose.confidence[9] = 0
    body = standing_body(pose)
    body.keypoints[9] += (80, 0)
    assert blended_keypoints(pose, body, PICTURE)[1][9] == 1


def test_keypoints_outside_the_picture_were_not_seen() -> None:
    pose = standing_pose(10, 100)
    body = standing_body(pose)
    outside = body.keypoints[:, 0] < 0
    assert outside.any()
    np.testing.assert_array_equal(blended_keypoints(pose, body, PICTURE)[1] == 0, outside)


def spoiled(body: BodyLandmarks) -> list[BodyLandmarks]:
    """Answers that do not mean this person."""
    return [
        replace(body, keypoints=body.keypoints + np.float32([90, 0])),
        replace(body, presence=0.1),
        replace(body, mask=np.zeros((256, 256), np.float32)),
    ]


def test_without_a_second_opinion_an_unsure_find_is_nobody() -> None:
    pose = standing_pose(300, 100, 0.2)
    assert all(fuse(pose, body, PICTURE, LABELS) is None for body in spoiled(standing_body(pose)))


def test_a_sure_find_stands_alone_without_landmarks_hands_and_feet() -> None:
    pose = standing_pose(300, 100, 0.4)
    for body in spoiled(standing_body(pose)):
        detection = fuse(pose, body, PICTURE, LABELS)
        assert detection is not None
        np.testing.assert_allclose(detection.keypoints[:17], pose.keypoints)
        np.testing.assert_allclose(detection.confidence[:17], pose.confidence)
        assert not detection.confidence[17:].any()
        assert np.isnan(detection.landmarks).all()
        assert detection.mask.values.size == 0


def test_someone_without_a_mask_who_stands_on_the_joints_of_two_others_is_a_mixture() -> None:
    left, right = seen(standing_pose(250, 100, 0.6), standing_pose(440, 100, 0.5))
    pose = standing_pose(250, 100, 0.3)
    pose.keypoints[1::2] = standing_pose(440, 100).keypoints[1::2]
    mixture = fuse(pose, replace(standing_body(pose), presence=0.1), PICTURE, LABELS)
    assert mixture is not None
    assert without_doubles([left, mixture, right], LABELS) == (left, right)
    pose = standing_pose(345, 100, 0.3)
    behind = fuse(pose, replace(standing_body(pose), presence=0.1), PICTURE, LABELS)
    assert behind is not None
    assert without_doubles([left, behind, right], LABELS) == (left, right, behind)


def test_someone_taken_from_behind_stays_but_in_doubt() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[:17] = pose.keypoints[MIRRORED_COCO]
    detection = fuse(pose, body, PICTURE, LABELS)
    assert detection is not None
    assert detection.confidence[[5, 6, 7, 8, 9, 10]].max() < 0.2


@pytest.mark.parametrize(("x", "y"), [(300.0, 100.0), (20.0, 100.0), (780.0, 350.0)])
def test_mask_lies_on_the_label_grid_where_the_person_is(x: float, y: float) -> None:
    pose = standing_pose(x, y)
    mask = warp_mask(standing_body(pose), PICTURE, LABELS)
    scale = LABELS[0] / PICTURE[0]
    left, top, right, bottom = np.clip(pose.box, 0, np.tile(PICTURE, 2)) * scale
    assert mask.left == pytest.approx(left, abs=2)
    assert mask.top == pytest.approx(top, abs=2)
    assert mask.left + mask.values.shape[1] == pytest.approx(right, abs=2)
    assert mask.top + mask.values.shape[0] == pytest.approx(bottom, abs=2)
    assert np.median(mask.values) == 255
    assert mask.left + mask.values.shape[1] <= LABELS[0]
    assert mask.top + mask.values.shape[0] <= LABELS[1]


def test_a_neighbour_in_the_crop_is_left_out_of_the_mask() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    alone = warp_mask(body, PICTURE, LABELS)
    body.mask[60:200, 5:25] = 1
    together = warp_mask(body, PICTURE, LABELS)
    np.testing.assert_array_equal(alone.values, together.values)
    assert (alone.left, alone.top) == (together.left, together.top)


def seen(*poses: Pose) -> list[Detection]:
    detections = [fuse(pose, standing_body(pose), PICTURE, LABELS) for pose in poses]
    return [d for d in detections if d is not None]


def test_two_finds_that_become_the_same_person_are_one() -> None:
    detections = seen(standing_pose(300, 100, 0.3), standing_pose(303, 100, 0.6), standing_pose(500, 100, 0.4))
    assert [d.score for d in without_doubles(detections, LABELS)] == [0.6, 0.4]


def test_someone_found_twice_with_sides_exchanged_is_one() -> None:
    (sure,) = seen(standing_pose(300, 100, 0.6))
    swapped = replace(sure, keypoints=sure.keypoints[MIRRORED], score=0.3)
    assert without_doubles([swapped, sure], LABELS) == (sure,)


def test_a_mixture_of_two_neighbours_is_left_out_but_an_occluded_person_stays() -> None:
    left, right = seen(standing_pose(250, 100, 0.6), standing_pose(440, 100, 0.5))
    (mixture,) = seen(standing_pose(345, 100, 0.3))
    assert without_doubles([left, mixture, right], LABELS) == (left, right)
    (behind,) = seen(standing_pose(345, 100, 0.3))
    assert without_doubles([left, behind], LABELS) == (left, behind)


def test_label_grid_keeps_the_pictures_shape() -> None:
    assert label_size(1920, 1080) == (384, 216)
    assert label_size(1088, 1920) == (218, 384)
    assert label_size(100, 80) == (100, 80)
