"""TensorFlow's operators in ONNX: one small function each, and only those that MoveNet needs.

Image tensors are NHWC in TensorFlow and NCHW in ONNX, so every image operator is written between two transpositions;
onnxruntime removes the pairs that cancel. Sizes that the network computes at run time stay computed, so one converted
graph takes any size.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from core_solver.errors import ModelError

if TYPE_CHECKING:
    import onnx

SLICE_END = 2**31 - 1
# The values of onnx.TensorProto.DataType, written out so that this module loads without onnx.
ONNX_TYPES = {"DT_FLOAT": 1, "DT_INT32": 6, "DT_INT64": 7, "DT_BOOL": 9}
INT32, INT64 = ONNX_TYPES["DT_INT32"], ONNX_TYPES["DT_INT64"]


@dataclass(frozen=True)
class Node:
    """One operator of a TensorFlow graph: where it takes its tensors from, and its attributes."""

    name: str
    kind: str
    inputs: tuple[str, ...]
    attributes: Mapping[str, Any]

    def flag(self, key: str) -> bool:
        """A boolean attribute; false when absent."""
        return bool(self.attributes.get(key, {}).get("b", False))

    def integer(self, key: str, default: int = 0) -> int:
        """An integer attribute."""
        return int(self.attributes.get(key, {}).get("i", default))

    def integers(self, key: str) -> list[int]:
        """A list of integers; empty when absent."""
        return [int(value) for value in self.attributes.get(key, {}).get("list", {}).get("i", [])]

    def text(self, key: str, default: str = "") -> str:
        """A text attribute (base64 in the file)."""
        value = self.attributes.get(key, {}).get("s")
        return default if value is None else base64.b64decode(value).decode()

    def texts(self, key: str) -> list[str]:
        """A list of texts; empty when absent."""
        return [base64.b64decode(value).decode() for value in self.attributes.get(key, {}).get("list", {}).get("s", [])]

    def type_name(self, key: str) -> str:
        """A type attribute such as `DT_FLOAT`; empty when absent."""
        return str(self.attributes.get(key, {}).get("type", ""))

    def spatial(self, key: str) -> list[int]:
        """Height and width entries of an NHWC list such as `strides`."""
        return self.integers(key)[1:3] or [1, 1]


@dataclass
class GraphBuilder:
    """The ONNX graph while it grows. Tensors are known by their TensorFlow names; helpers get names of their own."""

    constants: dict[str, np.ndarray] = field(default_factory=dict)
    nodes: list[onnx.NodeProto] = field(default_factory=list)
    made: int = 0

    def fresh(self, stem: str) -> str:
        """A tensor name that no TensorFlow graph uses."""
        self.made += 1
        return f"~{stem}_{self.made}"

    def constant(self, values: Any, dtype: type[np.generic] | None = None) -> str:
        """Store values as an initialiser and return its name."""
        name = self.fresh("constant")
        self.constants[name] = np.ascontiguousarray(values, dtype).reshape(np.shape(values))
        return name

    def integers(self, values: Sequence[int] | np.ndarray) -> str:
        """A one-dimensional int64 constant, as ONNX wants its axes and sizes."""
        return self.constant(np.atleast_1d(np.asarray(values, np.int64)))

    def add(self, kind: str, inputs: Sequence[str], output: str | None = None, **attributes: Any) -> str:
        """Append an operator with one output and return that output's name."""
        return self.add_many(kind, inputs, [output or self.fresh(kind)], **attributes)[0]

    def add_many(self, kind: str, inputs: Sequence[str], outputs: Sequence[str], **attributes: Any) -> list[str]:
        """Append an operator with several outputs."""
        from onnx import helper  # noqa: PLC0415  (heavy, and only needed while converting)

        self.nodes.append(helper.make_node(kind, list(inputs), list(outputs), **attributes))
        return list(outputs)

    def value(self, node: Node, index: int) -> np.ndarray:
        """A constant input.

        Raises:
            ModelError: the input is computed at run time.
        """
        try:
            return self.constants[node.inputs[index]]
        except KeyError:
            raise ModelError(f"cannot convert {node.kind} '{node.name}': its input {index} is not constant") from None

    def as_int64(self, name: str) -> str:
        """The same integers as int64."""
        if name in self.constants:
            return self.constant(self.constants[name].astype(np.int64))
        return self.add("Cast", [name], to=INT64)

    def to_nchw(self, name: str) -> str:
        """An image tensor with its channels before height and width."""
        return self.add("Transpose", [name], perm=[0, 3, 1, 2])

    def to_nhwc(self, name: str, output: str) -> None:
        """Write an NCHW tensor as the NHWC tensor `output`."""
        self.add("Transpose", [name], output, perm=[0, 2, 3, 1])


