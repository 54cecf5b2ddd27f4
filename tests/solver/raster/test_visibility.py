"""Who hides whom is decided by depth, whatever the masks say."""

import numpy as np
import pytest

from core_solver.raster import Pinhole, contours, solve_terms, visibility

from .scenes import SQUARE_FACES, square

GRID = Pinhole(32, 24, 20.0, 30.0, 16.0, 12.0)
LEFT, RIGHT = (slice(6, 18), slice(4, 20)), (slice(6, 18), slice(12, 28))
BOTH = (slice(6, 18), slice(12, 20))


def two_people(left_depth: float, right_depth: float) -> np.ndarray:
    """(2, 4, 3): the right one covers a part of the left one or is covered."""
    return np.stack([square(GRID, 4, 6, 20, 18, left_depth), square(GRID, 12, 6, 28, 18, right_depth)])


@pytest.mark.parametrize("on_top", [1, 2])
@pytest.mark.parametrize(("depths", "hidden"), [((2.0, 3.0), 1), ((3.0, 2.0), 0)])
def test_the_nearer_body_hides_whichever_mask_lies_on_top(
    depths: tuple[float, float], hidden: int, on_top: int
) -> None:
    labels = np.zeros((24, 32), np.uint8)
    labels[LEFT], labels[RIGHT], labels[BOTH] = 1, 2, on_top
    visible = visibility(two_people(*depths), SQUARE_FACES, GRID, labels, [1, 2])
    expected = np.ones((24, 32), bool)
    # The nearer one's whole mask may hide the other; so does its body.
    nearer = RIGHT if hidden == 0 else LEFT
    expected[nearer] = False
    if on_top - 1 == hidden:
        assert not visible[hidden][BOTH].any()
    else:
        assert np.array_equal(visible[hidden], expected)
    assert visible[1 - hidden].all()


def test_people_side_by_side_do_not_hide_each_other() -> None:
    labels = np.zeros((24, 32), np.uint8)
    labels[LEFT], labels[RIGHT] = 1, 2
    assert visibility(two_people(2.0, 2.04), SQUARE_FACES, GRID, labels, [1, 2]).all()


def test_the_mask_of_somebody_behind_hides_nobody() -> None:
    # The label says that the one behind is seen there: so the one in front is not, and may be told so.
    labels = np.zeros((24, 32), np.uint8)
    labels[0:4] = 2
    visible = visibility(two_people(2.0, 3.0), SQUARE_FACES, GRID, labels, [1, 2])
    assert visible[0].all()
    labels[0:4] = 1
    visible = visibility(two_people(2.0, 3.0), SQUARE_FACES, GRID, labels, [1, 2])
    assert not visible[1, 0:4].any()


@pytest.mark.parametrize("label", [255, 9])
def test_a_pixel_of_nobody_known_is_no_evidence(label: int) -> None:
    labels = np.zeros((24, 32), np.uint8)
    labels[8:10] = label
    visible = visibility(two_people(2.0, 3.0), SQUARE_FACES, GRID, labels, [1, 2])
    assert not visible[:, 8:10].any()
    assert visible[0, 0:8].all()


def test_the_mask_of_a_lost_body_may_hide_everybody() -> None:
    vertices = two_people(2.0, np.nan)
    labels = np.zeros((24, 32), np.uint8)
    labels[RIGHT] = 2
    visible = visibility(vertices, SQUARE_FACES, GRID, labels, [1, 2])
    assert not visible[0][RIGHT].any()


def test_frames_are_seen_alone() -> None:
    clip = np.stack([two_people(2.0, 3.0), two_people(3.0, 2.0)])
    labels = np.zeros((2, 24, 32), np.uint8)
    labels[:, 6:18, 4:20] = 1
    labels[:, 6:18, 20:28] = 2
    both = visibility(clip, SQUARE_FACES, GRID, labels, [1, 2])
    for frame in range(2):
        assert np.array_equal(both[frame], visibility(clip[frame], SQUARE_FACES, GRID, labels[frame], [1, 2]))
    assert not np.array_equal(both[0], both[1])


def test_what_another_hides_is_not_held_against_the_hidden() -> None:
    labels = np.zeros((1, 24, 32), np.uint8)
    labels[0][LEFT], labels[0][RIGHT] = 1, 2
    terms = solve_terms(two_people(3.0, 2.0)[None], SQUARE_FACES, GRID, labels, [1, 2])
    assert terms.silhouette[0].tolist() == [0, 0]
    assert terms.pixels[0].tolist() == [8 * 12, 16 * 12]
    assert terms.log_depth[0] == pytest.approx(np.log([3.0, 2.0]), rel=1e-6)
    assert not np.abs(terms.silhouette_gradient[0, :, :, 0].sum(axis=-1)).max() > 1e-6
    found = contours(two_people(3.0, 2.0)[None], SQUARE_FACES, GRID, labels, [1, 2], samples=200)
    assert found.target == pytest.approx(found.here)
    # All of the nearer one's outline is known; of the other's, all but the hidden end.
    assert found.weight[0, 1].sum() > 2 * 12
    hidden = found.here[0, 0][(found.axis[0, 0] == 0) & (found.weight[0, 0] > 0)]
    assert hidden.max() < 12
