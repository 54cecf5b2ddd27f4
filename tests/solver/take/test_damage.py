"""Every kind of damage is refused with a TakeError that names the reason, and by no other exception."""

import copy
import dataclasses
import json
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from core_solver.errors import TakeError
from core_solver.take import Take, read_take, write_take
from tests.solver.take.random_takes import assert_same_take, random_take

TAKE = random_take(5)
FUZZ = settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])

Arrays = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    path = tmp_path_factory.mktemp("good") / "take.npz"
    write_take(path, TAKE)
    return path.read_bytes()


@pytest.fixture
def arrays(good: bytes, tmp_path: Path) -> Arrays:
    (tmp_path / "good.npz").write_bytes(good)
    with np.load(tmp_path / "good.npz") as archive:
        return dict(archive)


def document_of(arrays: Arrays) -> dict[str, Any]:
    return json.loads(arrays["meta"].tobytes())


def set_document(arrays: Arrays, document: Any) -> None:
    arrays["meta"] = np.frombuffer(json.dumps(document).encode(), np.uint8)


def read_arrays(folder: Path, arrays: Arrays) -> Take:
    with (folder / "bad.npz").open("wb") as stream:
        np.savez(stream, **arrays)  # pyright: ignore[reportArgumentType]
    return read_take(folder / "bad.npz")


def read_bytes(folder: Path, content: bytes) -> Take:
    (folder / "bad.npz").write_bytes(content)
    return read_take(folder / "bad.npz")


def attempt(read: Callable[[], Take]) -> tuple[Take | None, str]:
    """The take, or why it was refused; anything but a TakeError is the test's failure."""
    try:
        return read(), ""
    except TakeError as error:
        return None, str(error)


def assert_refused_or_unchanged(folder: Path, content: bytes) -> None:
    """Dates and attributes of the archive's members carry nothing of ours: damage there may pass."""
    take, refusal = attempt(lambda: read_bytes(folder, content))
    assert "\n" not in refusal
    if take is not None:
        assert_same_take(take, TAKE)


# --- damaged bytes ---


@FUZZ
@given(st.data())
def test_a_file_cut_anywhere_is_refused(good: bytes, tmp_path: Path, data: st.DataObject) -> None:
    length = data.draw(st.integers(0, len(good) - 1))
    with pytest.raises(TakeError, match=r"^bad\.npz: not a readable \.npz archive"):
        read_bytes(tmp_path, good[:length])


@settings(FUZZ, max_examples=300)
@given(st.data())
def test_flipped_bytes_are_refused_or_change_nothing(good: bytes, tmp_path: Path, data: st.DataObject) -> None:
    spoiled = bytearray(good)
    for _ in range(data.draw(st.integers(1, 4))):
        place = data.draw(st.integers(0, len(good) - 1))
        spoiled[place] ^= data.draw(st.integers(1, 255))
    assert_refused_or_unchanged(tmp_path, bytes(spoiled))


@settings(FUZZ, max_examples=200)
@given(st.data())
def test_a_damaged_directory_of_the_archive_is_refused_or_changes_nothing(
    good: bytes, tmp_path: Path, data: st.DataObject
) -> None:
    """The archive's own tables are short beside the arrays: aim at them."""
    start = good.index(b"PK\x01\x02")
    spoiled = bytearray(good)
    spoiled[data.draw(st.integers(start, len(good) - 1))] = data.draw(st.integers(0, 255))
    assert_refused_or_unchanged(tmp_path, bytes(spoiled))


