"""Identities that files give are kept; what nobody claims is no background."""

from dataclasses import replace

import numpy as np
import pytest

from core_solver.perception.observations import CroppedMask, FrameObservations
from core_solver.tracking import BACKGROUND, UNCLAIMED, Modalities, track_people
from tests.solver.tracking.walkers import IMAGE_SIZE, LABEL_SIZE, Walker, film, straight

LEFT = Walker(straight((150, 240), (0, 0)), clothes=0)
RIGHT = Walker(straight((450, 240), (0, 0)), clothes=1)


def track(observations: list[FrameObservations]) -> Modalities:
    return track_people(observations, IMAGE_SIZE, LABEL_SIZE)


def named(observations: list[FrameObservations], name) -> list[FrameObservations]:
    """`name(row, on_the_left)` gives each detection's identity."""
    return [
        replace(o, detections=tuple(replace(d, identity=name(row, d.box[0] < 300)) for d in o.detections))
        for row, o in enumerate(observations)
    ]


def test_a_known_person_may_jump_and_change_clothes() -> None:
    """Tracking alone would never believe it: the files say so, and are taken at their word."""
    result = track(named(film([LEFT, RIGHT], 2), lambda row, left: 7 if left == (row < 30) else 4))
    assert [t.valid.all() for t in result.tracks] == [True, True]
    for person in result.tracks:
        places = person.keypoints[:, 11, 0]
        assert np.ptp(places) > 250
        assert np.ptp(places[:30]) < 20
        assert np.ptp(places[30:]) < 20


def test_two_identities_are_not_joined_where_one_follows_the_other() -> None:
    result = track(named(film([LEFT], 2), lambda row, _left: 1 if row < 30 else 2))
    assert [int(t.valid.sum()) for t in result.tracks] == [30, 30]
    assert len(track(film([LEFT], 2)).tracks) == 1, "without identities it is one person"


def test_strangers_among_known_people_are_tracked() -> None:
    result = track(named(film([LEFT, RIGHT], 2), lambda _row, left: 3 if left else None))
    assert [t.valid.all() for t in result.tracks] == [True, True]


def test_two_known_people_in_one_place_are_two() -> None:
    """Somebody carried, or skeletons drawn to each other: tracking alone would take them for two readings of one."""
    twins = film([LEFT, replace(LEFT, clothes=1)], 2)
    assert len(track(twins).tracks) == 1, "without identities it is one person"
    numbers = iter(range(10**6))
    result = track(named(twins, lambda *_: next(numbers) % 2))
    assert [t.valid.all() for t in result.tracks] == [True, True]


def test_a_surer_reading_without_identity_does_not_displace_a_known_person() -> None:
    frames = named(film([LEFT], 2), lambda *_: 5)
    surer = [
        replace(d, identity=None, score=1.0, confidence=np.ones_like(d.confidence))
        for o in frames
        for d in o.detections
    ]
    doubled = [replace(o, detections=(*o.detections, d)) for o, d in zip(frames, surer, strict=True)]
    (person,) = track(doubled).tracks
    assert person.valid.all()
    assert person.score == pytest.approx(np.mean([o.detections[0].score for o in frames]))


def test_a_long_gap_does_not_part_a_known_person() -> None:
    hidden = replace(LEFT, seen=lambda t: not 1 < t < 6)
    (person,) = track(named(film([hidden], 7), lambda *_: 5)).tracks
    assert not person.valid[40:170].any()
    assert person.valid[:30].all()
    assert person.valid[190:].all()


def test_what_nobody_claims_is_no_background() -> None:
    frames = film([LEFT], 1)
    somewhere = CroppedMask(20, 100, np.full((30, 25), 255, np.uint8))
    frames[3] = replace(frames[3], unclaimed=(somewhere,))
    labels = track(frames).labels
    assert (labels[3, 20:50, 100:125] == UNCLAIMED).all()
    assert (labels[2, 20:50, 100:125] == BACKGROUND).all()
    assert (labels[3] == 1).sum() == (labels[2] == 1).sum(), "nobody loses their own pixels"
