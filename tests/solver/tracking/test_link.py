import time as clock
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.tracking import Modalities, describe_left_out, track_people
from tests.solver.tracking.walkers import (
    IMAGE_SIZE,
    LABEL_SIZE,
    Walker,
    detection_of,
    film,
    straight,
    walker_of,
    with_detections,
)


def track(observations, **options) -> Modalities:
    return track_people(observations, IMAGE_SIZE, LABEL_SIZE, **options)


def identities(result: Modalities, walkers) -> list[set[int]]:
    """For each track the walkers it follows in its valid frames."""
    return [
        {walker_of(t.keypoints[row], result.times[row], walkers) for row in np.flatnonzero(t.valid)}
        for t in result.tracks
    ]


def assert_everyone_has_one_track(result: Modalities, walkers) -> None:
    followed = identities(result, walkers)
    assert all(len(who) == 1 for who in followed), followed
    assert sorted(next(iter(who)) for who in followed) == list(range(len(walkers)))


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("clothes", [(0, 1), (0, 0)])
def test_people_who_cross_keep_their_ids(rate, clothes):
    walkers = [
        Walker(straight((100, 240), (90, 0)), clothes=clothes[0]),
        Walker(straight((500, 255), (-90, 0)), clothes=clothes[1], height=126),
    ]
    assert_everyone_has_one_track(track(film(walkers, 5, rate)), walkers)


@pytest.mark.parametrize("rate", [10.0, 30.0, 60.0])
@pytest.mark.parametrize("clothes", [(0, 1), (0, 0)])
def test_an_occlusion_of_one_and_a_half_seconds_does_not_break_a_track(rate, clothes):
    in_front = Walker(straight((320, 250), (5, 0)), height=160, clothes=clothes[0])
    behind = Walker(straight((140, 240), (80, 0)), clothes=clothes[1], seen=lambda t: not 1.5 < t < 3.0)
    result = track(film([in_front, behind], 5, rate))
    assert_everyone_has_one_track(result, [in_front, behind])
    hidden = (result.times > 1.5) & (result.times < 3.0)
    passing = next(t for t in result.tracks if not t.valid.all())
    assert not passing.valid[hidden].any()
    assert passing.valid[~hidden].all()
    assert np.all(passing.confidence[hidden] == 0)
    truth = np.stack([behind.keypoints(t) for t in result.times])
    torso = [5, 6, 11, 12]
    error = np.linalg.norm(passing.keypoints[:, torso] - truth[:, torso], axis=-1)
    assert error[hidden].max() < 0.12 * behind.height


def test_both_vanish_while_they_cross_and_come_back_as_themselves():
    def apart(t):
        return not 1.6 < t < 2.6

    walkers = [
        Walker(straight((130, 240), (90, 0)), seen=apart),
        Walker(straight((510, 242), (-90, 0)), seen=apart, height=122),
    ]
    assert_everyone_has_one_track(track(film(walkers, 4.2)), walkers)


def test_late_entrance_and_early_leaving():
    walkers = [
        Walker(straight((80, 240), (60, 0)), seen=lambda t: t < 2),
        Walker(straight((560, 320), (-60, 0)), seen=lambda t: t >= 2.5),
    ]
    result = track(film(walkers, 5))
    assert_everyone_has_one_track(result, walkers)
    assert [t.id for t in result.tracks] == [1, 2]
    leaver, entrant = result.tracks
    assert leaver.valid[:60].all()
    assert not leaver.valid[60:].any()
    assert not entrant.valid[:75].any()
    np.testing.assert_array_equal(leaver.keypoints[60:], np.broadcast_to(leaver.keypoints[59], (90, 25, 2)))
    np.testing.assert_array_equal(entrant.keypoints[:75], np.broadcast_to(entrant.keypoints[75], (75, 25, 2)))


def test_a_person_who_left_is_not_the_next_who_enters_elsewhere():
    walkers = [
        Walker(straight((80, 240), (0, 0)), seen=lambda t: t < 2),
        Walker(straight((480, 240), (0, 0)), seen=lambda t: t >= 2.5),
    ]
    assert_everyone_has_one_track(track(film(walkers, 5)), walkers)


def test_ids_follow_first_appearance_then_left_to_right():
    walkers = [
        Walker(straight((500, 240), (0, 0)), clothes=1),
        Walker(straight((100, 240), (0, 0)), clothes=2),
        Walker(straight((300, 240), (0, 0)), clothes=3, seen=lambda t: t > 1),
    ]
    result = track(film(walkers, 3))
    assert [t.id for t in result.tracks] == [1, 2, 3]
    assert identities(result, walkers) == [{1}, {0}, {2}]


def test_flickering_detections_and_heavy_noise():
    rng = np.random.default_rng(1)
    walkers = [Walker(straight((100 + 130 * i, 240), (25, 0)), clothes=i) for i in range(4)]
    frames = [with_detections(f, [d for d in f.detections if rng.random() > 0.3]) for f in film(walkers, 4, noise=0.03)]
    assert_everyone_has_one_track(track(frames), walkers)


def test_a_jump_upwards_stays_one_person():
    def leap(t):
        height = 60 * max(0.0, 1 - ((t - 1.5) / 0.3) ** 2)
        return (320.0, 300 - height)

    walkers = [Walker(leap)]
    result = track(film(walkers, 3))
    assert_everyone_has_one_track(result, walkers)
    assert result.tracks[0].valid.all()


