"""The measures of people found and kept apart, and what they say about the street clip."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from core_solver.cli import main
from core_solver.errors import UserError
from core_solver.evaluation.people import (
    NamedPerson,
    PeopleReference,
    describe_scores,
    people_boxes,
    read_people,
    score_people,
)
from core_solver.perception.cache import write_chunk
from core_solver.perception.observations import CroppedMask, Detection, FrameInfo, FrameObservations
from core_solver.take import write_take
from core_solver.tracking import find_people
from tests.solver.preview.takes import make_take

DATA = Path(__file__).resolve().parents[2] / "data"


def box(left: float, height: float = 100.0) -> np.ndarray:
    return np.array([left, 100.0, left + 40, 100 + height])


def reference(*frames: dict[int, float], hidden: tuple[int, ...] = (), height: float = 100.0) -> PeopleReference:
    """People by id at these left edges, in every tenth frame; `hidden` are hidden everywhere."""
    return PeopleReference(
        (640, 480),
        {
            10 * n: tuple(NamedPerson(i, tuple(box(x, height).tolist()), i in hidden) for i, x in people.items())
            for n, people in enumerate(frames)
        },
    )


def shown(*frames: dict[int, float]) -> dict[int, dict[int, np.ndarray]]:
    return {10 * n: {i: box(x) for i, x in tracks.items()} for n, tracks in enumerate(frames)}


def test_perfect_tracks() -> None:
    scores = score_people(reference({1: 0, 2: 100}, {1: 10, 2: 90}), shown({7: 0, 8: 100}, {7: 10, 8: 90}))
    assert (scores.precision, scores.recall, scores.switches, scores.fragmentations) == (1, 1, 0, 0)
    assert scores.tracks_of == {1: (7,), 2: (8,)}
    assert scores.faults == ()


def test_counted_by_hand() -> None:
    scores = score_people(
        reference({1: 0, 2: 100}, {1: 0, 2: 100}, {1: 0, 2: 100}, {1: 0, 2: 100}),
        shown({7: 0, 8: 100}, {7: 0}, {7: 0, 8: 100, 9: 300}, {8: 0, 7: 100}),
    )
    assert (scores.people, scores.wanted, scores.found, scores.false) == (2, 8, 7, 1)
    assert scores.precision == pytest.approx(7 / 8)
    assert scores.recall == pytest.approx(7 / 8)
    assert scores.fragmentations == 1
    assert scores.switches == 2
    assert [f.frame for f in scores.faults] == [10, 20, 30]
    assert scores.tracks_of == {1: (7, 8), 2: (8, 7)}
    assert "frame 10: missed person 2" in describe_scores(scores)


def test_a_pair_is_kept_while_it_fits_although_another_fits_better() -> None:
    scores = score_people(reference({1: 0}, {1: 0}), shown({7: 0}, {7: 12, 8: 0}))
    assert (scores.switches, scores.false) == (0, 1)


def test_hidden_and_small_people_are_neutral() -> None:
    truth = reference({1: 0, 2: 100}, hidden=(2,))
    assert score_people(truth, shown({7: 0})).recall == 1
    assert score_people(truth, shown({7: 0, 8: 100})).precision == 1
    small = score_people(reference({1: 0}, height=59), {0: {7: box(0, 59)}})
    assert (small.wanted, small.found, small.false) == (0, 0, 0)


def test_an_absence_nobody_asks_about_is_no_fragmentation() -> None:
    scores = score_people(reference({1: 0}, {}, {1: 0}), shown({7: 0}, {}, {7: 0}))
    assert scores.fragmentations == 0


@pytest.mark.parametrize("text", ["", "[]", '{"image_size": [1, 2]}', '{"image_size": [1], "frames": []}'])
def test_files_that_are_no_reference(tmp_path: Path, text: str) -> None:
    path = tmp_path / "people.json"
    path.write_text(text)
    with pytest.raises(UserError, match=r"people.json is no reference"):
        read_people(path)
    with pytest.raises(UserError, match="no reference"):
        read_people(tmp_path / "none.json")


def street() -> list[FrameObservations]:
    """What the default networks saw in the street clip's first 301 frames, rounded, without landmarks and masks."""
    with np.load(DATA / "street_detections.npz") as stored:
        arrays = {name: stored[name].astype(np.float32) for name in stored.files}
    boxes = arrays["box"] / 4
    middle = (boxes[:, None, :2] + boxes[:, None, 2:]) / 2
    detections = [
        Detection(
            score=float(arrays["score"][i] / 255),
            box=boxes[i],
            keypoints=arrays["keypoints"][i] / 2 + middle[i],
            confidence=arrays["confidence"][i] / 255,
            landmarks=np.full((25, 3), np.nan, np.float32),
            appearance=arrays["appearance"][i] / np.linalg.norm(arrays["appearance"][i]),
            mask=CroppedMask(0, 0, np.full((1, 1) if arrays["masked"][i] else (0, 0), 255, np.uint8)),
        )
        for i in range(len(boxes))
    ]
    ends = np.cumsum(arrays["people"]).astype(int)
    return [
        FrameObservations(FrameInfo(frame, frame / 10), tuple(detections[end - int(count) : end]), None)
        for frame, (end, count) in enumerate(zip(ends, arrays["people"], strict=True))
    ]