Operator = Callable[[GraphBuilder, Node], None]


def same(kind: str) -> Operator:
    """An operator that ONNX has under another name with the same meaning."""

    def convert_same(graph: GraphBuilder, node: Node) -> None:
        graph.add(kind, node.inputs, node.name)

    return convert_same


def floor_divide(graph: GraphBuilder, node: Node) -> None:
    """Divide towards minus infinity. ONNX divides integers towards zero, so the remainder goes first."""
    a, b = node.inputs
    if node.type_name("T") == "DT_FLOAT":
        graph.add("Floor", [graph.add("Div", [a, b])], node.name)
        return
    remainder = graph.add("Mod", [a, b])
    graph.add("Div", [graph.add("Sub", [a, remainder]), b], node.name)


def squared_difference(graph: GraphBuilder, node: Node) -> None:
    """(a - b)^2."""
    difference = graph.add("Sub", node.inputs)
    graph.add("Mul", [difference, difference], node.name)


def cast(graph: GraphBuilder, node: Node) -> None:
    """Change the type."""
    graph.add("Cast", node.inputs, node.name, to=ONNX_TYPES[node.type_name("DstT")])


def measured(kind: str) -> Operator:
    """`Shape` and `Size`: int64 in ONNX, int32 in TensorFlow."""

    def convert_measured(graph: GraphBuilder, node: Node) -> None:
        graph.add("Cast", [graph.add(kind, node.inputs)], node.name, to=INT32)

    return convert_measured


def padding(node: Node) -> dict[str, str]:
    """TensorFlow's SAME puts the odd pixel at the end, ONNX's SAME_UPPER too."""
    kind = node.text("padding", "VALID")
    if kind not in ("SAME", "VALID"):
        raise ModelError(f"cannot convert {node.kind} '{node.name}': padding {kind} is not supported")
    return {"auto_pad": "SAME_UPPER" if kind == "SAME" else "VALID"}


def activate(graph: GraphBuilder, name: str, activation: str, node: Node) -> str:
    """The activation fused into a convolution."""
    if activation == "Relu":
        return graph.add("Relu", [name])
    if activation == "Relu6":
        return graph.add("Clip", [name, graph.constant(np.float32(0)), graph.constant(np.float32(6))])
    raise ModelError(f"cannot convert {node.kind} '{node.name}': fused {activation} is not supported")


def convolution(graph: GraphBuilder, node: Node) -> None:
    """Convolution, full or by channel, with fused bias and activation."""
    weights = graph.value(node, 1)  # (height, width, in, out), or (height, width, in, multiplier) by channel
    groups = 1
    if "Depthwise" in node.kind:
        groups = weights.shape[2]
        weights = weights.reshape(*weights.shape[:2], 1, -1)
    kernel = graph.constant(weights.transpose(3, 2, 0, 1))
    fused = node.texts("fused_ops")
    bias = [graph.constant(graph.value(node, 2).reshape(-1))] if "BiasAdd" in fused else []
    result = graph.add(
        "Conv",
        [graph.to_nchw(node.inputs[0]), kernel, *bias],
        kernel_shape=list(weights.shape[:2]),
        strides=node.spatial("strides"),
        dilations=node.spatial("dilations"),
        group=groups,
        **padding(node),
    )
    for activation in (kind for kind in fused if kind != "BiasAdd"):
        result = activate(graph, result, activation, node)
    graph.to_nhwc(result, node.name)


def max_pool(graph: GraphBuilder, node: Node) -> None:
    """Maximum over a window."""
    pooled = graph.add(
        "MaxPool",
        [graph.to_nchw(node.inputs[0])],
        kernel_shape=node.spatial("ksize"),
        strides=node.spatial("strides"),
        **padding(node),
    )
    graph.to_nhwc(pooled, node.name)


