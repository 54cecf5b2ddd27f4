"""TensorFlow.js graph models as ONNX.

A TensorFlow.js model is a JSON graph (`modelTopology`) and binary shards of weights (`weightsManifest`) that lie beside
it. What each operator becomes is in `tfjs_operators`; this module reads the files, puts the operators in order and
assembles the ONNX graph.
"""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from core_solver.errors import ModelError
from core_solver.perception.tfjs_operators import ONNX_TYPES, OPERATORS, GraphBuilder, Node

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence
    from pathlib import Path

    import onnx

OPSET = 18
IR_VERSION = 9
WEIGHT_TYPES = {"float32": np.float32, "int32": np.int32, "bool": np.bool_}


def convert_file(topology: Path, target: Path) -> None:
    """Convert a TensorFlow.js graph model to an ONNX file. Input sizes that the model leaves open stay open.

    Args:
        topology: the model's .json file, its weight shards beside it.
        target: the .onnx file to write.

    Raises:
        ModelError: the files are not a graph model, are incomplete, or use an operator that is not supported.
    """
    import onnx  # noqa: PLC0415  (heavy, and only needed while converting)

    try:
        model = json.loads(topology.read_text(encoding="utf-8"))
        nodes = [read_node(raw) for raw in model["modelTopology"]["node"]]
        weights = read_weights(model["weightsManifest"], topology.parent)
    except (KeyError, TypeError, ValueError, OSError) as error:
        raise ModelError(f"{topology.name} is not a readable TensorFlow.js graph model: fetch it again") from error
    onnx.save(convert(nodes, weights), str(target))


def read_node(raw: dict[str, Any]) -> Node:
    """A node as the JSON file spells it. `^name` is an order of execution, not a tensor; `name:0` is `name`."""
    inputs = (name.removesuffix(":0") for name in raw.get("input", []) if not name.startswith("^"))
    return Node(raw["name"], raw["op"], tuple(inputs), raw.get("attr") or {})


def read_weights(manifest: Sequence[dict[str, Any]], folder: Path) -> dict[str, np.ndarray]:
    """Every constant of the graph by name; 16-bit floats are widened to 32 bits.

    Raises:
        ModelError: a shard is shorter than the manifest says, or stored in an unsupported type.
    """
    weights: dict[str, np.ndarray] = {}
    for group in manifest:
        data = b"".join((folder / path).read_bytes() for path in group["paths"])
        offset = 0
        for entry in group["weights"]:
            stored = stored_type(entry)
            count = math.prod(entry["shape"])
            if offset + count * stored.itemsize > len(data):
                raise ModelError(f"the weights beside {folder.name} are cut off: fetch the model again")
            values = np.frombuffer(data, stored, count, offset).reshape(entry["shape"])
            weights[entry["name"]] = values.astype(WEIGHT_TYPES[entry["dtype"]])
            offset += count * stored.itemsize
    return weights


def stored_type(entry: dict[str, Any]) -> np.dtype:
    """The type in which a weight lies in the file."""
    kind = entry.get("quantization", {}).get("dtype", entry["dtype"])
    if kind != "float16" and kind not in WEIGHT_TYPES:
        raise ModelError(f"weight '{entry['name']}' is stored as {kind}, which is not supported")
    return np.dtype(np.float16 if kind == "float16" else WEIGHT_TYPES[kind])


def convert(nodes: Sequence[Node], weights: dict[str, np.ndarray]) -> onnx.ModelProto:
    """The ONNX model of a TensorFlow graph. Its inputs and outputs keep their TensorFlow names.

    Args:
        nodes: the graph, in any order.
        weights: the values of its `Const` nodes by name.

    Raises:
        ModelError: an operator, a padding or a fused activation is not supported.
    """
    from onnx import ValueInfoProto, helper, shape_inference  # noqa: PLC0415

    graph = GraphBuilder(constants=dict(weights))
    for node in in_order(nodes):
        if node.kind in ("Const", "Placeholder"):
            continue
        if node.kind not in OPERATORS:
            raise ModelError(f"cannot convert '{node.name}': operator {node.kind} is not supported")
        OPERATORS[node.kind](graph, node)
    inputs = [graph_input(node) for node in nodes if node.kind == "Placeholder"]
    outputs = [ValueInfoProto(name=name) for name in unused(nodes)]
    proto = helper.make_graph(graph.nodes, "tensorflow", inputs, outputs, initialisers(graph))
    model = helper.make_model(proto, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION)
    return shape_inference.infer_shapes(model)


def in_order(nodes: Sequence[Node]) -> Iterator[Node]:
    """Every node after the nodes it reads from (depth first, without recursion: graphs are hundreds deep)."""
    by_name = {node.name: node for node in nodes}
    done: set[str] = set()
    for root in nodes:
        waiting = [root]
        while waiting:
            node = waiting[-1]
            missing = [name for name in map(producer, node.inputs) if name not in done]
            waiting.extend(by_name[name] for name in missing)
            if missing:
                continue
            waiting.pop()
            if node.name not in done:
                done.add(node.name)
                yield node


def producer(tensor: str) -> str:
    """The node that makes a tensor: `split:2` comes from `split`."""
    return tensor.partition(":")[0]


def unused(nodes: Sequence[Node]) -> list[str]:
    """The graph's outputs: what no other node reads."""
    used = {producer(name) for node in nodes for name in node.inputs}
    return [node.name for node in nodes if node.name not in used and node.kind not in ("Const", "Placeholder")]


def graph_input(node: Node) -> onnx.ValueInfoProto:
    """A placeholder as an ONNX input; sizes of -1 become open sizes."""
    from onnx import helper  # noqa: PLC0415

    dimensions = node.attributes["shape"]["shape"].get("dim", [])
    sizes = [int(dimension["size"]) for dimension in dimensions]
    shape = [size if size >= 0 else f"{node.name}_{axis}" for axis, size in enumerate(sizes)]
    return helper.make_tensor_value_info(node.name, ONNX_TYPES[node.type_name("dtype")], shape)


def initialisers(graph: GraphBuilder) -> list[onnx.TensorProto]:
    """The constants that the ONNX graph reads; those folded into attributes or turned around are left out."""
    from onnx import numpy_helper  # noqa: PLC0415

    used = {name for node in graph.nodes for name in node.input}
    return [numpy_helper.from_array(values, name) for name, values in graph.constants.items() if name in used]
