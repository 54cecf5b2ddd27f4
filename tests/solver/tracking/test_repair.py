from dataclasses import replace

import numpy as np

from core_solver.body.skeleton import KEYPOINT_NAMES, keypoint_index
from core_solver.tracking import track_people
from tests.solver.tracking.walkers import IMAGE_SIZE, LABEL_SIZE, Walker, film, straight, with_detections

WALKER = Walker(straight((100, 240), (60, 0)))
PAIRS = [(keypoint_index(f"left_{p}"), keypoint_index(f"right_{p}")) for p in ("hip", "knee", "ankle", "heel", "toe")]


def track_of(frames):
    return track_people(frames, IMAGE_SIZE, LABEL_SIZE).tracks[0]


def changed(frames, row, change):
    """The clip with one frame's only detection changed."""
    detection = frames[row].detections[0]
    return [*frames[:row], with_detections(frames[row], [change(detection)]), *frames[row + 1 :]]


def test_swapped_legs_of_one_frame_are_swapped_back():
    def swap(detection):
        order = np.arange(25)
        for left, right in PAIRS:
            order[[left, right]] = right, left
        return replace(detection, keypoints=detection.keypoints[order], landmarks=detection.landmarks[order])

    frames = film([WALKER], 2)
    np.testing.assert_array_equal(track_of(changed(frames, 38, swap)).keypoints, track_of(frames).keypoints)
    np.testing.assert_array_equal(track_of(changed(frames, 38, swap)).landmarks, track_of(frames).landmarks)


def test_a_keypoint_that_jumps_for_one_frame_loses_confidence_but_stays():
    wrist = keypoint_index("left_wrist")

    def jump(detection):
        keypoints = detection.keypoints.copy()
        keypoints[wrist] += (60, -40)
        return replace(detection, keypoints=keypoints)

    frames = film([WALKER], 2)
    plain, mended = track_of(frames), track_of(changed(frames, 30, jump))
    assert 0 < mended.confidence[30, wrist] < 0.2
    unchanged = np.ones((60, 25), bool)
    unchanged[30, wrist] = False
    np.testing.assert_array_equal(mended.confidence[unchanged], plain.confidence[unchanged])
    np.testing.assert_allclose(mended.keypoints[30, wrist], plain.keypoints[30, wrist] + (60, -40), atol=1e-3)


def test_steady_fast_motion_is_no_outlier():
    sprinter = Walker(straight((60, 240), (500, 0)))
    track = track_of(film([sprinter], 1, rate=30))
    assert np.all(track.confidence[track.valid] > 0.85)


def mirrored(detection):
    """The detection by a network that takes front for back: all sides exchanged."""
    order = [KEYPOINT_NAMES.index(_other(name)) for name in KEYPOINT_NAMES]
    return replace(detection, keypoints=detection.keypoints[order], landmarks=detection.landmarks[order])


def _other(name):
    side, _, part = name.partition("_")
    return {"left": "right_", "right": "left_"}[side] + part if part else name


def test_a_person_read_back_to_front_for_a_while_keeps_id_and_sides():
    frames = film([WALKER], 2)
    flipped = [with_detections(f, map(mirrored, f.detections)) if 33 <= i < 44 else f for i, f in enumerate(frames)]
    result = track_people(flipped, IMAGE_SIZE, LABEL_SIZE)
    assert len(result.tracks) == 1
    assert result.tracks[0].valid.all()
    upper = [keypoint_index(f"{side}_{part}") for side in ("left", "right") for part in ("shoulder", "elbow", "wrist")]
    np.testing.assert_array_equal(result.tracks[0].keypoints[:, upper], track_of(frames).keypoints[:, upper])


def test_the_same_person_read_from_the_front_and_from_the_back_is_one():
    frames = [with_detections(f, [*f.detections, *map(mirrored, f.detections)]) for f in film([WALKER], 2)]
    assert len(track_people(frames, IMAGE_SIZE, LABEL_SIZE).tracks) == 1


def test_a_person_who_stays_turned_round_is_believed():
    frames = film([WALKER], 4)
    turned = [with_detections(f, map(mirrored, f.detections)) if i >= 50 else f for i, f in enumerate(frames)]
    track = track_of(turned)
    np.testing.assert_allclose(track.keypoints[60], turned[60].detections[0].keypoints)


def test_limbs_read_wrongly_around_a_torso_in_place_do_not_split_a_person():
    limbs = [i for i, name in enumerate(KEYPOINT_NAMES) if "shoulder" not in name and "hip" not in name]

    def misread(detection):
        keypoints = detection.keypoints.copy()
        keypoints[limbs] = keypoints[np.random.default_rng(0).permutation(limbs)]
        return replace(detection, keypoints=keypoints)

    frames = film([WALKER], 2)
    wrong = [with_detections(f, map(misread, f.detections)) if 30 <= i < 42 else f for i, f in enumerate(frames)]
    result = track_people(wrong, IMAGE_SIZE, LABEL_SIZE)
    assert len(result.tracks) == 1
    assert result.tracks[0].valid.all()