def resize_bilinear(graph: GraphBuilder, node: Node) -> None:
    """Bilinear resize to a height and width that may be computed at run time."""
    if node.flag("align_corners"):
        rule = "align_corners"
    else:
        rule = "half_pixel" if node.flag("half_pixel_centers") else "asymmetric"
    image = graph.to_nchw(node.inputs[0])
    batch_and_channels = graph.add("Shape", [image], start=0, end=2)
    size = graph.add("Concat", [batch_and_channels, graph.as_int64(node.inputs[1])], axis=0)
    resized = graph.add("Resize", [image, "", "", size], mode="linear", coordinate_transformation_mode=rule)
    graph.to_nhwc(resized, node.name)


def reshape(graph: GraphBuilder, node: Node) -> None:
    """Give a tensor another shape."""
    graph.add("Reshape", [node.inputs[0], graph.as_int64(node.inputs[1])], node.name)


def expand_dims(graph: GraphBuilder, node: Node) -> None:
    """Insert an axis of length one."""
    graph.add("Unsqueeze", [node.inputs[0], graph.integers(graph.value(node, 1))], node.name)


def squeeze(graph: GraphBuilder, node: Node) -> None:
    """Remove axes of length one: the named ones, or all."""
    axes = node.integers("squeeze_dims")
    graph.add("Squeeze", [node.inputs[0], *([graph.integers(axes)] if axes else [])], node.name)


def pack(graph: GraphBuilder, node: Node) -> None:
    """Stack tensors along a new axis."""
    axis = node.integer("axis")
    layers = [graph.add("Unsqueeze", [name, graph.integers([axis])]) for name in node.inputs]
    graph.add("Concat", layers, node.name, axis=axis)


def output_names(node: Node, count: int) -> list[str]:
    """Names of a TensorFlow operator's outputs: the first bears the operator's own name."""
    return [node.name, *(f"{node.name}:{index}" for index in range(1, count))]


def unpack(graph: GraphBuilder, node: Node) -> None:
    """Take a tensor apart along an axis, which disappears."""
    axis, count = node.integer("axis"), node.integer("num")
    parts = [graph.fresh("part") for _ in range(count)]
    graph.add_many("Split", node.inputs, parts, axis=axis, num_outputs=count)
    for part, output in zip(parts, output_names(node, count), strict=True):
        graph.add("Squeeze", [part, graph.integers([axis])], output)


def split(graph: GraphBuilder, node: Node) -> None:
    """Cut a tensor into equal parts along an axis."""
    count = node.integer("num_split")
    axis = int(graph.value(node, 0))
    graph.add_many("Split", [node.inputs[1]], output_names(node, count), axis=axis, num_outputs=count)


def concatenate(graph: GraphBuilder, node: Node) -> None:
    """Join tensors along an axis."""
    axis = int(graph.value(node, len(node.inputs) - 1))
    graph.add("Concat", node.inputs[:-1], node.name, axis=axis)


def tile(graph: GraphBuilder, node: Node) -> None:
    """Repeat a tensor."""
    graph.add("Tile", [node.inputs[0], graph.as_int64(node.inputs[1])], node.name)


def fill(graph: GraphBuilder, node: Node) -> None:
    """A tensor of one value."""
    graph.add("Expand", [node.inputs[1], graph.as_int64(node.inputs[0])], node.name)


def top_k(graph: GraphBuilder, node: Node) -> None:
    """The k largest values along the last axis, and where they stand."""
    count = graph.add("Reshape", [graph.as_int64(node.inputs[1]), graph.integers([1])])
    indices = graph.fresh("indices")
    graph.add_many("TopK", [node.inputs[0], count], [node.name, indices], axis=-1)
    graph.add("Cast", [indices], f"{node.name}:1", to=INT32)


def gather_nd(graph: GraphBuilder, node: Node) -> None:
    """Pick entries by index vectors."""
    graph.add("GatherND", [node.inputs[0], graph.as_int64(node.inputs[1])], node.name)


def select(graph: GraphBuilder, node: Node) -> None:
    """Take from one tensor or the other, by a mask of the same shape."""
    graph.add("Where", node.inputs, node.name)


def reduced(kind: str) -> Operator:
    """Reduction over constant axes."""

    def convert_reduced(graph: GraphBuilder, node: Node) -> None:
        axes = graph.integers(graph.value(node, 1))
        graph.add(kind, [node.inputs[0], axes], node.name, keepdims=int(node.flag("keep_dims")))

    return convert_reduced


