import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.scene.median import StreamingMedian


def median_of(values: np.ndarray, known: np.ndarray, most: int) -> np.ndarray:
    stream = StreamingMedian(values.shape[1:], most)
    for value, mask in zip(values, known, strict=True):
        stream.add(value, mask)
    return stream.result()


@given(st.integers(0, 2**32 - 1), st.integers(1, 20), st.floats(0, 1))
def test_exact_while_everything_fits(seed, count, share):
    rng = np.random.default_rng(seed)
    values, known = rng.normal(size=(count, 3, 4)).astype(np.float32), rng.random((count, 3, 4)) < share
    found = median_of(values, known, 22)
    for row, column in np.ndindex(3, 4):
        seen = values[known[:, row, column], row, column]
        if len(seen):
            assert found[row, column] == pytest.approx(np.median(seen), rel=1e-6)
        else:
            assert np.isnan(found[row, column])


@pytest.mark.parametrize("count", [16, 17, 100, 1000])
def test_what_is_kept_of_a_long_stream_is_spread_over_all_of_it(count):
    """Of a steadily rising value the median is the middle of the clip, wherever the pixel was hidden or not."""
    values = np.arange(count, dtype=np.float32)[:, None, None] * np.ones((1, 2))
    known = np.ones((count, 1, 2), bool)
    known[::3, 0, 1] = False
    found = median_of(values, known, 16)
    # At least 8 are kept: the middle is found within about one of their gaps.
    assert np.abs(found / (count - 1) - 0.5).max() < 0.13


def test_a_long_noisy_stream_is_met_to_a_fraction_of_its_noise():
    rng = np.random.default_rng(0)
    values = rng.normal(size=(700, 20, 30)).astype(np.float32)
    found = median_of(values, np.ones(values.shape, bool), 128)
    assert found.std() < 1.25 / np.sqrt(64) * 1.15


def test_memory_does_not_grow_with_the_stream():
    def peak(count: int) -> int:
        tracemalloc.start()
        stream, picture, known = StreamingMedian((40, 50), 32), np.zeros((40, 50)), np.ones((40, 50), bool)
        for _ in range(count):
            stream.add(picture, known)
        stream.result()
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    assert peak(1000) < 1.05 * peak(64)


def test_an_odd_number_of_places_is_refused():
    with pytest.raises(ValueError, match="even"):
        StreamingMedian((2, 2), 7)
