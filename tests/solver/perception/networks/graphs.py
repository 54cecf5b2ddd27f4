"""Tiny ONNX networks of the signatures of large ones, and their declarations."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

Axis = int | str


def save(
    path: Path,
    nodes: list[onnx.NodeProto],
    inputs: dict[str, list[Axis]],
    outputs: dict[str, list[Axis] | None],
    constants: dict[str, np.ndarray],
    kind: int = TensorProto.FLOAT,
) -> Path:
    graph = helper.make_graph(
        nodes, "tiny",
        [helper.make_tensor_value_info(name, kind, shape) for name, shape in inputs.items()],
        [helper.make_tensor_value_info(name, TensorProto.FLOAT, shape) for name, shape in outputs.items()],
        [numpy_helper.from_array(array, name) for name, array in constants.items()],
    )  # fmt: skip
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9), path)
    return path


def write_answers(path: Path, picture: list[Axis], **answers: np.ndarray) -> Path:
    """A network that gives these float arrays, whatever it is shown."""
    constants = {f"{name}_value": array.astype(np.float32) for name, array in answers.items()}
    nodes = [helper.make_node("Identity", [f"{name}_value"], [name]) for name in answers]
    return save(path, nodes, {"picture": picture}, {n: list(a.shape) for n, a in answers.items()}, constants)


def write_answers_per_person(path: Path, picture: list[Axis], **answers: np.ndarray) -> Path:
    """The same for a network with a free number N of crops: each person gets the same answer (without the axis N)."""
    constants: dict[str, np.ndarray] = {"zero": np.array([0], np.int64)}
    nodes = [
        helper.make_node("Shape", ["picture"], ["shape"]),
        helper.make_node("Gather", ["shape", "zero"], ["count"]),
    ]
    for name, array in answers.items():
        constants[f"{name}_value"] = array.astype(np.float32)[None]
        constants[f"{name}_shape"] = np.array(array.shape, np.int64)
        nodes.append(helper.make_node("Concat", ["count", f"{name}_shape"], [f"{name}_full"], axis=0))
        nodes.append(helper.make_node("Expand", [f"{name}_value", f"{name}_full"], [name]))
    return save(path, nodes, {"picture": picture}, {n: ["N", *a.shape] for n, a in answers.items()}, constants)


SPOT_WIDTH = 4.0  # grey values in which a spot's own heatmap answers


def _spot_nodes(
    levels: np.ndarray, shrink: int, channel: int, width: float
) -> tuple[list[onnx.NodeProto], dict[str, np.ndarray]]:
    """Heatmaps of discs in a picture, told apart by one channel: one for each level."""
    half = shrink // 2
    constants = {
        "levels": levels.astype(np.float32).reshape(1, -1, 1, 1),
        "width": np.array(-1 / width**2, np.float32),
        "first": np.array([channel], np.int64),
        "second": np.array([channel + 1], np.int64),
        "channels": np.array([1], np.int64),
    }
    nodes = [
        helper.make_node("Slice", ["picture", "first", "second", "channels"], ["red"]),
        helper.make_node("Sub", ["red", "levels"], ["apart"]),
        helper.make_node("Mul", ["apart", "apart"], ["square"]),
        helper.make_node("Mul", ["square", "width"], ["exponent"]),
        helper.make_node("Exp", ["exponent"], ["match"]),
        # Averaging again and again makes of each disc a hill with one top.
        *(
            helper.make_node("AveragePool", [before], [after], kernel_shape=[5, 5], pads=[2, 2, 2, 2])
            for before, after in (("match", "knoll"), ("knoll", "mound"), ("mound", "hill"))
        ),
        # A cell's centre lies on every `shrink`-th pixel index, as in the training of such networks.
        helper.make_node(
            "AveragePool",
            ["hill"],
            ["heatmaps"],
            kernel_shape=[2 * half + 1] * 2,
            strides=[shrink] * 2,
            pads=[half] * 4,
        ),
    ]
    return nodes, constants


def write_heatmap_network(
    path: Path,
    size: tuple[int, int],
    levels: np.ndarray,
    batch: Axis = "N",
    channel: int = 0,
    width: float = SPOT_WIDTH,
) -> Path:
    """A top-down pose network, heatmaps a quarter of the input's size, that finds red discs by their level."""
    nodes, constants = _spot_nodes(levels, 4, channel, width)
    across, down = size
    shape: list[Axis] = [batch, len(levels), down // 4, across // 4]
    return save(path, nodes, {"picture": [batch, 3, down, across]}, {"heatmaps": shape}, constants)


def write_simcc_network(
    path: Path,
    size: tuple[int, int],
    levels: np.ndarray,
    batch: Axis = "N",
    channel: int = 0,
    width: float = SPOT_WIDTH,
) -> Path:
    """The same as SimCC with one bin a pixel."""
    nodes, constants = _spot_nodes(levels, 1, channel, width)
    across, down = size
    constants |= {"rows": np.array([2], np.int64), "columns": np.array([3], np.int64)}
    nodes += [
        helper.make_node("ReduceMax", ["heatmaps", "rows"], ["simcc_x"], keepdims=0),
        helper.make_node("ReduceMax", ["heatmaps", "columns"], ["simcc_y"], keepdims=0),
    ]
    outputs: dict[str, list[Axis] | None] = {
        "simcc_x": [batch, len(levels), across], "simcc_y": [batch, len(levels), down],
    }  # fmt: skip
    return save(path, nodes, {"picture": [batch, 3, down, across]}, outputs, constants)


def write_grey_network(path: Path, sides: list[Axis], *, channel: bool = False, name: str = "depth") -> Path:
    """A depth network that takes the mean of the colours for its answer, plus 1."""
    constants = {"axes": np.array([1], np.int64), "one": np.array(1, np.float32)}
    nodes = [
        helper.make_node("ReduceMean", ["picture", "axes"], ["mean"], keepdims=int(channel)),
        helper.make_node("Add", ["mean", "one"], [name]),
    ]
    shape: list[Axis] = [1, 1, *sides] if channel else [1, *sides]
    return save(path, nodes, {"picture": [1, 3, *sides]}, {name: shape}, constants)


def declare(path: Path, **keys: object) -> Path:
    """Write a declaration; its network's file has the same name unless `file` says otherwise."""
    keys = {"file": path.with_suffix(".onnx").name, **keys}
    lines = ["[network]"]
    tables = []
    for key, value in keys.items():
        if isinstance(value, dict):
            tables += [f"[network.{key}]", *(f"{k} = {_toml(v)}" for k, v in value.items())]
        else:
            lines.append(f"{key} = {_toml(value)}")
    path.write_text("\n".join([*lines, *tables]) + "\n")
    return path


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, tuple | list):
        return "[" + ", ".join(map(_toml, value)) + "]"
    return repr(value)
