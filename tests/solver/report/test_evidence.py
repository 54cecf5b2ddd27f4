"""Reprojection error against sights that are drawn at known distances from the solved joints."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.body import JOINT_NAMES, KEYPOINT_NAMES, pose_joints
from core_solver.perception.cache import write_chunk
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.report.evidence import Reprojection, measure_reprojection, read_reprojection
from tests.solver.preview.takes import make_take, project_by_hand

FRAMES = 6
LIMBS = [name for name in KEYPOINT_NAMES if name in JOINT_NAMES and "head" not in name]


def sight(take, index, frame, offset=(0.0, 0.0), confidence=1.0) -> Detection:
    """What a perfect network would see of a person, moved by an offset in pixels."""
    person = take.people[index]
    joints = person.scale * pose_joints(person.theta[frame], person.rest_joints)[1] + person.gamma[frame]
    keypoints = np.zeros((25, 2), np.float32)
    for name in LIMBS:
        u, v = project_by_hand(joints[JOINT_NAMES.index(name)], take.meta.camera)
        keypoints[KEYPOINT_NAMES.index(name)] = u + offset[0], v + offset[1]
    return Detection(
        score=0.9,
        box=np.zeros(4, np.float32),
        keypoints=keypoints,
        confidence=np.full(25, confidence, np.float32),
        landmarks=np.zeros((25, 3), np.float32),
        appearance=np.zeros(36, np.float32),
        mask=CroppedMask(0, 0, np.zeros((1, 1), np.uint8)),
    )


def seen(frame_number, *detections) -> FrameObservations:
    return FrameObservations(FrameInfo(frame_number, frame_number / 25), detections, None)


def everybody_seen(**changes):
    take = make_take(frames=FRAMES)
    return replace(take, people=tuple(replace(p, valid=np.ones(FRAMES, bool), **changes) for p in take.people))


def test_the_limbs_are_twelve():
    assert len(LIMBS) == 12


def test_the_error_is_the_distance():
    take = everybody_seen()
    observations = [seen(f, sight(take, 0, f, (3, 4)), sight(take, 1, f, (0, -2))) for f in range(FRAMES)]
    result = measure_reprojection(take, observations)
    assert isinstance(result, Reprojection)
    np.testing.assert_allclose(result.pixels, [[5.0] * FRAMES, [2.0] * FRAMES], atol=1e-3)
    assert (result.sizes > 40).all()


def test_sights_of_a_shaken_video_are_compared_where_the_takes_camera_saw_them():
    """Frame f shows everything f pixels to the right; without its maps that would be the error."""
    maps = np.array([[[1, 0, -f], [0, 1, 0], [0, 0, 1]] for f in range(FRAMES)], float)
    take = everybody_seen()
    observations = [seen(f, sight(take, 0, f, (f, 2)), sight(take, 1, f, (f, 0))) for f in range(FRAMES)]
    result = measure_reprojection(replace(take, steadying=maps), observations)
    assert isinstance(result, Reprojection)
    np.testing.assert_allclose(result.pixels, [[2.0] * FRAMES, [0.0] * FRAMES], atol=1e-3)


def test_the_order_of_sights_means_nothing():
    take = everybody_seen()
    result = measure_reprojection(take, [seen(0, sight(take, 1, 0, (0, 1)), sight(take, 0, 0, (2, 0)))])
    assert isinstance(result, Reprojection)
    np.testing.assert_allclose(result.pixels[:, 0], [2.0, 1.0], atol=1e-3)


def test_nobody_gets_the_sight_of_somebody_else():
    take = everybody_seen()
    result = measure_reprojection(take, [seen(0, sight(take, 0, 0, (1, 0))), seen(1, sight(take, 1, 1, (400, 0)))])
    assert isinstance(result, Reprojection)
    assert result.pixels[0, 0] == pytest.approx(1, abs=1e-3)
    assert np.isnan(result.pixels[1, 0])
    assert np.isnan(result.pixels[:, 1:]).all()


def test_unsure_keypoints_count_less_and_unseen_ones_not_at_all():
    take = everybody_seen()
    one = sight(take, 0, 0)
    keypoints, confidence = one.keypoints.copy(), one.confidence.copy()
    wrist, ankle = KEYPOINT_NAMES.index("left_wrist"), KEYPOINT_NAMES.index("right_ankle")
    keypoints[wrist] += 1000
    confidence[wrist] = 0.05
    keypoints[ankle, 0] += 21
    confidence[ankle] = 0.5
    changed = replace(one, keypoints=keypoints, confidence=confidence)
    result = measure_reprojection(take, [seen(0, changed)])
    assert isinstance(result, Reprojection)
    assert result.pixels[0, 0] == pytest.approx(21 * 0.5 / (10 + 0.5), abs=1e-3)


def test_frames_without_evidence_have_no_error():
    take = make_take(frames=FRAMES)  # the second person is gone in the second half
    observations = [seen(f, sight(take, 0, f), sight(take, 1, f)) for f in range(FRAMES)]
    result = measure_reprojection(take, observations)
    assert isinstance(result, Reprojection)
    np.testing.assert_array_equal(np.isnan(result.pixels[1]), ~take.people[1].valid)


def test_frames_are_told_by_their_number():
    take = make_take(frames=FRAMES, first_frame=10, frame_step=2)
    numbers = [9, 10, 11, 12, 22]
    observations = [seen(n, sight(take, 0, max(0, min((n - 10) // 2, FRAMES - 1)))) for n in numbers]
    result = measure_reprojection(take, observations)
    assert isinstance(result, Reprojection)
    np.testing.assert_array_equal(np.flatnonzero(np.isfinite(result.pixels[0])), [0, 1])
    assert isinstance(measure_reprojection(take, [seen(9, sight(take, 0, 0))]), str)


def test_a_body_behind_the_lens_has_no_error():
    take = make_take(frames=FRAMES)
    behind = replace(take.people[0], gamma=take.people[0].gamma - np.float32([0, 0, 9]))
    result = measure_reprojection(replace(take, people=(behind,)), [seen(0, sight(take, 0, 0))])
    assert isinstance(result, Reprojection)
    assert np.isnan(result.pixels).all()


def test_what_lies_beside_the_take(tmp_path):
    take, work = everybody_seen(), tmp_path / "take.work"
    assert "does not lie beside" in str(read_reprojection(take, work))
    folder = work / "observations"
    folder.mkdir(parents=True)
    assert "not finished" in str(read_reprojection(take, work))
    (folder / "key.json").write_text(f'{{"frame_count": {FRAMES}}}')
    write_chunk(folder / "00000.npz", [seen(f, sight(take, 0, f, (0, 7))) for f in range(FRAMES)])
    result = read_reprojection(take, work)
    assert isinstance(result, Reprojection)
    np.testing.assert_allclose(result.pixels[0], 7.0, atol=1e-3)
    whole = (folder / "00000.npz").read_bytes()
    middle = len(whole) // 2
    for damaged in (b"no archive", whole[:middle], whole[:middle] + b"\0" * 200 + whole[middle + 200 :]):
        (folder / "00000.npz").write_bytes(damaged)
        assert "damaged" in str(read_reprojection(take, work))
