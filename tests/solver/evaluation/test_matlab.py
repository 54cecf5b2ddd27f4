import io

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from scipy.io import savemat

from core_solver.evaluation.matlab import MatlabError, NewerMatlabError, read_variable

NUMBERS = st.sampled_from([np.float64, np.float32, np.int8, np.uint8, np.int16, np.int32, np.uint16, np.int64])


def saved(value, *, compressed: bool, name: str = "x") -> bytes:
    """A file as scipy writes it, with variables before and after."""
    stream = io.BytesIO()
    savemat(stream, {"first": "some text", name: value, "last": np.eye(2)}, do_compression=compressed)
    return stream.getvalue()


@given(
    value=NUMBERS.flatmap(lambda kind: arrays.arrays(kind, arrays.array_shapes(min_dims=2, max_dims=3, max_side=4))),
    compressed=st.booleans(),
)
def test_numbers_come_back(value, compressed):
    np.testing.assert_array_equal(read_variable(saved(value, compressed=compressed), "x"), value)


@pytest.mark.parametrize("compressed", [False, True])
def test_cells_of_structs_come_back_in_their_places(compressed):
    cells = np.empty((3, 2), object)
    for row, column in np.ndindex(3, 2):
        cells[row, column] = {"points": np.full((2, 5), 10.0 * row + column), "ok": True, "a_longer_name": "text"}
    cells[1, 1] = np.zeros((0, 0))
    read = read_variable(saved(cells, compressed=compressed), "x")
    assert read.shape == (3, 2)
    struct = read[2, 1][0, 0]
    assert list(struct) == ["points", "ok", "a_longer_name"]
    np.testing.assert_array_equal(struct["points"], np.full((2, 5), 21.0))
    assert struct["ok"].item() == 1
    assert read[1, 1].size == 0


def test_a_file_written_by_hand_the_other_way_round():
    """Big-endian, doubles kept as bytes, short tags: as the format's description has it, and scipy never writes it."""

    def element(kind: int, data: bytes) -> bytes:
        return kind.to_bytes(4, "big") + len(data).to_bytes(4, "big") + data + bytes(-len(data) % 8)

    def short(kind: int, data: bytes) -> bytes:
        return len(data).to_bytes(2, "big") + kind.to_bytes(2, "big") + data.ljust(4, b"\0")

    flags = element(6, (6).to_bytes(4, "big") + bytes(4))
    dimensions = element(5, (2).to_bytes(4, "big") + (2).to_bytes(4, "big"))
    matrix = element(14, flags + dimensions + short(1, b"abc") + short(2, bytes([1, 2, 3, 250])))
    content = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x01\x00MI" + matrix
    np.testing.assert_array_equal(read_variable(content, "abc"), [[1, 3], [2, 250]])


def test_what_is_not_there_or_not_matlab_is_refused():
    whole = saved(np.eye(3), compressed=False)
    with pytest.raises(MatlabError, match="no variable y"):
        read_variable(whole, "y")
    for wrong in (b"", b"x" * 500, whole[:200], whole[:-8], b"MATLAB 5.0".ljust(124) + b"\x00\x09IM"):
        with pytest.raises(MatlabError):
            read_variable(wrong, "last")
    with pytest.raises(NewerMatlabError):
        read_variable(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(64), "x")


def test_an_array_that_claims_to_be_huge_is_refused_before_room_is_made():
    cells = np.empty((1, 2), object)
    cells[0] = [1.0, 2.0]
    whole = saved(cells, compressed=False)
    small, huge = np.array([1, 2], "<i4").tobytes(), np.array([2**31 - 1, 2**31 - 1], "<i4").tobytes()
    assert whole.count(small) == 1  # the dimensions of x
    with pytest.raises(MatlabError):
        read_variable(whole.replace(small, huge), "x")


@given(edits=st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=5), compressed=st.booleans())
def test_wrong_bytes_are_read_or_refused(edits, compressed):
    cells = np.empty((2, 2), object)
    cells[:] = [[{"a": 1.0}, {"a": np.eye(3)}], [{"b": "text"}, {"b": np.zeros((2, 17))}]]
    wrong = bytearray(saved(cells, compressed=compressed))
    for place, value in edits:
        wrong[place % len(wrong)] = value
    try:
        read_variable(bytes(wrong), "x")
    except MatlabError as refusal:
        assert str(refusal)  # noqa: PT017 - reading may also succeed
