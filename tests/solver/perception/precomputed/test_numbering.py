"""Frame numbers out of names, and which number the first frame has."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.errors import UserError
from core_solver.perception.precomputed.numbering import (
    Counting,
    agreed_first,
    check_range,
    count_from,
    frame_numbers,
)  # fmt: skip


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["img_000012.jpg", "img_000003.jpg"], [12, 3]),
        (["v2_000000000000_keypoints.json", "v2_000000000007_keypoints.json"], [0, 7]),
        (["f1-dpt_large_384.png", "f20-dpt_large_384.png"], [1, 20]),
        (["cam7_0001.png"], [1]),
        (["a/b2/5.png", "c9/6.png"], [5, 6]),
        ([], []),
    ],
)
def test_numbers_in_names(names: list[str], numbers: list[int]) -> None:
    assert frame_numbers(names) == numbers


def test_names_without_or_with_equal_numbers_are_refused() -> None:
    with pytest.raises(UserError, match=r"start\.png does not say which frame"):
        frame_numbers(["start.png"])
    with pytest.raises(UserError, match=r"1\.png and b_01\.png have the same number"):
        frame_numbers(["1.png", "2.png", "b_01.png"])


@given(st.sets(st.integers(0, 10**6), min_size=1, max_size=20))
def test_padded_and_unpadded_names_give_their_numbers(numbers: set[int]) -> None:
    order = sorted(numbers)
    assert frame_numbers([f"{n}.png" for n in order]) == order
    assert frame_numbers([f"cam3_{n:08d}_mask.png" for n in order]) == order


@pytest.mark.parametrize(
    ("numbers", "counting"),
    [
        (range(100), Counting(0, True)),
        ([0, 50], Counting(0, True)),
        (range(1, 101), Counting(1, True)),
        ([40, 100], Counting(1, True)),
        (range(1, 50), Counting(1, True)),
        (range(500, 600), Counting(500, True)),
        ([1, 5, 9], Counting(1, False)),
        ([3, 5, 99], Counting(0, False)),
        ([], Counting(0, False)),
    ],
)
def test_where_counting_starts_in_a_video_of_100_frames(numbers, counting: Counting) -> None:
    assert count_from(list(numbers), 100) == counting


def test_whoever_is_in_doubt_follows_the_others() -> None:
    sure, doubtful = Counting(1, True), Counting(0, False)
    assert agreed_first([sure, doubtful]) == [1, 1]
    assert agreed_first([sure, Counting(0, True), doubtful]) == [1, 0, 0]
    assert agreed_first([doubtful]) == [0]


def test_numbers_beyond_the_video() -> None:
    assert check_range(range(101), 0, 100, "depth") == 1
    assert check_range(range(100), 0, 100, "depth") == 0
    with pytest.raises(UserError, match=r"depth speaks of frames 0 to 199.*modalities\.toml"):
        check_range(range(200), 0, 100, "depth")
    with pytest.raises(UserError, match="frames 0 to 99"):
        check_range(range(100), 1, 100, "depth")
