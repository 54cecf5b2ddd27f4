"""Crops, their way back to the picture, and what the real network says about known people."""

import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.body.skeleton import KEYPOINT_NAMES
from core_solver.errors import ModelError
from core_solver.perception.blazepose import (
    KEYPOINT_FROM_LANDMARK,
    MIRRORED,
    MIRRORED_COCO,
    BlazePose,
    Roi,
    cut,
    disagreement,
    inverse,
    other_rois,
    roi_from_points,
    roi_from_pose,
    transform,
    warp,
    with_sides_exchanged,
)
from core_solver.perception.multipose import MultiPose
from tests.solver.perception.people import first_frame, standing_body, standing_pose

# BlazePose's documented landmark names.
LANDMARKS = (
    "nose", "left_eye_inner", "left_eye", "left_eye_outer", "right_eye_inner", "right_eye", "right_eye_outer",
    "left_ear", "right_ear", "mouth_left", "mouth_right", "left_shoulder", "right_shoulder", "left_elbow",
    "right_elbow", "left_wrist", "right_wrist", "left_pinky", "right_pinky", "left_index", "right_index",
    "left_thumb", "right_thumb", "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "left_heel", "right_heel", "left_toe", "right_toe",
)  # fmt: skip

rois = st.builds(
    lambda x, y, size, angle: Roi(np.float32([x, y]), size, angle),
    st.floats(-200, 2000), st.floats(-200, 2000), st.floats(20, 3000), st.floats(-3.2, 3.2),
)  # fmt: skip


def test_each_keypoint_is_the_landmark_of_its_name() -> None:
    assert tuple(LANDMARKS[i] for i in KEYPOINT_FROM_LANDMARK) == KEYPOINT_NAMES


def test_mirroring_swaps_left_and_right() -> None:
    swapped = [KEYPOINT_NAMES[i] for i in MIRRORED]
    expected = [n.replace("left", "?").replace("right", "left").replace("?", "right") for n in KEYPOINT_NAMES]
    assert swapped == expected


@given(rois)
def test_crop_maps_its_centre_and_its_size(roi: Roi) -> None:
    corners = transform(roi.crop_to_image(), np.array([[128, 128], [0, 0], [256, 0]], float))
    np.testing.assert_allclose(corners[0], roi.center, atol=1e-3)
    assert np.linalg.norm(corners[2] - corners[1]) == pytest.approx(roi.size, rel=1e-6)


@given(rois, st.floats(-500, 500), st.floats(-500, 500))
def test_inverse_undoes_a_crop(roi: Roi, x: float, y: float) -> None:
    point = np.array([[x, y]])
    there = transform(roi.crop_to_image(), point)
    np.testing.assert_allclose(transform(inverse(roi.crop_to_image()), there), point, atol=1e-4)


@given(st.floats(-0.9, 0.9), st.floats(200, 900), st.floats(100, 300))
def test_first_crop_is_upright_around_the_hips_and_holds_everyone(turn: float, x: float, y: float) -> None:
    pose = standing_pose(x, y, turn=turn)
    roi = roi_from_pose(pose)
    assert roi.angle == pytest.approx(turn, abs=1e-3)
    np.testing.assert_allclose(roi.center, pose.keypoints[[11, 12]].mean(axis=0), atol=1e-2)
    in_crop = transform(inverse(roi.crop_to_image()), pose.keypoints)
    assert in_crop.min() > 10
    assert in_crop.max() < 246


def test_without_a_torso_the_crop_is_the_box() -> None:
    pose = standing_pose(300, 100)
    pose.confidence[[5, 6]] = 0
    roi = roi_from_pose(pose)
    assert roi.angle == 0
    np.testing.assert_allclose(roi.center, pose.box.reshape(2, 2).mean(axis=0), atol=1e-3)


def test_next_crop_follows_the_two_extra_landmarks() -> None:
    points = np.zeros((39, 5), np.float32)
    points[33, :2], points[34, :2] = (100, 140), (150, 140)  # the person's "up" is the picture's right
    roi = roi_from_points(points, Roi(np.float32([512, 512]), 512.0, 0.0))
    np.testing.assert_allclose(roi.center, [456, 536])
    assert roi.angle == pytest.approx(np.pi / 2)
    assert roi.size == pytest.approx(2 * 1.25 * 100)


@pytest.mark.parametrize(("size", "angle"), [(60.0, 0.0), (256.0, 0.7), (700.0, -0.4), (1500.0, 2.0)])
def test_a_dot_lies_in_the_crop_where_the_map_says(size: float, angle: float) -> None:
    picture = np.zeros((1200, 1000, 3), np.uint8)
    dot = np.array([[420.5, 610.5]])
    radius = max(size / 60, 1.5)
    cv2.circle(picture, (420, 610), round(radius), (255, 255, 255), -1)
    roi = Roi((dot[0] + (0.2 * size, -0.15 * size)).astype(np.float32), size, angle)
    crop = cut(picture, roi)[..., 0].astype(float)
    rows, columns = np.mgrid[:256, :256] + 0.5
    found = [np.average(columns, weights=crop), np.average(rows, weights=crop)]
    np.testing.assert_allclose(found, transform(inverse(roi.crop_to_image()), dot)[0], atol=0.35)


