"""Joints from files written by hand in each program's form."""

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.body.skeleton import KEYPOINT_NAMES
from core_solver.errors import UserError
from core_solver.perception.precomputed.joints import read_joints
from tests.solver.perception.precomputed.damage import damaged, value_or_user_error

# The order of each program's skeleton, as its documentation lists it.
HALPE_26 = [
    *KEYPOINT_NAMES[:17], "head", "neck", "hip", "left_toe", "right_toe", "left_small_toe", "right_small_toe",
    "left_heel", "right_heel",
]  # fmt: skip
BODY_25 = [
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "mid_hip", "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye",
    "right_ear", "left_ear", "left_toe", "left_small_toe", "left_heel", "right_toe", "right_small_toe", "right_heel",
]  # fmt: skip
COCO_18 = [
    "nose", "neck", "right_shoulder", "right_elbow", "right_wrist", "left_shoulder", "left_elbow", "left_wrist",
    "right_hip", "right_knee", "right_ankle", "left_hip", "left_knee", "left_ankle", "right_eye", "left_eye",
    "right_ear", "left_ear",
]  # fmt: skip

PLACES = {name: (10.0 + 7 * i, 300.0 - 5 * i) for i, name in enumerate(KEYPOINT_NAMES)}


def listed(names: list[str], confidence: float = 0.75) -> list[float]:
    return [v for name in names for v in (*PLACES.get(name, (1.0, 2.0)), confidence)]


def result(image: object, names: list[str] | None = None, **more: object) -> dict[str, object]:
    return {"image_id": image, "category_id": 1, "keypoints": listed(names or list(KEYPOINT_NAMES[:17])), **more}


def write(path: Path, document: object) -> Path:
    path.write_text(json.dumps(document))
    return path


def assert_at_their_places(person, names: list[str]) -> None:
    for i, name in enumerate(KEYPOINT_NAMES):
        if name in names:
            assert tuple(person.keypoints[i]) == PLACES[name]
            assert person.confidence[i] == 0.75
        else:
            assert person.confidence[i] == 0
    assert np.isfinite(person.keypoints).all()


@pytest.mark.parametrize("names", [list(KEYPOINT_NAMES[:17]), HALPE_26])
def test_alphapose(tmp_path: Path, names: list[str]) -> None:
    file = write(
        tmp_path / "alphapose-results.json",
        [
            result("img_000004.jpg", names, score=3.1, idx=2),
            result("img_000007.jpg", names, score=0.5, idx=[1.0]),
            result("img_000007.jpg", names, score=2.5, idx=2),
        ],
    )
    joints = read_joints(file)
    assert sorted(joints.people) == [4, 7]
    assert [p.identity for p in joints.people[7]] == [1, 2]
    assert_at_their_places(joints.people[4][0], names)
    # A score beyond 1 is AlphaPose's sum: the joints' mean stands for it.
    assert [p.score for p in joints.people[7]] == [0.5, 0.75]
    assert not joints.names_empty_frames
    assert read_joints(tmp_path).people.keys() == joints.people.keys()


@pytest.mark.parametrize("names", [BODY_25, COCO_18])
def test_openpose(tmp_path: Path, names: list[str]) -> None:
    people = [
        {"person_id": [-1], "pose_keypoints_2d": listed(names)},
        {"person_id": [3], "pose_keypoints_2d": listed(names)},
        {"pose_keypoints_2d": [0.0] * 3 * len(names)},
    ]
    write(tmp_path / "clip_000000000000_keypoints.json", {"version": 1.3, "people": people})
    write(tmp_path / "clip_000000000011_keypoints.json", {"version": 1.3, "people": []})
    joints = read_joints(tmp_path)
    assert set(joints.people) == {0, 11}
    assert joints.people[11] == ()
    assert joints.names_empty_frames
    assert [p.identity for p in joints.people[0]] == [None, 3], "somebody without joints is nobody"
    assert_at_their_places(joints.people[0][0], names)


def test_coco_with_its_images(tmp_path: Path) -> None:
    images = [{"id": 77, "file_name": "a/frame_0012.png", "width": 640, "height": 480},
              {"id": 5, "file_name": "a/frame_0013.png", "width": 640, "height": 480}]  # fmt: skip
    people = [result(5, score=0.9), result(77, score=0.8)]
    write(tmp_path / "results.json", people)
    assert set(read_joints(tmp_path).people) == {5, 77}
    write(tmp_path / "images.json", {"images": images})
    joints = read_joints(tmp_path)
    assert joints.size == (640, 480)
    assert joints.people[13][0].score == 0.9
    assert joints.people[12][0].score == 0.8
    whole = write(tmp_path / "one.txt", {"annotations": people, "images": images})
    assert set(read_joints(whole).people) == {12, 13}


