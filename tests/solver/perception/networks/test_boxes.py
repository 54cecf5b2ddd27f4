"""Boxes and their suppression."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from core_solver.perception.networks.boxes import corners_from_centres, overlaps, suppress

NUMBERS = st.floats(0, 100, width=32)


@st.composite
def scored_boxes(draw):
    count = draw(st.integers(0, 25))
    centres = draw(arrays.arrays(np.float32, (count, 4), elements=NUMBERS))
    scores = draw(arrays.arrays(np.float32, count, elements=st.floats(0, 1, width=32)))
    return corners_from_centres(centres), scores


def test_hand_computed_overlaps() -> None:
    box = np.float32([0, 0, 10, 10])
    others = np.float32([[0, 0, 10, 10], [5, 0, 15, 10], [10, 0, 20, 10], [2, 2, 4, 4], [3, 3, 3, 3]])
    np.testing.assert_allclose(overlaps(box, others), [1, 50 / 150, 0, 4 / 100, 0], rtol=1e-6)
    np.testing.assert_allclose(corners_from_centres(np.float32([[10, 20, 4, 6]])), [[8, 17, 12, 23]])


def test_the_surest_of_each_heap_stays() -> None:
    boxes = np.float32([[0, 0, 10, 10], [1, 0, 11, 10], [50, 0, 60, 10], [0, 1, 10, 11], [51, 0, 61, 10]])
    assert suppress(boxes, np.float32([0.5, 0.9, 0.6, 0.8, 0.7]), 0.5).tolist() == [1, 4]


@given(scored_boxes(), st.floats(0, 1))
def test_suppression_keeps_what_it_promises(boxes_and_scores, overlap: float) -> None:
    boxes, scores = boxes_and_scores
    kept = suppress(boxes, scores, overlap)
    assert len(set(kept.tolist())) == len(kept)
    assert (np.diff(scores[kept]) <= 0).all()
    for place, number in enumerate(kept):
        # No two kept ones overlap more than allowed.
        assert (overlaps(boxes[number], boxes[kept[place + 1 :]]) <= overlap).all()
    for dropped in set(range(len(boxes))) - set(kept.tolist()):
        # And for each dropped one a surer one is the reason.
        reasons = kept[overlaps(boxes[dropped], boxes[kept]) > overlap]
        assert scores[reasons].max() >= scores[dropped]
    assert suppress(boxes, scores, overlap).tolist() == kept.tolist()


@pytest.mark.parametrize("overlap", [0.0, 0.5])
def test_suppressing_twice_changes_nothing(overlap: float) -> None:
    rng = np.random.default_rng(1)
    boxes = corners_from_centres(rng.uniform(5, 50, (40, 4)).astype(np.float32))
    scores = rng.random(40).astype(np.float32)
    kept = suppress(boxes, scores, overlap)
    assert 1 < len(kept) < 40
    again = suppress(boxes[kept], scores[kept], overlap)
    assert again.tolist() == list(range(len(kept)))
