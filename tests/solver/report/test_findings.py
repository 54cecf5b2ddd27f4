"""Sentences about takes whose faults were put there."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.report.evidence import Reprojection
from core_solver.report.findings import Finding, find_all, runs
from core_solver.report.measures import ground_frame, measure_person
from tests.solver.preview.takes import make_take

FRAMES = 50


def take_of(frames=FRAMES, **changes):
    """One person who stands still, with changes."""
    take = make_take(frames=frames)
    person = replace(take.people[0], gamma=np.tile(take.people[0].gamma[:1], (frames, 1)), valid=np.ones(frames, bool))
    camera = replace(take.meta.camera, source="file lens.json")
    meta = replace(take.meta, warnings=(), depth_source="network.onnx", camera=camera)
    return replace(take, meta=meta, people=(replace(person, **changes),))


def findings_of(take, reprojection=None) -> list[Finding]:
    ground = ground_frame(take)
    measures = [measure_person(person, take.meta.joint_names, ground) for person in take.people]
    return list(find_all(take, measures, reprojection))


def seen_in(*frames: range) -> np.ndarray:
    valid = np.zeros(FRAMES, bool)
    for some in frames:
        valid[list(some)] = True
    return valid


def test_a_faultless_take_has_no_findings():
    assert findings_of(take_of()) == []


def test_hidden_frames_are_named_as_in_the_video():
    take = take_of(valid=seen_in(range(20), range(30, 50)))
    assert findings_of(take) == [
        Finding("Person 1 is hidden in frames 20-29: the motion there is filled in.", 0, ((20, 29),))
    ]
    later = replace(take, meta=replace(take.meta, first_frame=100, frame_step=2))
    (finding,) = findings_of(later)
    assert "frames 140-158" in finding.text
    assert finding.spans == ((20, 29),)


def test_before_after_and_never():
    before, after = findings_of(take_of(valid=seen_in(range(5, 40))))
    assert before == Finding("Person 1 is not seen before frame 5.", 0, ((0, 4),))
    assert after == Finding("Person 1 is not seen after frame 39.", 0, ((40, 49),))
    (never,) = findings_of(take_of(valid=seen_in()))
    assert "never seen" in never.text


def test_many_gaps_are_summed_up():
    valid = np.ones(FRAMES, bool)
    valid[[3, 10, 11, 20, 21, 22, 30, 31, 32, 33, 40]] = False
    (finding,) = findings_of(take_of(valid=valid))
    assert "frames 10-11, 20-22, 30-33 and 2 shorter stretches" in finding.text
    assert len(finding.spans) == 5


def test_sliding_feet_with_their_frames_and_size():
    take = take_of()
    gamma, contacts = take.people[0].gamma.copy(), np.ones((FRAMES, 2), np.float32)
    gamma[:, 0] += np.float32(0.012) * np.clip(np.arange(FRAMES) - 9, 0, 15).astype(np.float32)
    (finding,) = findings_of(take_of(gamma=gamma, contacts=contacts))
    assert finding == Finding("The feet of Person 1 slide 12 mm a frame in frames 10-24.", 0, ((10, 24),))
    assert findings_of(take_of(gamma=gamma)) == []  # nobody claims that they rest
    gamma[:, 2] += np.float32(0.02) * np.clip(np.arange(FRAMES) - 39, 0, 5).astype(np.float32)
    (finding,) = findings_of(take_of(gamma=gamma, contacts=contacts))
    assert finding.text == "The feet of Person 1 slide up to 20 mm a frame in frames 10-24 and 40-44."
    assert finding.spans == ((10, 24), (40, 44))


def test_bodies_in_the_ground():
    take = take_of()
    gamma = take.people[0].gamma.copy()
    gamma[20:30, 1] += 0.2  # the camera's y axis points down
    (finding,) = findings_of(take_of(gamma=gamma))
    assert "sinks up to 20 cm below the ground plane in frames 20-29" in finding.text


def test_jumps():
    take = take_of()
    gamma = take.people[0].gamma.copy()
    gamma[25:, 0] += 2
    (finding,) = findings_of(take_of(gamma=gamma))
    assert finding == Finding("Person 1 jumps by up to 2.0 m at frame 25.", 0, ((25, 25),))


def test_poor_confidence():
    confidence = np.ones((FRAMES, 24), np.float32)
    confidence[12:20] = 0.1
    (finding,) = findings_of(take_of(confidence=confidence))
    assert "seen poorly in frames 12-19" in finding.text


def test_a_single_poor_frame_is_noise():
    confidence = np.ones((FRAMES, 24), np.float32)
    confidence[12] = 0.1
    assert findings_of(take_of(confidence=confidence)) == []


def test_bodies_off_the_picture():
    pixels, sizes = np.full((1, FRAMES), 3.0), np.full((1, FRAMES), 200.0)
    pixels[0, 30:40] = 41
    pixels[0, 5:8] = np.nan
    (finding,) = findings_of(take_of(), Reprojection(pixels, sizes))
    assert "up to 41 pixels off what was seen in frames 30-39" in finding.text


@pytest.mark.parametrize(("height", "word"), [(0.5, "small"), (2.6, "tall"), (1.2, None)])
def test_unusual_sizes(height, word):
    found = findings_of(take_of(height_m=height))
    assert [f"unusually {word}" in f.text for f in found] == ([True] if word else [])


def test_assumptions_are_told_once():
    take = take_of()
    assumed = replace(take.meta, camera=replace(take.meta.camera, source="assumed field of view"))
    (finding,) = findings_of(replace(take, meta=assumed))
    assert "field of view is an assumption" in finding.text
    told = replace(assumed, warnings=("The field of view is an assumption: all distances scale with it.",))
    assert len(findings_of(replace(take, meta=told))) == 1


def test_names_with_braces_are_names():
    (finding,) = findings_of(take_of(name="{frames} {0}", valid=seen_in(range(20), range(30, 50))))
    assert finding.text.startswith("{frames} {0} is hidden in frames 20-29")


@given(st.lists(st.booleans(), max_size=40), st.integers(0, 4), st.integers(1, 5))
def test_runs_cover_what_is_true_and_close_small_gaps(mask, bridge, shortest):
    array = np.array(mask, bool)
    found = runs(array, bridge)
    covered = {f for a, b in found for f in range(a, b + 1)}
    assert set(np.flatnonzero(array).tolist()) <= covered
    assert all(array[a] and array[b] for a, b in found)
    assert all(later[0] - earlier[1] - 1 > bridge for earlier, later in pairwise(found))
    longer = runs(array, bridge, shortest)
    assert longer == [(a, b) for a, b in found if array[a : b + 1].sum() >= shortest]
