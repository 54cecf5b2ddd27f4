"""Hidden spans: what is held, and what goes smoothly from before to after."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from .people import bone_lengths, moved, stander, walker


def hidden(person: Any, start: int, end: int) -> Any:
    seen = person.evidence.seen.copy()
    seen[start:end] = False
    return replace(person, evidence=replace(person.evidence, seen=seen))


def test_hidden_spans_lie_between_seen_frames(addon: Any) -> None:
    spans = addon("clean.gaps").hidden_spans
    person = hidden(hidden(walker(addon), 20, 30), 110, 120)
    assert spans(person.evidence) == [(20, 30)]
    doubtful = np.ones(120)
    doubtful[50:55] = 0.2
    assert spans(replace(person.evidence, confidence=doubtful), 0.5) == [(20, 30), (50, 55)]


@pytest.mark.parametrize("filling", ["INBETWEEN", "HOLD"])
def test_only_the_gap_changes_and_what_was_in_it_does_not_matter(addon: Any, filling: str) -> None:
    fill = addon("clean.gaps").fill
    person = walker(addon)
    filled = fill(person, [(40, 60)], filling)
    kept = np.r_[:40, 60:120]
    np.testing.assert_allclose(filled.heads[kept], person.motion.heads[kept], atol=1e-9)
    wild = person.motion.heads.copy()
    wild[40:60] += np.random.default_rng(0).normal(size=(20, 1, 3))
    other = replace(person, motion=replace(person.motion, heads=wild))
    np.testing.assert_allclose(fill(other, [(40, 60)], filling).heads, filled.heads, atol=1e-9)
    lengths = bone_lengths(person.skeleton, filled)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(120, 0), atol=1e-9)


def test_inbetweens_begin_and_end_with_the_speed_of_the_motion(addon: Any) -> None:
    """Steadily gliding, lost for a third of a second: the ends join without a kink, the middle is near the truth."""
    person = stander(addon)
    gliding = moved(person, person.motion.times[:, None] * [0.8, -0.3, 0.0])
    filled = addon("clean.gaps").fill(gliding, [(60, 70)]).heads
    assert np.abs(filled - gliding.motion.heads).max() < 0.04
    step = np.diff(filled[:, 0], axis=0)
    assert np.linalg.norm(np.diff(step, axis=0), axis=1).max() < 0.01


def test_held_people_stand_still_until_shortly_before(addon: Any) -> None:
    person = walker(addon)
    filled = addon("clean.gaps").fill(person, [(30, 90)], "HOLD").heads
    np.testing.assert_allclose(filled[30:80], filled[29:30].repeat(50, 0), atol=1e-6)
    assert np.abs(np.diff(filled[80:92], axis=0)).max() < 0.7


def test_a_gap_of_one_frame(addon: Any) -> None:
    person = walker(addon)
    filled = addon("clean.gaps").fill(person, [(50, 51)]).heads
    assert np.abs(filled - person.motion.heads).max() < 0.03
