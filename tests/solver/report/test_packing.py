"""Packed arrays, read back from the block as a page would."""

import base64

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from core_solver.report.packing import PackedArray, Packer


def unpacked(packer: Packer, packed: PackedArray) -> np.ndarray:
    block = base64.b64decode(packer.text())
    count = int(np.prod(packed.shape))
    kind = np.dtype(packed.kind).newbyteorder("<")
    assert packed.at % kind.itemsize == 0
    codes = np.frombuffer(block, kind, count, packed.at).reshape(packed.shape)
    if not packed.step:
        return codes
    values = np.array(packed.low) + np.array(packed.step) * codes.astype(float)
    return np.where(codes == 65535, np.nan, values)


def test_plain_arrays_come_back_and_start_where_typed_arrays_can():
    packer = Packer()
    kept = [
        (packer.plain(values, kind), np.array(values))
        for values, kind in [([1, 2, 3], "uint8"), ([0.25, 7.5], "float64"), ([[65536]], "uint32"), ([], "float32")]
    ]
    for packed, values in kept:
        np.testing.assert_array_equal(unpacked(packer, packed), values)


@given(
    arrays.arrays(float, st.tuples(st.integers(0, 5), st.integers(1, 3)), elements=st.floats(-1e4, 1e4)),
    st.booleans(),
)
def test_quantised_arrays_come_back_within_half_a_step(values, by_column):
    packer = Packer()
    packer.plain([1], "uint8")
    packed = packer.quantised(values, by_column=by_column)
    assert len(packed.step) == (values.shape[1] if by_column else 1)
    error = np.abs(unpacked(packer, packed) - values)
    assert (error <= 0.5001 * np.array(packed.step) + 1e-9).all()


def test_what_has_no_value_stays_without():
    packer = Packer()
    values = np.array([1.0, np.nan, 3.0])
    np.testing.assert_array_equal(np.isnan(unpacked(packer, packer.quantised(values))), np.isnan(values))
    nothing = unpacked(packer, packer.quantised(np.full(4, np.nan)))
    assert np.isnan(nothing).all()