def test_a_crop_outside_the_picture_is_black() -> None:
    picture = np.full((100, 100, 3), 255, np.uint8)
    for size in (50.0, 2000.0):
        assert cut(picture, Roi(np.float32([-3000, 50]), size, 0.3)).max() == 0


def test_warping_by_whole_pixels_is_a_shift() -> None:
    picture = np.arange(48, dtype=np.float32).reshape(6, 8)
    moved = warp(picture, np.array([[1.0, 0, 2], [0, 1, 1]]), (4, 3))
    np.testing.assert_array_equal(moved, picture[1:4, 2:6])


def test_disagreement_is_a_share_of_the_persons_size() -> None:
    pose = standing_pose(300, 100)
    size = float(np.max(pose.box[2:] - pose.box[:2]))
    body = standing_body(pose)
    assert disagreement(pose, body) == pytest.approx(0, abs=1e-6)
    body.keypoints[:, 0] += 0.1 * size
    assert disagreement(pose, body) == pytest.approx(0.1, rel=1e-4)


def test_someone_taken_from_behind_agrees_when_mirrored() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[:17] = pose.keypoints[MIRRORED_COCO]
    assert disagreement(pose, body, mirrored=True) == pytest.approx(0, abs=1e-6)
    assert disagreement(pose, body) > 0.05


def test_exchanging_sides_makes_the_mirrored_person_agree() -> None:
    pose = standing_pose(300, 100)
    body = standing_body(pose)
    body.keypoints[:17] = pose.keypoints[MIRRORED_COCO]
    assert disagreement(pose, with_sides_exchanged(body)) == pytest.approx(0, abs=1e-6)


@given(rois)
def test_other_crops_differ_and_turn_leaning_people_less(roi: Roi) -> None:
    points = np.zeros((39, 5), np.float32)
    points[33, :2], points[34, :2] = (128, 128), (128, 60)
    others = other_rois(roi, points)
    assert all((o.size, o.angle) != (roi.size, roi.angle) for o in others[:-2])
    if abs(roi.angle) > 0.45:
        assert all(abs(o.angle) < abs(roi.angle) for o in others[:3])


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "pose.tflite"
    path.write_bytes(b"nothing")
    with pytest.raises(ModelError, match="fetch it again"):
        BlazePose(path)


@pytest.mark.models
def test_loading_greets_nobody(models, capfd) -> None:
    BlazePose(models.require("blazepose-full"))
    os.write(2, b"still there")
    assert capfd.readouterr() == ("", "still there")


@pytest.mark.models
def test_the_real_network_agrees_with_movenet_and_knows_the_cameras_axes(models) -> None:
    picture = first_frame(models)
    network = BlazePose(models.require("blazepose-full"))
    poses = MultiPose(models.require("movenet-multipose"))(picture)
    for pose in poses:
        body = network(picture, pose)
        assert body.presence > 0.9
        assert disagreement(pose, body) < 0.04
        assert body.mask.min() >= 0
        assert body.mask.max() <= 1
        hips = body.landmarks[[11, 12]].mean(axis=0)
        np.testing.assert_allclose(hips, 0, atol=1e-5)
        # In metres and turned back to the camera's axes: the head is up (-y), along the picture's own direction.
        pixels = body.keypoints[0] - body.keypoints[[11, 12]].mean(axis=0)
        metres = body.landmarks[0]
        assert 0.4 < np.linalg.norm(metres) < 0.9
        assert np.dot(pixels, metres[:2]) / np.linalg.norm(pixels) / np.linalg.norm(metres[:2]) > 0.97


@pytest.mark.models
def test_a_tilted_picture_gives_tilted_landmarks(models) -> None:
    """Turning the picture turns pixels and metres alike, depth excepted."""
    picture = first_frame(models)[200:1300, 100:800]
    network = BlazePose(models.require("blazepose-full"))
    people = MultiPose(models.require("movenet-multipose"))
    quarter = np.ascontiguousarray(np.rot90(picture))  # counterclockwise
    upright = network(picture, max(people(picture), key=lambda p: p.score))
    turned = network(quarter, turned_pose(max(people(picture), key=lambda p: p.score), picture.shape[1]))
    x, y, z = upright.landmarks.T
    np.testing.assert_allclose(turned.landmarks, np.stack([y, -x, z], axis=1), atol=0.08)


def turned_pose(pose, width: int):
    """The same pose in a picture turned counterclockwise by a quarter."""
    x, y = pose.keypoints.T
    keypoints = np.stack([y, width - x], axis=1)
    left, top, right, bottom = pose.box
    box = np.float32([top, width - right, bottom, width - left])
    return type(pose)(pose.score, box, keypoints, pose.confidence)
