"""What streets do to a tracker: everybody is one track, and nobody else is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from core_solver.perception.observations import CroppedMask, FrameObservations
from core_solver.tracking import Modalities, track_people
from tests.solver.tracking.walkers import (
    IMAGE_SIZE,
    LABEL_SIZE,
    Walker,
    clothes_vector,
    detection_of,
    film,
    straight,
    walker_of,
    with_detections,
)


def track(observations: Sequence[FrameObservations]) -> Modalities:
    return track_people(observations, IMAGE_SIZE, LABEL_SIZE)


def assert_everyone_has_one_track(result: Modalities, walkers: Sequence[Walker]) -> None:
    followed = [
        {walker_of(t.keypoints[row], result.times[row], walkers) for row in np.flatnonzero(t.valid)}
        for t in result.tracks
    ]
    assert all(len(who) == 1 for who in followed), followed
    assert sorted(next(iter(who)) for who in followed) == list(range(len(walkers)))


@pytest.mark.parametrize("rate", [10.0, 30.0])
@pytest.mark.parametrize("clothes", [(0, 1), (0, 0)])
def test_an_occlusion_of_two_seconds(rate: float, clothes: tuple[int, int]) -> None:
    walkers = [
        Walker(straight((320, 250), (0, 0)), height=160, clothes=clothes[0]),
        Walker(straight((120, 240), (70, 0)), clothes=clothes[1], seen=lambda t: not 1.6 < t < 3.6),
    ]
    assert_everyone_has_one_track(track(film(walkers, 5.5, rate)), walkers)


def test_somebody_who_stands_behind_a_sign_for_five_seconds() -> None:
    walkers = [
        Walker(straight((300, 240), (0, 0)), seen=lambda t: not 2 < t < 7),
        Walker(straight((100, 300), (40, 0)), clothes=1),
    ]
    assert_everyone_has_one_track(track(film(walkers, 9, 10)), walkers)


def leaving_and_returning(t: float) -> tuple[float, float]:
    """Out through the right side of the picture, and in again seconds later a little lower."""
    return (500 + 50 * t, 240.0) if t < 5 else (1060 - 50 * t, 250.0)


COMES_BACK = Walker(leaving_and_returning, clothes=2, seen=lambda t: t < 2.2 or t > 9.2)
PASSER_BY = Walker(straight((100, 240), (10, 0)), clothes=0)


def test_somebody_who_leaves_and_comes_back_in_the_same_clothes_is_known_again() -> None:
    walkers = [COMES_BACK, PASSER_BY]
    assert_everyone_has_one_track(track(film(walkers, 12, 10)), walkers)


def test_somebody_may_come_and_go_twice() -> None:
    def path(t: float) -> tuple[float, float]:
        return leaving_and_returning(t) if t < 10 else leaving_and_returning(t - 8.8)

    walker = Walker(path, clothes=2, seen=lambda t: t < 2.2 or 9.2 < t < 11.0 or t > 18.0)
    walkers = [walker, replace(PASSER_BY, path=straight((100, 240), (5, 0)))]
    assert_everyone_has_one_track(track(film(walkers, 20, 10)), walkers)


def test_somebody_in_other_clothes_is_somebody_else() -> None:
    """Whoever leaves and whoever comes have the same path, but not the same clothes."""
    leaver = replace(COMES_BACK, seen=lambda t: t < 2.2)
    comer = replace(COMES_BACK, clothes=1, seen=lambda t: t > 9.2)
    result = track(film([leaver, comer, PASSER_BY], 12, 10))
    assert len(result.tracks) == 3


def test_of_two_dressed_alike_nobody_can_say_who_came_back() -> None:
    twin = Walker(straight((490, 350), (56, 0)), clothes=2, seen=lambda t: t < 2.2)
    result = track(film([COMES_BACK, twin, PASSER_BY], 12, 10))
    assert len(result.tracks) == 4


def test_ten_people_at_once() -> None:
    walkers = [Walker(straight((50 + 60 * i, 140 + 20 * (i % 4)), (4 - i, 0)), 90, clothes=i % 8) for i in range(10)]
    assert_everyone_has_one_track(track(film(walkers, 4, 10)), walkers)


@pytest.mark.parametrize("rate", [10.0, 30.0])
def test_people_who_touch_and_part_the_way_they_came(rate: float) -> None:
    """Nobody crosses: both stop beside each other, one behind the other, and turn back."""

    def bounce(start: float, turn: float) -> Walker:
        return Walker(lambda t: (turn + (start - turn) * abs(1 - t / 2.5), 240.0), clothes=int(start > 320))

    left, right = bounce(120, 312), bounce(520, 328)
    hidden = replace(right, seen=lambda t: not 2.2 < t < 2.8)
    assert_everyone_has_one_track(track(film([left, hidden], 5, rate)), [left, hidden])


def without_mask(
    frames: Sequence[FrameObservations], when: tuple[float, float], near: float
) -> list[FrameObservations]:
    """The person near a column is seen without a mask for a while, in the colours of what stands in front."""
    changed = []
    for f in frames:
        hidden = [
            replace(d, mask=CroppedMask(0, 0, np.zeros((0, 0), np.uint8)), appearance=clothes_vector(7))
            if when[0] < f.frame.time < when[1] and abs(d.box[[0, 2]].mean() - near) < 60
            else d
            for d in f.detections
        ]
        changed.append(with_detections(f, hidden))
    return changed


def test_looks_behind_an_obstacle_do_not_break_a_track() -> None:
    walkers = [Walker(straight((200, 240), (40, 0))), Walker(straight((500, 240), (0, 5)), clothes=1)]
    frames = without_mask(film(walkers, 5, 10), (1.5, 3.5), 300)
    result = track(frames)
    assert_everyone_has_one_track(result, walkers)
    assert all(t.valid.all() for t in result.tracks)


def test_landmarks_nobody_has_seen_are_taken_from_before_and_after() -> None:
    walkers = [Walker(straight((200, 240), (40, 0)))]
    frames = [
        with_detections(f, [replace(d, landmarks=np.full_like(d.landmarks, np.nan)) for d in f.detections])
        if 1 < f.frame.time < 2
        else f
        for f in film(walkers, 3, 10)
    ]
    (found,) = track(frames).tracks
    np.testing.assert_allclose(found.landmarks, np.broadcast_to(found.landmarks[0], found.landmarks.shape), atol=1e-6)


def test_the_kind_of_the_landmarks_follows_the_person() -> None:
    """Regressed poses in the first second only, one of them without landmarks, and nobody seen in a gap after it."""

    def of_kind(frame: FrameObservations) -> FrameObservations:
        early = frame.frame.time < 1
        seen = [replace(d, regressed=early) for d in frame.detections]
        if frame.frame.index == 4:
            seen = [replace(d, landmarks=np.full_like(d.landmarks, np.nan), regressed=False) for d in seen]
        return with_detections(frame, [] if 9 < frame.frame.index < 16 else seen)

    (found,) = track([of_kind(f) for f in film([Walker(straight((200, 240), (40, 0)))], 3, 10)]).tracks
    assert found.regressed is not None
    assert found.regressed.tolist() == [True] * 13 + [False] * 17


def test_brief_people_count_by_seconds_and_size() -> None:
    """Of a minute 1.5 s are enough for somebody tall, and a tenth of it for somebody small."""
    walkers = [
        Walker(straight((100, 240), (5, 0))),
        Walker(straight((300, 240), (20, 0)), clothes=1, seen=lambda t: 10 < t < 12),
        Walker(straight((450, 240), (20, 0)), 40, clothes=2, seen=lambda t: 10 < t < 12),
        Walker(straight((550, 240), (20, 0)), clothes=3, seen=lambda t: 10 < t < 11),
    ]
    result = track(film(walkers, 60, 10))
    assert len(result.tracks) == 2
    assert sorted((d.frame_count, d.needed) for d in result.dropped) == [(9, 60), (19, 60)]


@pytest.mark.parametrize("score", [0.25, 0.45])
def test_a_sign_that_never_moves_is_nobody(score: float) -> None:
    """However sure a detector may be: somebody alive moves within seconds, if only a hand."""
    rng = np.random.default_rng(2)
    sign = Walker(straight((500, 240), (0, 0)), height=90, score=score, clothes=3)
    walker = Walker(straight((100, 240), (40, 0)))
    still = sign.keypoints(0.25)
    frames = []
    for f in film([walker], 6, 10):
        seen = detection_of(sign, 0.25, rng, 0.0)
        jitter = rng.normal(0, 0.003 * sign.height, (25, 2))
        frames.append(with_detections(f, [*f.detections, replace(seen, keypoints=(still + jitter).astype(np.float32))]))
    assert_everyone_has_one_track(track(frames), [walker])


def test_a_reflection_that_moves_with_somebody_is_nobody() -> None:
    """In a wet street somebody hangs head down from everybody's feet, paler than they are."""
    walker = Walker(straight((100, 300), (40, 0)), height=160, score=0.7)
    rng = np.random.default_rng(4)
    frames = []
    for f in film([walker], 5, 10):
        seen = f.detections[0]
        image = seen.keypoints.copy()
        image[:, 1] = 384 + 0.75 * (384 - image[:, 1])  # upside down, below the feet: a wet street
        image += rng.normal(0, 0.5, image.shape)
        box = np.concatenate([image.min(axis=0) - 5, image.max(axis=0) + 5]).astype(np.float32)
        frames.append(with_detections(f, [seen, replace(seen, keypoints=image, box=box, score=0.35)]))
    assert_everyone_has_one_track(track(frames), [walker])
