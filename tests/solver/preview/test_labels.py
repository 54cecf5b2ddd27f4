from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core_solver.preview.labels import Label, draw_labels, place_boxes
from core_solver.preview.overlay import TakeOverFootage
from core_solver.preview.text import draw_text, text_size
from core_solver.take import Take
from tests.solver.body.synthetic import make_stick_body
from tests.solver.preview.takes import BLUE, RED, make_camera, make_person, make_take, write_video

PICTURE = (640, 480)


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    """Whether two boxes share more than rounding."""
    both = np.minimum(a[2:], b[2:]) - np.maximum(a[:2], b[:2])
    return bool((both > 1e-6).all())


@settings(max_examples=60, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(20, 120), st.floats(8, 30), st.floats(0, PICTURE[0]), st.floats(0, PICTURE[1])), max_size=14
    )
)
def test_labels_stand_inside_and_free_of_each_other(labels: list[tuple[float, float, float, float]]) -> None:
    rows = np.array(labels).reshape(-1, 4)
    stamp = np.array([5.0, 450, 200, 475])
    boxes = place_boxes(rows[:, :2], rows[:, 2:], PICTURE, [stamp])
    assert not [pair for pair in combinations([stamp, *boxes], 2) if overlap(*pair)]
    assert (boxes[:, :2] >= 0).all()
    assert (boxes[:, 2:] <= np.array(PICTURE) + 1e-9).all()
    np.testing.assert_allclose(boxes[:, 2:] - boxes[:, :2], rows[:, :2], atol=1e-9)


def test_who_has_room_stands_right_above_their_anchor() -> None:
    boxes = place_boxes(np.full((2, 2), (80.0, 20.0)), np.array([[100.0, 200], [400, 210]]), PICTURE)
    np.testing.assert_allclose(boxes[:, [0, 2]].mean(axis=1), [100, 400])
    assert ((boxes[:, 3] < [200, 210]) & (boxes[:, 3] > [180, 190])).all()


def test_the_first_stays_and_the_next_moves_no_farther_than_needed() -> None:
    first, second = place_boxes(np.full((2, 2), (80.0, 20.0)), np.array([[300.0, 200], [310, 200]]), PICTURE)
    np.testing.assert_allclose(first[[0, 2]].mean(), 300)
    assert second[3] == first[1]  # touching, on top: aside would be farther and below would hide the body
    assert second[[0, 2]].mean() == pytest.approx(310)


def test_a_picture_too_small_for_all_still_shows_them() -> None:
    boxes = place_boxes(np.full((3, 2), (50.0, 30.0)), np.full((3, 2), 20.0), (40, 40))
    assert boxes.shape == (3, 4)
    assert (boxes[:, :2] == 0).all()


@pytest.mark.parametrize("size", [0.3, 0.8, 2.0])
def test_nothing_is_painted_outside_the_words_box(size: float) -> None:
    picture = np.full((200, 900, 3), 128, np.uint8)
    width, height = text_size("12: 1.71 m (gy)", size)
    draw_text(picture, "12: 1.71 m (gy)", (40, 150), size)
    rows, columns = np.nonzero((picture != 128).any(axis=-1))
    assert 150 - height <= rows.min() < rows.max() < 150
    assert 40 <= columns.min() < columns.max() < 40 + width
    assert rows.max() - rows.min() > 0.7 * height


def test_only_a_label_that_moved_away_has_a_line() -> None:
    blue, green = (255, 0, 0), (0, 255, 0)
    labels = [Label("1: 1.80 m", (300.0, 200.0), blue), Label("2: 1.70 m", (320.0, 200.0), green)]
    picture = np.full((480, 640, 3), 128, np.uint8)
    draw_labels(picture, labels, 0.8)
    assert not (picture == blue).all(axis=-1).any()
    rows = np.flatnonzero((picture == green).all(axis=-1)[:, 320])
    assert rows.max() == pytest.approx(200, abs=1)


@pytest.fixture
def couple(tmp_path: Path) -> tuple[Take, Path]:
    """Two people shoulder to shoulder, and their video."""
    body = make_stick_body()
    people = (
        make_person(body, 1, RED, (0.0, 4.0), (0, 0), 1),
        make_person(body, 2, BLUE, (0.15, 4.1), (0, 0), 1),
    )
    take = make_take(make_camera(960, 720), people=people, frames=1)
    return take, write_video(tmp_path / "clip.avi", take.meta.camera, 2)


def white_pixels(take: Take, video: Path) -> int:
    """Pixels of the letters in the first frame: the outline of words above would hide some of those below."""
    picture = next(TakeOverFootage(take, video).pictures([0]))[10:]
    return int((picture > 200).all(axis=-1).sum())


def test_all_letters_of_people_side_by_side_can_be_read(couple: tuple[Take, Path]) -> None:
    take, video = couple
    counts = [white_pixels(replace(take, people=people), video) for people in ((), *((p,) for p in take.people))]
    stamp, first, second = counts
    assert min(first, second) > stamp > 20
    assert white_pixels(take, video) == first + second - stamp
