"""The converter from TensorFlow.js: each operator alone against numpy, then the whole of MoveNet on a real frame."""

from __future__ import annotations

import base64
import json
from typing import TYPE_CHECKING, Any

import numpy as np
import onnxruntime
import pytest

from core_solver.errors import ModelError
from core_solver.perception.tfjs import convert, convert_file, in_order, read_node
from core_solver.perception.tfjs_operators import OPERATORS, Node

if TYPE_CHECKING:
    from pathlib import Path

    from core_solver.perception.store import ModelStore

Arrays = dict[str, np.ndarray]
RNG = np.random.default_rng(7)
F32, I32, BOOL = np.float32, np.int32, np.bool_
TYPE_NAMES = {np.dtype(F32): "DT_FLOAT", np.dtype(I32): "DT_INT32", np.dtype(BOOL): "DT_BOOL"}


def integer(value: int) -> dict[str, Any]:
    return {"i": str(value)}


def integers(*values: int) -> dict[str, Any]:
    return {"list": {"i": [str(value) for value in values]}}


def text(value: str) -> dict[str, Any]:
    return {"s": base64.b64encode(value.encode()).decode()}


def texts(*values: str) -> dict[str, Any]:
    return {"list": {"s": [base64.b64encode(value.encode()).decode() for value in values]}}


def floats(*shape: int) -> np.ndarray:
    return RNG.normal(size=shape).astype(F32)


def placeholder(name: str, like: np.ndarray) -> Node:
    open_sizes = {"shape": {"dim": [{"size": "-1"} for _ in like.shape]}}
    return Node(name, "Placeholder", (), {"dtype": {"type": TYPE_NAMES[like.dtype]}, "shape": open_sizes})


def run_graph(nodes: list[Node], weights: Arrays, feeds: Arrays) -> list[np.ndarray]:
    model = convert(nodes, weights)
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return [np.asarray(value) for value in session.run(None, feeds)]


def run_operator(kind: str, attributes: dict[str, Any], feeds: Arrays, weights: Arrays | None = None) -> np.ndarray:
    """The first output of one operator; inputs in the order of their names, run-time ones with open sizes."""
    weights = weights or {}
    names = tuple(sorted([*feeds, *weights]))
    nodes = [placeholder(name, values) for name, values in feeds.items()]
    nodes += [Node(name, "Const", (), {}) for name in weights]
    nodes.append(Node("result", kind, names, attributes))
    return run_graph(nodes, weights, feeds)[0]


A, B = floats(3, 4), floats(3, 4)
POSITIVE = np.abs(A) + F32(0.5)

ELEMENTWISE = {
    "Abs": ((A,), np.abs(A)),
    "AddN": ((A, B, A), A + B + A),
    "AddV2": ((A, B), A + B),
    "Equal": ((np.array([1, 2, 3], I32), np.array([1, 0, 3], I32)), np.array([True, False, True])),
    "Exp": ((A,), np.exp(A)),
    "Greater": ((A, B), A > B),
    "GreaterEqual": ((np.array([1, 2, 3], F32), np.array([1, 3, 2], F32)), np.array([True, False, True])),
    "Identity": ((A,), A),
    "Less": ((A, B), A < B),
    "LogicalAnd": ((A > 0, B > 0), (A > 0) & (B > 0)),
    "Maximum": ((A, B), np.maximum(A, B)),
    "Minimum": ((A, B), np.minimum(A, B)),
    "Mul": ((A, B), A * B),
    "RealDiv": ((A, POSITIVE), A / POSITIVE),
    "Reciprocal": ((POSITIVE,), 1 / POSITIVE),
    "Select": ((A > 0, A, B), np.where(A > 0, A, B)),
    "Shape": ((floats(2, 5, 3),), np.array([2, 5, 3])),
    "Sigmoid": ((A,), 1 / (1 + np.exp(-A))),
    "Size": ((floats(2, 5),), np.array(10)),
    "SquaredDifference": ((A, B), (A - B) ** 2),
    "Sub": ((A, B), A - B),
    "Range": ((np.array(1, F32), np.array(7, F32), np.array(2, F32)), np.array([1, 3, 5], F32)),
}


@pytest.mark.parametrize("kind", sorted(ELEMENTWISE))
def test_operator_without_attributes(kind: str) -> None:
    inputs, expected = ELEMENTWISE[kind]
    result = run_operator(kind, {}, {f"in{index}": np.asarray(values) for index, values in enumerate(inputs)})
    np.testing.assert_allclose(result, expected, rtol=1e-6)