def write_with_header(path: Path, arrays: Arrays, key: str, header: bytes) -> None:
    """An archive whose checksums are right but one of whose arrays is not."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w") as member:
                if name == key:
                    member.write(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
                else:
                    np.lib.format.write_array(member, array)


@FUZZ
@given(st.binary(max_size=60), st.sampled_from(["times", "people/1/theta"]))
def test_a_member_with_any_header_is_refused(arrays: Arrays, tmp_path: Path, header: bytes, key: str) -> None:
    write_with_header(tmp_path / "bad.npz", arrays, key, header)
    with pytest.raises(TakeError, match="archive"):
        read_take(tmp_path / "bad.npz")


@pytest.mark.parametrize(
    "header",
    [
        b" " * 12_000,
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000000,), }",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
        b"{'descr': '<f8', 'fortran_order': False, 'shape': (99999999999999999999999,), }",
    ],
)
def test_a_header_that_asks_for_too_much_is_refused_in_one_line(arrays: Arrays, tmp_path: Path, header: bytes) -> None:
    write_with_header(tmp_path / "bad.npz", arrays, "times", header)
    _, refusal = attempt(lambda: read_take(tmp_path / "bad.npz"))
    assert "archive" in refusal
    assert "\n" not in refusal


@pytest.mark.parametrize(
    ("content", "reason"),
    [(b"", "archive"), (b"not an archive", "archive"), (pickle.dumps([1, 2]), "archive"), (b"PK\x03\x04", "archive")],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, reason: str) -> None:
    with pytest.raises(TakeError, match=reason) as caught:
        read_bytes(tmp_path, content)
    assert "pickle" not in str(caught.value), "what numpy would have done helps nobody"


def test_a_missing_file_and_a_folder_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TakeError, match=r"away\.npz: no such file"):
        read_take(tmp_path / "away.npz")
    with pytest.raises(TakeError, match="directory"):
        read_take(tmp_path)


def test_a_lone_array_and_a_foreign_archive_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "one.npy", np.zeros(3))
    np.savez(tmp_path / "other.npz", theta=np.zeros((4, 24, 3)))
    for name in ("one.npy", "other.npz"):
        with pytest.raises(TakeError, match="not a Scene-Aware Mocap take"):
            read_take(tmp_path / name)


def test_a_member_that_is_no_array_is_refused(good: bytes, tmp_path: Path) -> None:
    (tmp_path / "bad.npz").write_bytes(good)
    with zipfile.ZipFile(tmp_path / "bad.npz", "a") as archive:
        archive.writestr("readme.txt", "hello")
    with pytest.raises(TakeError, match=r"readme\.txt is not an array"):
        read_take(tmp_path / "bad.npz")


@pytest.mark.parametrize("key", ["people/0/theta", "times", "meta", "their/own"])
def test_pickled_objects_are_never_loaded(arrays: Arrays, tmp_path: Path, key: str) -> None:
    arrays[key] = np.array([Bomb()], dtype=object)
    with pytest.raises(TakeError, match="allow_pickle"):
        read_arrays(tmp_path, arrays)
    assert not Bomb.went_off


class Bomb:
    """Tells when somebody unpickles it."""

    went_off = False

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return setattr, (Bomb, "went_off", True)


# --- damaged arrays ---


ALL_KEYS = [
    "meta", "times",
    *(f"people/1/{f}" for f in (
        "theta", "gamma", "betas", "scale", "valid", "confidence", "contacts", "rest_joints", "rest_vertices", "faces",
        "weight_joints", "weights")),
    *(f"scene/{f}" for f in ("points", "colors", "depth", "z_near", "z_far")),
]  # fmt: skip
FLOAT_KEYS = [k for k in ALL_KEYS if k.split("/")[-1] not in {"meta", "valid", "faces", "weight_joints", "colors"}]


@pytest.mark.parametrize("key", ALL_KEYS)
def test_a_missing_entry_is_named(arrays: Arrays, tmp_path: Path, key: str) -> None:
    del arrays[key]
    with pytest.raises(TakeError, match=key):
        read_arrays(tmp_path, arrays)


@pytest.mark.parametrize("key", ALL_KEYS)
@pytest.mark.parametrize("kind", ["<U3", "complex64", "float16", "int64", "bool", "datetime64[s]", "V8"])
def test_an_entry_of_another_type_is_named(arrays: Arrays, tmp_path: Path, key: str, kind: str) -> None:
    if arrays[key].dtype == np.dtype(kind):
        kind = "int8"
    arrays[key] = np.zeros(arrays[key].shape, kind)
    with pytest.raises(TakeError, match=f"entry {key} holds"):
        read_arrays(tmp_path, arrays)


@pytest.mark.parametrize("key", ALL_KEYS)
def test_an_entry_with_an_axis_more_is_named(arrays: Arrays, tmp_path: Path, key: str) -> None:
    arrays[key] = arrays[key][..., None]
    with pytest.raises(TakeError, match=f"entry {key} "):
        read_arrays(tmp_path, arrays)


@pytest.mark.parametrize("key", [k for k in ALL_KEYS if k not in {"meta", "scene/depth", "people/1/scale"}])
def test_an_entry_that_is_too_long_is_refused(arrays: Arrays, tmp_path: Path, key: str) -> None:
    """A row more of any array disagrees with another; free lengths (faces) get a column more."""
    axis = 1 if key.endswith("faces") else 0
    arrays[key] = np.concatenate([arrays[key], arrays[key].take([0], axis)], axis)
    with pytest.raises(TakeError, match=r"shape|increasing"):
        read_arrays(tmp_path, arrays)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("key", FLOAT_KEYS)
def test_values_that_are_not_finite_are_named(arrays: Arrays, tmp_path: Path, key: str, value: float) -> None:
    arrays[key] = np.array(arrays[key])
    arrays[key][(0,) * arrays[key].ndim] = value
    if key == "scene/depth" and np.isnan(value):  # never seen, by design
        read_arrays(tmp_path, arrays)
        return
    with pytest.raises(TakeError, match=f"{key} .*not finite"):
        read_arrays(tmp_path, arrays)


def overwrite(key: str, index: Any, value: Any) -> Callable[[Arrays], None]:
    def spoil(arrays: Arrays) -> None:
        arrays[key] = np.array(arrays[key])
        arrays[key][index] = value

    return spoil


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (overwrite("times", 1, 0.0), "increasing"),
        (overwrite("people/0/scale", (), 0.0), "scale of person 0"),
        (overwrite("people/0/scale", (), -1.0), "scale of person 0"),
        (overwrite("people/1/faces", (0, 0), 5), "faces of person 1"),
        (overwrite("people/1/faces", (0, 0), -1), "faces of person 1"),
        (overwrite("people/1/weight_joints", (0, 0), 24), "name joints"),
        (overwrite("people/1/weights", 0, 0.5), "sum to 1"),
    ],
)
def test_impossible_values_are_refused(
    arrays: Arrays, tmp_path: Path, spoil: Callable[[Arrays], None], reason: str
) -> None:
    spoil(arrays)
    with pytest.raises(TakeError, match=reason):
        read_arrays(tmp_path, arrays)


def test_a_take_of_no_frames_is_refused(tmp_path: Path) -> None:
    take = random_take(frames=1)
    with pytest.raises(TakeError, match="at least one frame"):
        write_take(tmp_path / "take.npz", dataclasses.replace(take, times=np.zeros(0)))


def test_values_too_large_for_the_file_are_refused_on_writing(tmp_path: Path) -> None:
    huge = dataclasses.replace(TAKE.people[0], theta=np.full((3, 24, 3), 1e300))
    with pytest.raises(TakeError, match=r"theta .*not finite"):
        write_take(tmp_path / "take.npz", dataclasses.replace(TAKE, people=(huge,)))


# --- damaged meta ---


@pytest.mark.parametrize(
    ("path", "value", "reason"),
    [
        (["format"], "somebody/else", "not a Scene-Aware Mocap take"),
        (["version"], 2, "newer than this program"),
        (["version"], 0, "version"),
        (["version"], True, "version"),
        (["version"], "1", "version"),
        (["frame_rate"], [30, 0], "meta entry is damaged"),
        (["frame_rate"], [-30, 1], "frame rate"),
        (["frame_step"], 0, "frame step"),
        (["frame_range"], [-1, 3], "first frame"),
        (["gravity"], [0, 0.5, 0], "gravity must be a unit vector"),
        (["gravity"], [0, 1], "meta entry is damaged"),
        (["ground", "normal"], [0, -2, 0], "ground normal must be a unit vector"),
        (["ground", "offset"], 1e999, "ground"),
        (["joint_names"], ["a"] * 24, "differently named"),
        (["parents", 5], 9, "follow their parents"),
        (["parents", 0], 0, "follow their parents"),
        (["camera", "fx"], -1, "focal lengths"),
        (["camera", "fx"], 1e999, "finite"),
        (["camera", "distortion", 2], 1e999, "finite"),
        (["camera", "width"], 1e999, "meta entry is damaged"),
        (["camera", "height"], 0, "image size"),
        (["solver", "settings", "every"], [1e999], "meta entry is damaged"),
        (["somebody's own"], float("nan"), "meta entry is damaged"),
        (["people"], 5, "list of people"),
        (["people"], None, "list of people"),
        (["people", 1], "Ann", "list of people"),
        (["people", 1, "id"], 1e999, "facts of person 1"),
        (["people", 1, "id"], 3, "same id"),
        (["people", 1, "colour"], [1, 1], "facts of person 1"),
        (["people", 1, "colour", 0], 255, "colour of person 1"),
        (["people", 0, "height_m"], -1, "height of person 0"),
        (["people", 0, "height_m"], 1e999, "height of person 0"),
    ],
)
def test_damaged_facts_are_refused(arrays: Arrays, tmp_path: Path, path: list[Any], value: Any, reason: str) -> None:
    document = document_of(arrays)
    place = document
    for step in path[:-1]:
        place = place[step]
    place[path[-1]] = value
    set_document(arrays, document)
    with pytest.raises(TakeError, match=reason):
        read_arrays(tmp_path, arrays)


def test_ground_that_faces_down_is_refused(arrays: Arrays, tmp_path: Path) -> None:
    document = document_of(arrays)
    document["ground"]["normal"] = document["gravity"]
    set_document(arrays, document)
    with pytest.raises(TakeError, match="against gravity"):
        read_arrays(tmp_path, arrays)


@pytest.mark.parametrize("text", [b"", b"\xff\xfe", b"{", b"[]", b"null", b'"format"', b"[" * 100_000])
def test_meta_that_is_not_our_json_is_refused(arrays: Arrays, tmp_path: Path, text: bytes) -> None:
    arrays["meta"] = np.frombuffer(text, np.uint8)
    with pytest.raises(TakeError, match=r"not a (Scene-Aware Mocap )?take"):
        read_arrays(tmp_path, arrays)


def places(document: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The path of every value in a JSON document."""
    steps = (
        document.items() if isinstance(document, dict) else enumerate(document) if isinstance(document, list) else ()
    )
    return [path, *(place for step, value in steps for place in places(value, (*path, step)))]


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.just(10**400) | st.just(-1),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=3), inner, max_size=3),
    max_leaves=6,
)


@settings(FUZZ, max_examples=150)
@given(data=st.data(), value=JSON_VALUES)
def test_any_value_anywhere_in_meta_is_refused_or_can_be_written_again(
    arrays: Arrays, tmp_path: Path, data: st.DataObject, value: Any
) -> None:
    arrays = dict(arrays)
    document = copy.deepcopy(document_of(arrays))
    *way, last = data.draw(st.sampled_from(places(document)[1:]))
    place = document
    for step in way:
        place = place[step]
    place[last] = value
    set_document(arrays, document)
    take, refusal = attempt(lambda: read_arrays(tmp_path, arrays))
    if take is None:
        assert "\n" not in refusal
        return
    write_take(tmp_path / "again.npz", take)
    assert_same_take(read_take(tmp_path / "again.npz"), take)