def arg_max(graph: GraphBuilder, node: Node) -> None:
    """Where the largest value along an axis stands."""
    largest = graph.add("ArgMax", [node.inputs[0]], axis=int(graph.value(node, 1)), keepdims=0)
    graph.add("Cast", [largest], node.name, to=INT32)


@dataclass
class SlicePlan:
    """A strided slice in ONNX's three steps: slice, drop the axes taken at one index, insert new axes."""

    starts: list[int] = field(default_factory=list)
    ends: list[int] = field(default_factory=list)
    steps: list[int] = field(default_factory=list)
    dropped: list[int] = field(default_factory=list)
    inserted: list[int] = field(default_factory=list)

    def take(self, start: int, end: int, step: int) -> None:
        """Slice the next axis of the input."""
        self.starts.append(start)
        self.ends.append(end)
        self.steps.append(step)


def plan_slice(graph: GraphBuilder, node: Node) -> SlicePlan:
    """Read TensorFlow's bit masks, one bit per entry of begin, end and strides."""
    if node.integer("ellipsis_mask"):
        raise ModelError(f"cannot convert StridedSlice '{node.name}': an ellipsis is not supported")
    plan = SlicePlan()
    out_axis = 0
    begins, ends, steps = (graph.value(node, index).tolist() for index in (1, 2, 3))
    for entry, (begin, end, step) in enumerate(zip(begins, ends, steps, strict=True)):
        bit = 1 << entry
        if node.integer("new_axis_mask") & bit:
            plan.inserted.append(out_axis)
        elif node.integer("shrink_axis_mask") & bit:
            plan.dropped.append(len(plan.starts))
            plan.take(begin, begin + 1 if begin != -1 else SLICE_END, 1)
            continue
        else:
            first, last = (0, SLICE_END) if step > 0 else (SLICE_END, -SLICE_END)
            start = first if node.integer("begin_mask") & bit else begin
            plan.take(start, last if node.integer("end_mask") & bit else end, step)
        out_axis += 1
    return plan


def strided_slice(graph: GraphBuilder, node: Node) -> None:
    """NumPy-like slicing with constant bounds."""
    plan = plan_slice(graph, node)
    bounds = [plan.starts, plan.ends, list(range(len(plan.starts))), plan.steps]
    result = graph.add("Slice", [node.inputs[0], *(graph.integers(values) for values in bounds)])
    if plan.dropped:
        result = graph.add("Squeeze", [result, graph.integers(plan.dropped)])
    if plan.inserted:
        result = graph.add("Unsqueeze", [result, graph.integers(plan.inserted)])
    graph.add("Identity", [result], node.name)


OPERATORS: dict[str, Operator] = {
    **{kind: same(kind) for kind in ("Abs", "Equal", "Exp", "Greater", "Identity", "Less", "Mul", "Range")},
    **{kind: same(kind) for kind in ("Reciprocal", "Sigmoid", "Sub")},
    "AddN": same("Sum"),
    "AddV2": same("Add"),
    "ArgMax": arg_max,
    "Cast": cast,
    "ConcatV2": concatenate,
    "DepthwiseConv2dNative": convolution,
    "ExpandDims": expand_dims,
    "Fill": fill,
    "FloorDiv": floor_divide,
    "FusedDepthwiseConv2dNative": convolution,
    "GatherNd": gather_nd,
    "GreaterEqual": same("GreaterOrEqual"),
    "LogicalAnd": same("And"),
    "Max": reduced("ReduceMax"),
    "MaxPool": max_pool,
    "Maximum": same("Max"),
    "Minimum": same("Min"),
    "Pack": pack,
    "RealDiv": same("Div"),
    "Reshape": reshape,
    "ResizeBilinear": resize_bilinear,
    "Select": select,
    "Shape": measured("Shape"),
    "Size": measured("Size"),
    "Split": split,
    "SquaredDifference": squared_difference,
    "Squeeze": squeeze,
    "StridedSlice": strided_slice,
    "Sum": reduced("ReduceSum"),
    "Tile": tile,
    "TopKV2": top_k,
    "Unpack": unpack,
    "_FusedConv2D": convolution,
}
