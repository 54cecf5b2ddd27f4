"""Filters and spans against what must come out of them."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st


@pytest.mark.parametrize(("frequency", "share"), [(0.5, 0.99), (3.0, np.sqrt(0.5)), (12.0, 0.01)])
def test_low_pass_halves_the_power_at_the_cutoff(addon: Any, frequency: float, share: float) -> None:
    time = np.arange(600) / 60.0
    wave = np.sin(2 * np.pi * frequency * time)
    smooth = addon("clean.signals").low_pass(wave[:, None], 60.0, 3.0)[100:-100, 0]
    gain = (smooth @ wave[100:-100]) / (wave[100:-100] @ wave[100:-100])
    assert gain == pytest.approx(share, abs=0.01)


@settings(max_examples=20, deadline=None)
@given(count=st.integers(1, 60), cutoff=st.floats(0.2, 14.0), slope=st.floats(-5, 5))
def test_low_pass_keeps_straight_lines_to_their_ends(addon: Any, count: int, cutoff: float, slope: float) -> None:
    line = 2.0 + slope * np.arange(count)[:, None]
    np.testing.assert_allclose(addon("clean.signals").low_pass(line, 30.0, cutoff), line, atol=1e-3)


def test_a_cutoff_above_the_frame_rate_changes_nothing(addon: Any) -> None:
    values = np.random.default_rng(0).normal(size=(50, 2))
    np.testing.assert_allclose(addon("clean.signals").low_pass(values, 10.0, 30.0), values, atol=1e-9)


def test_known_low_pass_reads_known_frames_only(addon: Any) -> None:
    low_pass = addon("clean.signals").known_low_pass
    known = np.zeros(300, bool)
    known[20:60] = known[200:240] = True
    values = np.full((300, 2), -1e6)
    values[20:60], values[200:240] = 7.0, 9.0
    found = low_pass(values, known, 30.0, 1.0)
    np.testing.assert_allclose(found[:50], 7.0, atol=1e-3)
    np.testing.assert_allclose(found[210:], 9.0, atol=1e-3)
    assert np.abs(np.diff(found, axis=0)).max() < 0.1
    np.testing.assert_array_equal(low_pass(values, np.zeros(300, bool), 30.0, 1.0), np.zeros((300, 2)))


@settings(max_examples=30, deadline=None)
@given(values=st.lists(st.floats(0, 3), min_size=1, max_size=40), radius=st.integers(1, 6))
def test_raised_is_never_below(addon: Any, values: list[float], radius: int) -> None:
    curve = addon("clean.signals").raised(np.array(values), radius)
    assert curve.shape == (len(values),)
    assert (curve >= np.array(values) - 1e-12).all()
    assert curve.max() <= max(values) + 1e-12


def test_spans_and_closed_gaps(addon: Any) -> None:
    signals = addon("clean.signals")
    flags = np.array([0, 1, 1, 0, 1, 0, 0, 0, 1, 0], bool)
    assert signals.spans(flags) == [(1, 3), (4, 5), (8, 9)]
    assert signals.spans(signals.closed(flags, 2)) == [(1, 5), (8, 9)]
    assert signals.spans(np.ones(3, bool)) == [(0, 3)]
    assert signals.spans(np.zeros(3, bool)) == []
