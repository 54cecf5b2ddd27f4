"""The add-on's own mathematics, without a scene."""

from fractions import Fraction
from typing import Any

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

quaternion_tracks = arrays(float, (9, 2, 4), elements=st.floats(-1, 1))
rates = st.fractions(Fraction(1, 10), Fraction(1000), max_denominator=1001)


@given(track=quaternion_tracks)
def test_flips_vanish_and_rotations_stay(track: np.ndarray, addon: Any) -> None:
    smooth = addon("scene_import.motion").without_flips(track)
    assert np.array_equal(np.abs(smooth), np.abs(track))
    same = np.all(smooth == track, axis=-1) | np.all(smooth == -track, axis=-1)
    assert same.all()
    assert (np.sum(smooth[1:] * smooth[:-1], axis=-1) >= 0).all()
    assert np.array_equal(smooth[0], track[0])


@given(rate=rates)
def test_blenders_two_numbers_are_the_rate(rate: Fraction, addon: Any) -> None:
    fps, base = addon("scene_import.timing").split_rate(rate)
    assert fps >= 1
    # Blender keeps the base in single precision.
    assert abs(fps / float(np.float32(base)) / float(rate) - 1) < 1e-7