def test_hands_and_feet_of_whole_body_skeletons(tmp_path: Path) -> None:
    for count, heel, index in ((133, 19, 96), (136, 24, 99)):
        points = np.zeros((count, 3))
        points[:17] = (5, 5, 0.5)
        points[heel], points[index] = (50, 60, 0.9), (70, 80, 0.8)
        file = write(tmp_path / "a.json", [{"image_id": 0, "keypoints": points.ravel().tolist()}])
        person = read_joints(file).people[0][0]
        assert tuple(person.keypoints[KEYPOINT_NAMES.index("left_heel")]) == (50, 60)
        assert tuple(person.keypoints[KEYPOINT_NAMES.index("left_index")]) == (70, 80)


def test_what_is_no_number_was_not_seen(tmp_path: Path) -> None:
    entry = result(3)
    entry["keypoints"][0], entry["keypoints"][5], entry["keypoints"][6] = float("nan"), float("inf"), 1e300
    person = read_joints(write(tmp_path / "a.json", [entry])).people[3][0]
    assert person.confidence[:4].tolist() == [0, 0, 0, 0.75]
    assert np.isfinite(person.keypoints).all()


def test_visibility_marks_and_slight_overshoot(tmp_path: Path) -> None:
    entry = result(0)
    entry["keypoints"][2::3] = [2, 1, 0] + [2] * 14
    assert read_joints(write(tmp_path / "a.json", [entry])).people[0][0].confidence[:4].tolist() == [1, 0.5, 0, 1]
    entry["keypoints"][2::3] = [1.05] + [0.5] * 16
    assert read_joints(write(tmp_path / "a.json", [entry])).people[0][0].confidence[0] == 1


def test_ids_that_name_two_people_of_a_frame_are_no_identities(tmp_path: Path) -> None:
    joints = read_joints(write(tmp_path / "a.json", [result(0, idx=0), result(0, idx=0), result(1, idx=1)]))
    assert all(p.identity is None for people in joints.people.values() for p in people)
    assert "not used" in joints.notes[0]


@pytest.mark.parametrize(
    ("document", "complaint"),
    [
        ([{"image_id": 1, "keypoints": [1, 2, 0.5] * 16}], "48 numbers .* 17, 26"),
        ([{"image_id": 1, "keypoints": [1, 2] * 17}], "34 numbers"),
        ([{"image_id": 1, "keypoints": [1, 2, 7.5] * 17}], "confidence of 7.5"),
        ([{"image_id": 1, "keypoints": [1, 2, -0.5] * 17}], "confidence of -0.5"),
        ([{"image_id": 1, "keypoints": ["x"] * 51}], "must be numbers"),
        ([{"image_id": None, "keypoints": [1, 2, 0.5] * 17}], "image_id"),
        ([{"image_id": "start.jpg", "keypoints": [1, 2, 0.5] * 17}], "which frame"),
        ({"annotations": 3}, "list of people"),
        ({"people": [{"pose_keypoints_2d": [1, 2, 0.5] * 17}]}, "18, 25"),
        ({"people": 3}, "list of tables"),
        ({"results": []}, "0 lists of joints"),
    ],
)
def test_what_cannot_be_joints_is_refused(tmp_path: Path, document: object, complaint: str) -> None:
    with pytest.raises(UserError, match=complaint):
        read_joints(write(tmp_path / "f_1.json", document))


def test_two_lists_and_empty_folders_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no JSON files"):
        read_joints(tmp_path)
    write(tmp_path / "a.json", [result(1)])
    write(tmp_path / "b.json", [result(1)])
    with pytest.raises(UserError, match=r"2 lists .* modalities\.toml"):
        read_joints(tmp_path)


WHOLE = [
    json.dumps([result("a_1.jpg", idx=1, score=0.5), result("a_2.jpg", HALPE_26)]).encode(),
    json.dumps({"people": [{"person_id": [1], "pose_keypoints_2d": listed(BODY_25)}]}).encode(),
    json.dumps({"annotations": [result(1)], "images": [{"id": 1, "file_name": "x3.png"}]}).encode(),
]


@given(st.sampled_from(WHOLE).flatmap(damaged))
@settings(deadline=None, max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_damaged_files_give_a_line_or_sound_joints(tmp_path: Path, content: bytes) -> None:
    joints = value_or_user_error(tmp_path / "f_1.json", content, read_joints)
    for people in joints.people.values() if joints else ():
        for person in people:
            assert person.keypoints.shape == (25, 2)
            assert np.isfinite(person.keypoints).all()
            assert 0 <= person.score <= 1
            assert person.confidence.min() >= 0
            assert person.confidence.max() <= 1


JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.floats() | st.sampled_from(["", "a_3.png"]),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(["people", "annotations", "images", "image_id", "id", "keypoints", "idx", "category_id"]),
            inner,
        )
    ),
    max_leaves=12,
)


@given(JSON)
@settings(deadline=None, max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_json_of_any_form_gives_a_line_or_joints(tmp_path: Path, document: object) -> None:
    value_or_user_error(tmp_path / "f_1.json", json.dumps(document).encode(), read_joints)
