"""Decoding and merging of MoveNet's finds, against poses made here."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.errors import ModelError
from core_solver.perception.multipose import (
    MultiPose,
    Pose,
    decode_poses,
    doubtful_windows,
    letterbox,
    merge_poses,
    picture_tiles,
    same_person,
    wants_closer_look,
)
from tests.solver.perception.people import first_frame, standing_pose


def test_letterbox_keeps_the_shape_and_pads_right_and_bottom() -> None:
    picture = np.full((100, 200, 3), (10, 20, 30), np.uint8)
    tensor, scale = letterbox(picture, 256, None)
    assert tensor.shape == (1, 128, 256, 3)
    assert tensor.dtype == np.int32
    assert scale == 256 / 200
    assert tuple(tensor[0, 0, 0]) == (30, 20, 10)  # RGB
    tensor, scale = letterbox(picture, 512, (96, 64))
    assert tensor.shape == (1, 96, 64, 3)
    assert scale == 64 / 200
    assert tensor[0, 40:].max() == 0
    assert tensor[0, 31, 63].min() > 0


@given(
    st.floats(0.2, 3.0),
    st.integers(0, 500),
    st.integers(0, 500),
    st.lists(st.floats(0, 1), min_size=56, max_size=56),
)
def test_decoding_inverts_the_normalised_output(scale: float, left: int, top: int, numbers: list[float]) -> None:
    row = np.array(numbers, np.float32)
    (pose,) = decode_poses(row[None], (256, 320), scale, (left, top))
    back = (pose.keypoints - (left, top)) * scale / (320, 256)
    np.testing.assert_allclose(back[:, ::-1], row[:51].reshape(17, 3)[:, :2], atol=1e-3)
    np.testing.assert_allclose(pose.confidence, row[2:51:3])
    np.testing.assert_allclose((pose.box - np.tile((left, top), 2)) * scale / (320, 256, 320, 256),
                               row[[52, 51, 54, 53]], atol=1e-3)  # fmt: skip
    assert pose.score == pytest.approx(float(row[55]))


def test_merging_keeps_the_surest_find_of_each_person() -> None:
    one, other = standing_pose(200, 100), standing_pose(420, 100, score=0.4)
    shaky = replace(one, keypoints=one.keypoints + 3, score=0.3)
    assert merge_poses([shaky, other, one]) == (one, other)


def test_two_people_side_by_side_stay_two() -> None:
    assert not same_person(standing_pose(200, 100), standing_pose(240, 100))


def test_half_a_person_is_the_same_person() -> None:
    whole = standing_pose(200, 100)
    seen = np.arange(17) < 11
    upper = replace(whole, box=np.float32([150, 90, 250, 260]), confidence=np.where(seen, 0.8, 0).astype(np.float32))
    assert same_person(whole, upper)


def test_finds_without_common_keypoints_are_compared_by_their_boxes() -> None:
    whole = standing_pose(200, 100)
    blind = replace(whole, confidence=np.zeros(17, np.float32))
    away = replace(standing_pose(500, 100), confidence=np.zeros(17, np.float32))
    assert same_person(whole, blind)
    assert not same_person(whole, away)


@given(st.lists(st.tuples(st.floats(0, 1500), st.floats(0, 700), st.floats(0.2, 1)), max_size=8))
def test_merging_never_invents_or_doubles(people: list[tuple[float, float, float]]) -> None:
    poses = [standing_pose(x, y, score=s) for x, y, s in people]
    kept = merge_poses(poses)
    assert all(any(k is p for p in poses) for k in kept)
    assert all(not same_person(a, b) for i, a in enumerate(kept) for b in kept[:i])
    assert all(any(same_person(p, k) for k in kept) for p in poses)
    assert merge_poses(list(kept)) == kept


@given(st.integers(64, 4000), st.integers(64, 4000))
def test_tiles_cover_the_picture_and_overlap(width: int, height: int) -> None:
    tiles = picture_tiles(width, height)
    covered_x = {x for t in tiles for x in (t.left, t.left + t.width)}
    assert {0, width} <= covered_x
    assert {0, height} <= {y for t in tiles for y in (t.top, t.top + t.height)}
    side = 0.15 * max(width, height)  # a person up to this size is whole in one tile
    for x in np.linspace(0, max(width - side, 0), 7):
        for y in np.linspace(0, max(height - side, 0), 7):
            assert any(
                t.left <= x + 1 and x + min(side, width) <= t.left + t.width + 1
                and t.top <= y + 1 and y + min(side, height) <= t.top + t.height + 1
                for t in tiles
            )  # fmt: skip


def test_a_closer_look_is_for_crowds_small_people_and_empty_pictures() -> None:
    big = standing_pose(200, 100)
    assert not wants_closer_look((big,), 600)
    assert wants_closer_look((big,), 4000)
    assert wants_closer_look((big,) * 5, 600)
    assert wants_closer_look((), 600)


def test_doubtful_people_get_a_window_which_neighbours_share() -> None:
    people = (
        standing_pose(1000, 300, score=0.7),
        standing_pose(2000, 500, score=0.25),
        standing_pose(2080, 520, score=0.2),
        standing_pose(30, 20, score=0.2),
    )
    shared, corner = doubtful_windows(people, 3840, 2160)
    for window, person in ((shared, people[1]), (shared, people[2]), (corner, people[3])):
        assert window.left <= max(person.box[0], 0)
        assert window.top <= max(person.box[1], 0)
        assert window.left + window.width >= person.box[2]
        assert window.top + window.height >= person.box[3]
    assert (corner.left, corner.top) == (0, 0)
    assert doubtful_windows(people, 600, 600) == ()  # the whole picture is as close


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "movenet.onnx"
    path.write_bytes(b"nothing")
    with pytest.raises(ModelError, match="fetch it again"):
        MultiPose(path)


@pytest.mark.models
def test_the_real_network_finds_both_people_of_the_demo_clip(models) -> None:
    picture = first_frame(models)
    network = MultiPose(models.require("movenet-multipose"))
    poses: tuple[Pose, ...] = network(picture)
    shoulders = [p.keypoints[[5, 6]].mean(axis=0) for p in poses]
    # The man stands in the upper half, the woman at the right; a bystander may be found too.
    assert 2 <= len(poses) <= 3
    assert any(np.hypot(x - 450, y - 490) < 60 for x, y in shoulders)
    assert any(np.hypot(x - 860, y - 1030) < 60 for x, y in shoulders)
    again = network(picture)
    assert all(np.array_equal(a.keypoints, b.keypoints) for a, b in zip(poses, again, strict=True))
