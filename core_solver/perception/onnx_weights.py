"""Which files an ONNX network consists of: large ones keep weights in files beside their own."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator
    from pathlib import Path

    import onnx

_SUFFIX = ".onnx"


def with_weights(files: Iterable[Path]) -> tuple[Path, ...]:
    """The same files, each ONNX network followed by the files that hold its weights, by name.

    A file that is no network counts as one without weights elsewhere: whoever runs it says what is wrong with it. So
    does a network that misses a file.
    """
    return tuple(each for file in files for each in (file, *_weights_beside(file)))


def _weights_beside(file: Path) -> list[Path]:
    if file.suffix.lower() != _SUFFIX:
        return []
    import onnx  # noqa: PLC0415 - heavy, and only needed for this
    from google.protobuf.message import DecodeError  # noqa: PLC0415

    try:
        model = onnx.load(file, load_external_data=False)
    except DecodeError:
        return []
    tensors = [*_tensors(model.graph), *(t for function in model.functions for t in _tensors_of_nodes(function.node))]
    paths = {file.parent / place.value for t in tensors for place in t.external_data if place.key == "location"}
    # Runtimes refuse weights outside the network's folder; so nothing of there is read or copied.
    inside = file.parent.resolve()
    return sorted(path for path in paths if path.is_file() and path.resolve().is_relative_to(inside))


def _tensors(graph: onnx.GraphProto) -> Iterator[onnx.TensorProto]:
    yield from graph.initializer
    for sparse in graph.sparse_initializer:
        yield from (sparse.values, sparse.indices)
    yield from _tensors_of_nodes(graph.node)


def _tensors_of_nodes(nodes: Iterable[onnx.NodeProto]) -> Iterator[onnx.TensorProto]:
    """Constants, and what the branches of conditions and loops hold."""
    for attribute in (attribute for node in nodes for attribute in node.attribute):
        yield from (attribute.t, *attribute.tensors)
        if attribute.HasField("g"):
            yield from _tensors(attribute.g)
        for graph in attribute.graphs:
            yield from _tensors(graph)