def test_duplicates_are_one_person():
    rng = np.random.default_rng(3)
    walkers = [Walker(straight((100, 240), (60, 0))), Walker(straight((160, 240), (60, 0)), clothes=1)]
    frames = []
    for f in film(walkers, 3):
        again = [replace(detection_of(w, f.frame.time, rng, 0.015), score=0.5) for w in walkers]
        frames.append(with_detections(f, [*again, *f.detections]))
    result = track(frames)
    assert_everyone_has_one_track(result, walkers)
    assert all(t.valid.all() for t in result.tracks)
    assert all(t.score == pytest.approx(0.8) for t in result.tracks)


def test_false_people_are_rejected():
    rng = np.random.default_rng(5)
    walker = Walker(straight((100, 240), (60, 0)))
    coat_stand = Walker(straight((500, 240), (0, 0)), score=0.25)
    frames = []
    for f in film([walker], 4):
        spot = (float(rng.uniform(60, 580)), float(rng.uniform(100, 380)))
        flicker = [detection_of(Walker(straight(spot, (0, 0)), height=90), 0, rng)] if rng.random() < 0.15 else []
        frames.append(with_detections(f, [*f.detections, detection_of(coat_stand, f.frame.time, rng, 0.005), *flicker]))
    assert_everyone_has_one_track(track(frames), [walker])


def test_a_sure_person_who_stands_still_is_kept():
    walkers = [Walker(straight((320, 240), (0, 0)))]
    assert len(track(film(walkers, 3, noise=0.002)).tracks) == 1


@pytest.mark.parametrize(
    ("seen_frames", "total", "kept"), [(7, 60, False), (8, 60, True), (19, 200, False), (20, 200, True)]
)
def test_people_seen_too_briefly_are_left_out_and_named(seen_frames, total, kept):
    brief = Walker(straight((480, 240), (0, 0)), clothes=1, seen=lambda t: 10 <= round(t * 30) < 10 + seen_frames)
    walkers = [Walker(straight((100, 240), (10, 0))), brief]
    result = track(film(walkers, total / 30))
    assert len(result.tracks) == (2 if kept else 1)
    assert len(result.dropped) == (0 if kept else 1)
    if not kept:
        left_out = result.dropped[0]
        assert (left_out.first_frame, left_out.frame_count) == (10, seen_frames)
        assert left_out.position == pytest.approx((480, 240), abs=12)
        (sentence,) = describe_left_out(result.dropped)
        assert f"seen in {seen_frames} frames, {seen_frames + 1} are needed" in sentence


def test_people_keeps_the_best_seen():
    walkers = [
        Walker(straight((100, 240), (0, 0)), height=60),
        Walker(straight((300, 240), (0, 0)), height=150, clothes=1),
        Walker(straight((500, 240), (0, 0)), height=150, clothes=2, seen=lambda t: t > 1.5),
    ]
    result = track(film(walkers, 3), people=1)
    assert identities(result, walkers) == [{1}]
    assert [t.id for t in result.tracks] == [1]
    assert len(result.dropped) == 2
    assert all("seen better" in sentence for sentence in describe_left_out(result.dropped))


def test_nobody_at_all():
    result = track(film([], 1))
    assert result.tracks == ()
    assert result.dropped == ()
    assert result.labels.shape == (30, 120, 160)
    assert not result.labels.any()


def test_one_frame():
    walkers = [Walker(straight((320, 240), (0, 0)))]
    result = track(film(walkers, 1 / 30))
    assert [t.id for t in result.tracks] == [1]
    assert result.tracks[0].keypoints.shape == (1, 25, 2)


def test_rows_keep_the_video_s_frame_numbers_and_times():
    walkers = [Walker(straight((100, 240), (50, 0)), seen=lambda t: t > 0.5)]
    frames = [replace(f, frame=replace(f.frame, index=100 + 3 * i)) for i, f in enumerate(film(walkers, 2))]
    result = track(frames)
    np.testing.assert_array_equal(result.frames, 100 + 3 * np.arange(60))
    np.testing.assert_allclose(result.times, np.arange(60) / 30)
    assert not result.tracks[0].valid[:15].any()
    assert result.disparity is None


def test_disparity_is_stacked():
    frames = [replace(f, disparity=np.full((3, 4), i, np.float16)) for i, f in enumerate(film([], 0.2))]
    disparity = track(frames).disparity
    assert disparity is not None
    np.testing.assert_array_equal(disparity[:, 0, 0], np.arange(6))


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000))
def test_the_order_of_detections_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    walkers = [
        Walker(straight((100, 240), (90, 0))),
        Walker(straight((500, 250), (-90, 0)), height=124),
        Walker(straight((300, 200), (0, 20)), clothes=2, seen=lambda t: t > 1),
    ]
    frames = film(walkers, 2.5, rate=15, noise=0.02)
    shuffled = [with_detections(f, [f.detections[i] for i in rng.permutation(len(f.detections))]) for f in frames]
    expected, found = track(frames), track(shuffled)
    assert expected.dropped == found.dropped
    np.testing.assert_array_equal(expected.labels, found.labels)
    for a, b in zip(expected.tracks, found.tracks, strict=True):
        assert (a.id, a.score) == (b.id, b.score)
        for name in ("valid", "keypoints", "confidence", "landmarks"):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name))


@pytest.mark.slow
def test_three_thousand_frames_of_eight_people_take_seconds():
    walkers = [Walker(straight((60 + 75 * i, 200 + 10 * i), (0.3 * i, 0)), height=80, clothes=i) for i in range(8)]
    frames = film(walkers, 100)
    start = clock.perf_counter()
    result = track(frames)
    assert clock.perf_counter() - start < 60
    assert_everyone_has_one_track(result, walkers)