def test_everybody_on_the_street_gets_one_track() -> None:
    observations, truth = street(), read_people(DATA / "street_people.json")
    frames = [o.frame.index for o in observations]
    found = find_people(observations, truth.image_size)
    seen = score_people(truth, people_boxes(found.people, frames))
    assert seen.people == 8
    assert seen.precision >= 0.98
    assert seen.recall >= 0.95
    assert seen.switches == 0
    assert all(len(tracks) == 1 for tracks in seen.tracks_of.values()), seen.tracks_of
    # The sign and the lamp post are nobody: besides the eight there is only the person far away on the lawn.
    assert sum(somebody.solved for somebody in found.people.values()) == 9
    followed = score_people(truth, people_boxes(found.people, frames, longest_gap=10))
    assert followed.fragmentations <= 1
    assert followed.precision >= 0.98


def test_the_command_prints_both_tables(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    work = tmp_path / "take.work"
    (work / "observations").mkdir(parents=True)
    observations = street()[:32]
    (work / "observations" / "key.json").write_text('{"frame_count": 32}')
    write_chunk(work / "observations" / "00000.npz", observations)
    arguments = ["evaluate", "people", str(work), "--reference", str(DATA / "street_people.json")]
    assert main(arguments) == 0
    assert "people 5, precision 1.000" in capsys.readouterr().out
    assert main([*arguments, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["seen"]["people"] == 5
    assert facts["followed"]["switches"] == 0
    edits = tmp_path / "identities.json"
    edits.write_text('{"edits": [{"drop": [1]}]}')
    assert main([*arguments, "--identities", str(edits)]) == 0
    assert "person 1: no track" in capsys.readouterr().out
    assert main(["evaluate", "people", str(tmp_path), *arguments[3:]]) == 2


def shaken_street(folder: Path) -> tuple[list[str], dict]:
    """The street as a trembling hand films it: the command's arguments, and what it prints for the same at rest."""
    work = folder / "take.work"
    (work / "observations").mkdir(parents=True)
    (work / "observations" / "key.json").write_text('{"frame_count": 32}')
    shifts = np.random.default_rng(5).integers(-30, 31, (32, 2))
    shifts[0] = 0
    rest = street()[:32]
    seen = [
        replace(o, detections=tuple(shifted(person, shift) for person in o.detections))
        for o, shift in zip(rest, shifts, strict=True)
    ]
    write_chunk(work / "observations" / "00000.npz", seen)
    reference = json.loads((DATA / "street_people.json").read_text())
    reference["frames"] = [f for f in reference["frames"] if f["frame"] < 32]
    people = folder / "people.json"
    at_rest = score_people(
        read_people(DATA / "street_people.json").within(range(32)),
        people_boxes(find_people(rest, (768, 576)).people, range(32)),
    )
    for frame in reference["frames"]:
        for person in frame["people"]:
            person["box"] = (np.array(person["box"]) + np.tile(shifts[frame["frame"]], 2)).tolist()
    people.write_text(json.dumps(reference))
    maps = np.tile(np.eye(3), (32, 1, 1))
    maps[:, :2, 2] = -shifts
    write_take(folder / "take.npz", replace(make_take(people=(), frames=32), steadying=maps))
    expected = {name: getattr(at_rest, name) for name in ("people", "precision", "recall", "switches")}
    return ["evaluate", "people", str(work), "--reference", str(people), "--json"], expected


def shifted(person: Detection, by: np.ndarray) -> Detection:
    return replace(
        person,
        box=(person.box + np.tile(by, 2)).astype(np.float32),
        keypoints=(person.keypoints + by).astype(np.float32),
    )


def test_people_and_reference_are_compared_in_the_picture_held_still(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, at_rest = shaken_street(tmp_path)
    assert at_rest["precision"] == 1
    assert main(arguments) == 0
    facts = json.loads(capsys.readouterr().out)["seen"]
    assert {name: facts[name] for name in at_rest} == at_rest
    assert facts["fragmentations"] == 0


def test_a_take_of_other_frames_cannot_hold_the_picture_still(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments, _ = shaken_street(tmp_path)
    other = replace(make_take(people=(), frames=32, first_frame=1), steadying=np.tile(np.eye(3), (32, 1, 1)))
    write_take(tmp_path / "take.npz", other)
    assert main(arguments) == 2
    assert "take.npz has other frames than take.work" in capsys.readouterr().err


def test_boxes_move_with_the_picture() -> None:
    truth = reference({1: 50}, {1: 50})
    quarter = np.array([[0, -1, 500.0], [1, 0, 0], [0, 0, 1]])  # clockwise
    moved = truth.moved({0: np.eye(3), 10: quarter})
    assert moved.frames[0] == truth.frames[0]
    assert moved.frames[10][0].box == (300, 50, 400, 90)


def test_the_reference_is_whole() -> None:
    raw = json.loads((DATA / "street_people.json").read_text())
    assert [f["frame"] for f in raw["frames"]] == list(range(0, 301, 10))
    for frame in raw["frames"]:
        ids = [p["id"] for p in frame["people"]]
        assert len(set(ids)) == len(ids)
        for left, top, right, bottom in (p["box"] for p in frame["people"]):
            assert 0 <= left < right <= 768
            assert 0 <= top < bottom <= 576