@pytest.mark.parametrize("dtype", [I32, F32])
def test_floor_division_goes_towards_minus_infinity(dtype: type) -> None:
    a, b = np.array([7, -7, 7, -7, 6], dtype), np.array([2, 2, -2, -2, 3], dtype)
    result = run_operator("FloorDiv", {"T": {"type": TYPE_NAMES[np.dtype(dtype)]}}, {"a": a, "b": b})
    np.testing.assert_array_equal(result, a // b)


def test_cast() -> None:
    result = run_operator("Cast", {"DstT": {"type": "DT_FLOAT"}}, {"a": np.array([True, False])})
    assert result.dtype == F32
    np.testing.assert_array_equal(result, [1, 0])


def reference_convolution(image: np.ndarray, kernel: np.ndarray, stride: int, same: bool) -> np.ndarray:
    """Direct NHWC convolution by TensorFlow's definition, written as loops: (1, H, W, in) by (h, w, in, out)."""
    size = kernel.shape[0]
    out_size = [-(-n // stride) if same else -(-(n - size + 1) // stride) for n in image.shape[1:3]]
    pads = [max((o - 1) * stride + size - n, 0) if same else 0 for o, n in zip(out_size, image.shape[1:3], strict=True)]
    padded = np.pad(image[0], [(p // 2, p - p // 2) for p in pads] + [(0, 0)])
    result = np.zeros((1, *out_size, kernel.shape[3]))
    for y in range(out_size[0]):
        for x in range(out_size[1]):
            window = padded[y * stride : y * stride + size, x * stride : x * stride + size]
            result[0, y, x] = np.einsum("hwi,hwio->o", window, kernel)
    return result


@pytest.mark.parametrize(("stride", "padding"), [(1, "SAME"), (2, "SAME"), (1, "VALID"), (2, "VALID")])
@pytest.mark.parametrize("height", [8, 9])
def test_fused_convolution(stride: int, padding: str, height: int) -> None:
    image, kernel, bias = floats(1, height, 7, 3), floats(3, 3, 3, 5), floats(5)
    attributes = {
        "strides": integers(1, stride, stride, 1),
        "dilations": integers(1, 1, 1, 1),
        "padding": text(padding),
        "fused_ops": texts("BiasAdd", "Relu6"),
    }
    result = run_operator("_FusedConv2D", attributes, {"image": image}, {"kernel": kernel, "l_bias": bias})
    expected = np.clip(reference_convolution(image, kernel, stride, padding == "SAME") + bias, 0, 6)
    np.testing.assert_allclose(result, expected, atol=1e-4)


@pytest.mark.parametrize("kind", ["DepthwiseConv2dNative", "FusedDepthwiseConv2dNative"])
def test_depthwise_convolution_keeps_channels_apart(kind: str) -> None:
    image, kernel = floats(1, 6, 6, 4), floats(3, 3, 4, 1)
    attributes = {"strides": integers(1, 2, 2, 1), "dilations": integers(1, 1, 1, 1), "padding": text("SAME")}
    apart = np.zeros((3, 3, 4, 4), F32)
    apart[:, :, range(4), range(4)] = kernel[..., 0]
    result = run_operator(kind, attributes, {"image": image}, {"kernel": kernel})
    np.testing.assert_allclose(result, reference_convolution(image, apart, 2, same=True), atol=1e-4)


def test_max_pool() -> None:
    image = floats(1, 6, 5, 2)
    attributes = {"ksize": integers(1, 3, 3, 1), "strides": integers(1, 1, 1, 1), "padding": text("SAME")}
    padded = np.pad(image, [(0, 0), (1, 1), (1, 1), (0, 0)], constant_values=-np.inf)
    expected = np.max([padded[:, y : y + 6, x : x + 5] for y in range(3) for x in range(3)], axis=0)
    np.testing.assert_array_equal(run_operator("MaxPool", attributes, {"image": image}), expected)


def test_resize_with_half_pixel_centres() -> None:
    """Doubling a row [0, 4] samples it at -1/4, 1/4, 3/4, 5/4 and holds the borders."""
    image = np.array([0, 4], F32).reshape(1, 1, 2, 1)
    size = np.array([1, 4], I32)
    result = run_operator("ResizeBilinear", {"half_pixel_centers": {"b": True}}, {"image": image}, {"size": size})
    np.testing.assert_allclose(result.ravel(), [0, 1, 3, 4], atol=1e-6)


@pytest.mark.parametrize(
    ("kind", "attributes", "values", "second", "expected"),
    [
        ("Reshape", {}, A, np.array([2, -1], I32), A.reshape(2, 6)),
        ("ExpandDims", {}, A, np.array(1, I32), A[:, None]),
        ("Tile", {}, A, np.array([2, 3], I32), np.tile(A, (2, 3))),
        ("Max", {"keep_dims": {"b": True}}, A, np.array(0, I32), A.max(0, keepdims=True)),
        ("Sum", {}, A, np.array([0, 1], I32), A.sum()),
        ("ArgMax", {}, A, np.array(1, I32), A.argmax(1)),
        ("GatherNd", {}, A, np.array([[0, 1], [2, 3]], I32), A[[0, 2], [1, 3]]),
    ],
)
def test_operator_with_constant(
    kind: str, attributes: dict[str, Any], values: np.ndarray, second: np.ndarray, expected: np.ndarray
) -> None:
    result = run_operator(kind, attributes, {"a": values}, {"b": second})
    np.testing.assert_allclose(result, expected, rtol=1e-5)
    assert result.dtype != np.int64, "TensorFlow's integers have 32 bits, and the next operator relies on it"


def test_fill_with_a_size_known_at_run_time() -> None:
    result = run_operator("Fill", {}, {"a_size": np.array([2, 3], I32), "b_value": np.array(4, F32)})
    np.testing.assert_array_equal(result, np.full((2, 3), 4))


def test_squeeze_of_named_axes() -> None:
    result = run_operator("Squeeze", {"squeeze_dims": integers(0)}, {"a": floats(1, 3, 1)})
    assert result.shape == (3, 1)


def test_pack_and_concatenate() -> None:
    packed = run_operator("Pack", {"axis": integer(1)}, {"a": A, "b": B})
    np.testing.assert_array_equal(packed, np.stack([A, B], 1))
    joined = run_operator("ConcatV2", {}, {"a": A, "b": B}, {"c_axis": np.array(1, I32)})
    np.testing.assert_array_equal(joined, np.concatenate([A, B], 1))


def outputs_of(kind: str, attributes: dict[str, Any], count: int, feeds: Arrays, weights: Arrays) -> list[np.ndarray]:
    """All outputs of an operator that has several, each read by an Identity."""
    names = tuple(sorted([*feeds, *weights]))
    nodes = [placeholder(name, values) for name, values in feeds.items()]
    nodes += [Node(name, "Const", (), {}) for name in weights]
    nodes.append(Node("many", kind, names, attributes))
    sources = [read_node({"name": f"out{i}", "op": "Identity", "input": [f"many:{i}"]}) for i in range(count)]
    return run_graph([*nodes, *sources], weights, feeds)


def test_unpack_split_and_top_k() -> None:
    parts = outputs_of("Unpack", {"axis": integer(0), "num": integer(3)}, 3, {"a": A}, {})
    np.testing.assert_array_equal(parts, A)
    halves = outputs_of("Split", {"num_split": integer(2)}, 2, {"b": A}, {"a_axis": np.array(1, I32)})
    np.testing.assert_array_equal(np.stack(halves), np.stack([A[:, :2], A[:, 2:]]))
    values, indices = outputs_of("TopKV2", {}, 2, {"a": A}, {"k": np.array(2, I32)})
    np.testing.assert_array_equal(indices, np.argsort(-A, axis=1)[:, :2])
    np.testing.assert_array_equal(values, -np.sort(-A, axis=1)[:, :2])


CUBE = floats(4, 5, 6)


@pytest.mark.parametrize(
    ("begin", "end", "step", "masks", "expected"),
    [
        ([1, 0, 2], [3, 5, 6], [1, 2, 3], {}, CUBE[1:3, 0:5:2, 2:6:3]),
        ([1, 9, 9], [2, 9, 9], [1, 1, 1], {"begin_mask": 6, "end_mask": 6, "shrink_axis_mask": 1}, CUBE[1]),
        ([0, -1, 0], [0, 0, 0], [1, 1, 1], {"begin_mask": 5, "end_mask": 5, "shrink_axis_mask": 2}, CUBE[:, -1]),
        ([0, 0, 0], [0, 0, 0], [1, 1, 1], {"begin_mask": 5, "end_mask": 5, "new_axis_mask": 2}, CUBE[:, None, :]),
        ([0] * 4, [0] * 4, [1] * 4, {"begin_mask": 12, "end_mask": 12, "new_axis_mask": 3}, CUBE[None, None]),
        ([1, 1, 0, 2], [9, 2, 0, 3], [1] * 4, {"new_axis_mask": 4, "shrink_axis_mask": 10}, CUBE[1:, 1, None, 2]),
        ([0], [0], [-1], {"begin_mask": 1, "end_mask": 1}, CUBE[::-1]),
    ],
)  # fmt: skip
def test_strided_slice(
    begin: list[int], end: list[int], step: list[int], masks: dict[str, int], expected: np.ndarray
) -> None:
    bounds = {f"b{index}": np.array(values, I32) for index, values in enumerate((begin, end, step))}
    attributes = {key: integer(value) for key, value in masks.items()}
    result = run_operator("StridedSlice", attributes, {"a": CUBE}, bounds)
    np.testing.assert_array_equal(result, expected)


def test_every_operator_of_the_table_is_tested_here(request: pytest.FixtureRequest) -> None:
    source = request.path.read_text(encoding="utf-8")
    assert [kind for kind in OPERATORS if f'"{kind}"' not in source] == []


def test_unknown_operator_is_named() -> None:
    with pytest.raises(ModelError, match="operator Cook is not supported"):
        run_operator("Cook", {}, {"a": A})


def test_unsupported_activation_is_named() -> None:
    attributes = {"padding": text("SAME"), "fused_ops": texts("Elu")}
    with pytest.raises(ModelError, match="fused Elu"):
        run_operator("_FusedConv2D", attributes, {"a": floats(1, 4, 4, 1)}, {"b": floats(1, 1, 1, 1)})


def test_order_puts_producers_first_even_in_deep_graphs() -> None:
    chain = [Node(f"n{index}", "Identity", (f"n{index + 1}",), {}) for index in range(5000)]
    names = [node.name for node in in_order([*chain, Node("n5000", "Const", (), {})])]
    assert names == [f"n{index}" for index in range(5000, -1, -1)]


def write_model(folder: Path, data: bytes) -> Path:
    """A model that adds a half-precision weight and an integer one to its input."""
    weights = [
        {"name": "half", "shape": [2], "dtype": "float32", "quantization": {"dtype": "float16"}},
        {"name": "one", "shape": [], "dtype": "float32"},
    ]
    shape = {"shape": {"dim": [{"size": "2"}]}}
    nodes = [
        {"name": "x", "op": "Placeholder", "attr": {"dtype": {"type": "DT_FLOAT"}, "shape": shape}},
        {"name": "half", "op": "Const"},
        {"name": "one", "op": "Const"},
        {"name": "y", "op": "AddN", "input": ["x", "half:0", "one", "^x"]},
    ]
    manifest = [{"paths": ["model.bin"], "weights": weights}]
    (folder / "model.bin").write_bytes(data)
    file = folder / "model.json"
    file.write_text(json.dumps({"modelTopology": {"node": nodes}, "weightsManifest": manifest}))
    return file


def test_file_with_half_precision_weights(tmp_path: Path) -> None:
    data = np.array([0.5, -2], np.float16).tobytes() + F32(1).tobytes()
    convert_file(write_model(tmp_path, data), tmp_path / "model.onnx")
    session = onnxruntime.InferenceSession(str(tmp_path / "model.onnx"), providers=["CPUExecutionProvider"])
    np.testing.assert_array_equal(np.asarray(session.run(None, {"x": np.array([1, 1], F32)})[0]), [2.5, 0])


def test_cut_off_weights_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ModelError, match="cut off"):
        convert_file(write_model(tmp_path, b"\0\0\0"), tmp_path / "model.onnx")


def test_foreign_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text('{"hello": 1}')
    with pytest.raises(ModelError, match=r"model\.json is not a readable TensorFlow\.js graph model"):
        convert_file(tmp_path / "model.json", tmp_path / "model.onnx")


@pytest.mark.models
@pytest.mark.shared
@pytest.mark.parametrize("size", [(384, 512), (576, 768)])
def test_movenet_finds_the_people_of_a_street(models: ModelStore, shared_data: Path, size: tuple[int, int]) -> None:
    """One graph at two sizes: at least three upright people, head above ankles, all inside the picture."""
    import cv2

    capture = cv2.VideoCapture(str(shared_data / "clips" / "street_vtest.avi"))
    capture.set(cv2.CAP_PROP_POS_FRAMES, 100)
    frame = cv2.cvtColor(cv2.resize(capture.read()[1], size[::-1]), cv2.COLOR_BGR2RGB)
    session = onnxruntime.InferenceSession(str(models.require("movenet-multipose")), providers=["CPUExecutionProvider"])
    found = np.asarray(session.run(None, {"input": frame[None].astype(I32)})[0])
    assert found.shape == (1, 6, 56)
    people = found[0][found[0, :, 55] > 0.25]
    assert len(people) >= 3
    keypoints = people[:, :51].reshape(-1, 17, 3)
    assert ((keypoints[..., :2] > -0.05) & (keypoints[..., :2] < 1.05)).all()
    assert (keypoints[:, 0, 0] < keypoints[:, 15:17, 0].mean(1)).all(), "noses are above ankles"
