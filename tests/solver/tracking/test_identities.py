"""The user's word on who is who: what each edit does, and how mistakes in the file are named."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core_solver.errors import UserError
from core_solver.tracking import UNCLAIMED, find_people, gather, read_edits, track_people, write_identities
from core_solver.tracking.identities import Drop, Edit, Merge, Rename, Somebody, Split, Swap, apply_edits
from core_solver.tracking.sights import frame_sights
from core_solver.tracking.tracklets import Tracklet
from tests.solver.tracking.walkers import IMAGE_SIZE, LABEL_SIZE, Walker, film, straight

WALKERS = [Walker(straight((100 + 200 * i, 240), (10, 0)), clothes=i) for i in range(3)]
FILM = film(WALKERS, 2)
SIGHTS = [frame_sights(frame, row).sights for row, frame in enumerate(FILM)]
# Every second frame of a longer video, from its frame 100 on.
FRAMES = list(range(100, 220, 2))


def people_of(*seen: range) -> dict[int, Somebody]:
    """Person 1, 2, ... seen in these rows."""
    return {
        number: Somebody(Tracklet(tuple(SIGHTS[row][number - 1] for row in span)))
        for number, span in enumerate(seen, 1)
    }


def rows_of(people: dict[int, Somebody]) -> dict[int, list[int]]:
    return {number: [s.row for s in somebody.tracklet.sights] for number, somebody in people.items()}


def owners(people: dict[int, Somebody]) -> dict[int, int]:
    """{sight: person}."""
    return {id(s): number for number, somebody in people.items() for s in somebody.tracklet.sights}


def test_merge_makes_one_of_several() -> None:
    people = people_of(range(10), range(20, 30), range(5))
    merged = apply_edits(people, [Merge((2, 1))], FRAMES)
    assert rows_of(merged) == {2: [*range(10), *range(20, 30)], 3: [*range(5)]}


def test_where_both_were_seen_a_merge_keeps_the_first() -> None:
    people = people_of(range(10), range(5, 15))
    merged = apply_edits(people, [Merge((2, 1))], FRAMES)[2].tracklet.sights
    assert list(merged[5:]) == list(people[2].tracklet.sights)
    assert list(merged[:5]) == list(people[1].tracklet.sights[:5])


def test_merging_somebody_left_out_solves_them() -> None:
    people = people_of(range(10), range(20, 30))
    people[2] = Somebody(people[2].tracklet, solved=False)
    assert apply_edits(people, [Merge((2, 1))], FRAMES)[2].solved


def test_split_counts_in_frames_of_the_video() -> None:
    split = apply_edits(people_of(range(10), range(10)), [Split(1, 108)], FRAMES)
    assert rows_of(split) == {1: [*range(4)], 2: [*range(10)], 3: [*range(4, 10)]}


def test_swap_exchanges_the_rest_of_two_people() -> None:
    people = people_of(range(10), range(3, 12))
    swapped = apply_edits(people, [Swap((1, 2), 112)], FRAMES)
    before, after = owners(people), owners(swapped)
    for sight in (s for p in people.values() for s in p.tracklet.sights):
        expected = before[id(sight)] if FRAMES[sight.row] < 112 else 3 - before[id(sight)]
        assert after[id(sight)] == expected


def test_dropped_people_are_nobodys_evidence_and_not_named_as_left_out() -> None:
    everybody = track_people(FILM, IMAGE_SIZE, LABEL_SIZE)
    result = track_people(FILM, IMAGE_SIZE, LABEL_SIZE, edits=[Drop((2,))])
    assert [t.id for t in result.tracks] == [1, 3]
    np.testing.assert_array_equal(result.labels[everybody.labels == 2], UNCLAIMED)
    np.testing.assert_array_equal(result.labels[everybody.labels != 2], everybody.labels[everybody.labels != 2])
    assert result.dropped == ()


def test_names_reach_the_tracks() -> None:
    result = track_people(FILM, IMAGE_SIZE, LABEL_SIZE, edits=[Rename({2: "Anna"})])
    assert [t.name for t in result.tracks] == ["", "Anna", ""]


def test_edits_apply_one_after_the_other() -> None:
    edits: list[Edit] = [Split(1, 120), Merge((2, 4)), Rename({2: "Anna"})]
    people = apply_edits(people_of(range(20), range(5), range(5)), edits, FRAMES)
    assert rows_of(people) == {1: [*range(10)], 2: [*range(5), *range(10, 20)], 3: [*range(5)]}
    assert people[2].name == "Anna"


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Merge((1, 7)), r"edit 1 \(merge\): there is no person 7 here; there are 1, 2, 3"),
        (Drop((9,)), r"edit 1 \(drop\): there is no person 9"),
        (Rename({4: "x"}), r"edit 1 \(rename\): there is no person 4"),
        (Split(2, 100), r"edit 1 \(split\): person 2 was never seen before frame 100"),
        (Split(2, 400), r"edit 1 \(split\): person 2 was never seen from frame 400 on"),
        (Swap((1, 5), 110), r"edit 1 \(swap\): there is no person 5"),
        (Swap((2, 3), 110), r"edit 1 \(swap\): nothing of person 2 would be left"),
    ],
)
def test_edits_that_cannot_be_are_named(edit: Edit, message: str) -> None:
    people = people_of(range(20), range(10, 20), range(5))
    with pytest.raises(UserError, match=message):
        apply_edits(people, [edit], FRAMES)


spans = st.tuples(st.integers(0, 50), st.integers(2, 10)).map(lambda s: range(s[0], s[0] + s[1]))


@given(spans, spans, spans, st.permutations([1, 2, 3]), st.integers(2, 3))
def test_merging_conserves_the_frames(a: range, b: range, c: range, order: list[int], count: int) -> None:
    people, ids = people_of(a, b, c), tuple(order[:count])
    merged = rows_of(apply_edits(people, [Merge(ids)], FRAMES))
    before = rows_of(people)
    assert merged[ids[0]] == sorted(set().union(*(before[i] for i in ids)))
    assert {i: merged[i] for i in order[count:]} == {i: before[i] for i in order[count:]}


@given(spans, spans, st.data())
def test_splitting_conserves_sights_and_merging_undoes_it(a: range, b: range, data: st.DataObject) -> None:
    people = people_of(a, b)
    frame = FRAMES[data.draw(st.integers(a.start + 1, a.stop - 1))]
    split = apply_edits(people, [Split(1, frame)], FRAMES)
    assert split[1].tracklet.sights + split[3].tracklet.sights == people[1].tracklet.sights
    again = apply_edits(split, [Merge((1, 3))], FRAMES)
    assert owners(again) == owners(people)


@given(spans, spans, st.integers(0, 59))
def test_swapping_twice_changes_nothing(a: range, b: range, row: int) -> None:
    people = people_of(a, b)
    swap = Swap((1, 2), FRAMES[row])
    try:
        once = apply_edits(people, [swap], FRAMES)
    except UserError:  # one of them would have nothing left
        return
    assert owners(apply_edits(once, [swap], FRAMES)) == owners(people)
    assert owners(once).keys() == owners(people).keys()


def test_the_written_file_reads_back_and_changes_nothing_by_itself(tmp_path: Path) -> None:
    found = find_people(FILM, IMAGE_SIZE)
    path = tmp_path / "take.work" / "identities.json"
    edits = (Rename({1: "Åsa"}), Split(2, 20), Swap((1, 3), 30), Merge((2, 4)), Drop((3,)))
    write_identities(path, found.people, edits, range(60), {1: (0.1, 0.2, 0.3)})
    assert read_edits(path) == edits
    written = json.loads(path.read_text(encoding="utf-8"))
    assert [p["id"] for p in written["people"]] == [1, 2, 3]
    assert written["people"][0]["colour"] == [0.1, 0.2, 0.3]
    assert (written["people"][1]["first_frame"], written["people"][1]["last_frame"]) == (0, 59)
    write_identities(path, found.people, (), range(60), {})
    assert read_edits(path) == ()
    assert [t.id for t in gather(FILM, found, IMAGE_SIZE, LABEL_SIZE, read_edits(path)).tracks] == [1, 2, 3]


@pytest.mark.parametrize("mine", ['{"edits": [{"drop": [1]}]}', '{"edits": [{"drop": [1]}'])
def test_edits_made_in_the_written_file_are_not_lost(tmp_path: Path, mine: str) -> None:
    found, path = find_people(FILM, IMAGE_SIZE), tmp_path / "identities.json"
    write_identities(path, found.people, (), range(60), {})
    path.write_text(mine)
    write_identities(path, found.people, (), range(60), {})
    assert (tmp_path / "identities.old.json").read_text() == mine
    assert read_edits(path) == ()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "identities.json is not JSON"),
        ("[]", 'must be an object with a list "edits"'),
        ('{"edits": {}}', 'must be an object with a list "edits"'),
        ('{"edits": [{"drop": [1]}, {"join": [1, 2]}]}', "edit 2 must be one of merge, split, swap, drop, rename"),
        ('{"edits": [{"drop": [1], "merge": [1, 2]}]}', "edit 1 must be one of"),
        ('{"edits": [{"merge": [1]}]}', r"edit 1 \(merge\) must look like"),
        ('{"edits": [{"merge": [1, 1]}]}', r"edit 1 \(merge\) must look like"),
        ('{"edits": [{"split": {"id": 1}}]}', r"edit 1 \(split\) must look like"),
        ('{"edits": [{"split": {"id": 1, "frame": 3.5}}]}', r"edit 1 \(split\) must look like"),
        ('{"edits": [{"swap": {"ids": [1, 2, 3], "frame": 3}}]}', r"edit 1 \(swap\) must look like"),
        ('{"edits": [{"drop": [true]}]}', r"edit 1 \(drop\) must look like"),
        ('{"edits": [{"rename": {"one": "Anna"}}]}', r"edit 1 \(rename\) must look like"),
        ('{"edits": [{"rename": {"1": " "}}]}', r"edit 1 \(rename\) must look like"),
        ('{"edits": [{"rename": {"1": 7}}]}', r"edit 1 \(rename\) must look like"),
    ],
)
def test_mistakes_in_the_file_are_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "identities.json"
    path.write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        read_edits(path)
    assert "\n" not in str(caught.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no identities file"):
        read_edits(tmp_path / "none.json")


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.text(max_size=5), lambda inner: (
    st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(["edits", "merge", "split", "swap", "drop", "rename", "id", "ids", "frame", "1"]), inner,
        max_size=3,
    )
), max_leaves=12))  # fmt: skip
def test_no_json_breaks_the_reader(tmp_path_factory: pytest.TempPathFactory, value: object) -> None:
    path = tmp_path_factory.getbasetemp() / "any.json"
    path.write_text(json.dumps(value))
    try:
        edits = read_edits(path)
    except UserError:
        return
    assert all(isinstance(edit, Merge | Split | Swap | Drop | Rename) for edit in edits)
