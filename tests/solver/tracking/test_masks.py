from dataclasses import replace

import numpy as np
import pytest

from core_solver.perception.observations import CroppedMask, FrameInfo, FrameObservations
from core_solver.tracking import BACKGROUND, UNCLAIMED, track_people
from core_solver.tracking.masks import label_frame
from core_solver.tracking.sights import Sight, frame_sights
from tests.solver.tracking.walkers import IMAGE_SIZE, LABEL_SIZE, Walker, detection_of, film, straight

WIDTH, HEIGHT = LABEL_SIZE


def sight_at(u: float, v: float = 240.0, mask: CroppedMask | None = None, height: float = 120.0) -> Sight:
    detection = detection_of(Walker(straight((u, v), (0, 0)), height=height), 0.0, np.random.default_rng(0), 0.0)
    if mask is not None:
        detection = replace(detection, mask=mask)
    return frame_sights(FrameObservations(FrameInfo(0, 0.0), (detection,), None), 0).sights[0]


def block(left: int, top: int, width: int, height: int, probability: int = 200) -> CroppedMask:
    return CroppedMask(top, left, np.full((height, width), probability, np.uint8))


def labels_of(people: list[tuple[Sight, int]], extra: tuple[CroppedMask, ...] = ()) -> np.ndarray:
    return label_frame([s.detection.mask for s, _ in people] + list(extra), people, IMAGE_SIZE, LABEL_SIZE)


def test_a_mask_becomes_its_person_grown_by_one_cell():
    # The figure at (320, 240) covers cells 71..89 x 46..74.
    labels = labels_of([(sight_at(320, mask=block(66, 40, 28, 40)), 3)])
    expected = np.zeros((HEIGHT, WIDTH), np.uint8)
    expected[39:81, 65:95] = 3
    # 3x3 off and 5x5 on: one cell more on every side of a block.
    np.testing.assert_array_equal(labels, expected)


def test_the_highest_probability_wins_per_pixel():
    near = sight_at(300, mask=block(60, 40, 30, 40, 250))
    far = sight_at(360, mask=block(75, 40, 30, 40, 180))
    labels = labels_of([(near, 1), (far, 2)])
    assert np.all(labels[45:75, 61:90] == 1)
    assert np.all(labels[45:75, 90:104] == 2)


def test_half_probability_is_background():
    assert not labels_of([(sight_at(320, mask=block(66, 40, 28, 40, 127)), 1)]).any()
    assert labels_of([(sight_at(320, mask=block(66, 40, 28, 40, 128)), 1)]).any()


def test_where_a_person_without_a_mask_is_nothing_is_background():
    hidden = sight_at(300, mask=block(0, 0, 0, 0))
    near = sight_at(360, mask=block(75, 40, 30, 40))
    labels = labels_of([(hidden, 1), (near, 2)])
    assert np.all(labels[47:74, 76:104] == 2)
    assert np.all(labels[50:70, 70:74] == UNCLAIMED)
    assert not (labels == 1).any()
    assert not labels[:, :66].any()


def test_a_mask_goes_to_the_person_with_most_joints_inside():
    # Both readings carry the other's mask: the joints decide, not the detection the mask came with.
    left = sight_at(200, mask=block(66 + 30, 40, 28, 40))
    right = sight_at(440, mask=block(66 - 30, 40, 28, 40))
    labels = labels_of([(left, 1), (right, 2)])
    assert labels[60, 50] == 1
    assert labels[60, 110] == 2


def test_a_mask_without_votes_is_unclaimed_and_so_are_people_nobody_solves():
    labels = labels_of([(sight_at(200), 1), (sight_at(440), UNCLAIMED)], extra=(block(5, 5, 12, 12),))
    assert labels[60, 50] == 1
    assert labels[60, 110] == UNCLAIMED
    assert labels[10, 10] == UNCLAIMED
    assert labels[100, 80] == BACKGROUND


def test_keypoints_without_confidence_do_not_vote():
    sight = sight_at(320, mask=block(66, 40, 28, 40))
    blind = replace(sight.detection, confidence=np.zeros(25, np.float32))
    labels = labels_of([(replace(sight, detection=blind), 1)])
    assert labels[60, 80] == UNCLAIMED


def test_a_thin_leftover_is_nobody_s_but_not_background():
    values = np.zeros((40, 28), np.uint8)
    values[:, :20] = 200
    values[10, 20:] = 200  # a hair one cell wide: erosion takes it away
    labels = labels_of([(sight_at(310, mask=CroppedMask(40, 66, values)), 1)])
    assert labels[50, 92] == UNCLAIMED
    assert labels[50, 80] == 1


def test_dilation_never_takes_a_neighbour_s_cell():
    labels = labels_of([
        (sight_at(280, mask=block(60, 40, 20, 40)), 1),
        (sight_at(360, mask=block(80, 40, 20, 40)), 2),
    ])  # fmt: skip
    assert np.all(labels[40:80, 60:80] == 1)
    assert np.all(labels[40:80, 80:100] == 2)


@pytest.mark.parametrize(
    "mask",
    [
        CroppedMask(10, 10, np.zeros((20, 20), np.uint8)),
        CroppedMask(-30, -30, np.full((20, 20), 255, np.uint8)),
        CroppedMask(HEIGHT + 5, WIDTH + 5, np.full((20, 20), 255, np.uint8)),
    ],
)
def test_masks_of_nothing_and_masks_off_the_grid_leave_background(mask):
    assert not labels_of([(sight_at(320, mask=mask), 1)]).any()


def test_a_mask_that_reaches_over_the_border_is_cut_off():
    labels = labels_of([(sight_at(20, mask=block(-10, 40, 30, 40)), 1)])
    assert np.all(labels[40:80, 0:20] == 1)


def test_labels_follow_the_tracks_ids_through_the_clip():
    walkers = [
        Walker(straight((100, 240), (60, 0)), clothes=1),
        Walker(straight((500, 240), (-20, 0)), clothes=2, seen=lambda t: t > 1),
    ]
    result = track_people(film(walkers, 3), IMAGE_SIZE, LABEL_SIZE)
    for row in (5, 40, 80):
        for walker, track in zip(walkers, result.tracks, strict=True):
            u, v = walker.path(result.times[row])
            expected = track.id if track.valid[row] else BACKGROUND
            assert result.labels[row, int(v / 4), int(u / 4)] == expected


def test_a_person_left_out_is_not_background():
    brief = Walker(straight((480, 240), (0, 0)), clothes=1, seen=lambda t: t < 0.1)
    result = track_people(film([Walker(straight((100, 240), (10, 0))), brief], 2), IMAGE_SIZE, LABEL_SIZE)
    assert len(result.tracks) == 1
    assert result.labels[0, 60, 120] == UNCLAIMED
    assert result.labels[30, 60, 120] == BACKGROUND
