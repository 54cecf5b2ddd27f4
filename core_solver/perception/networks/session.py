"""A declared network that is open: its signature is checked, pictures go in as tensors, outputs come in fixed order."""

from collections.abc import Sequence

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from core_solver.errors import ModelError
from core_solver.perception.networks.keypoint_sets import KEYPOINT_SETS
from core_solver.perception.networks.kinds import ANY, PerKeypoint, Role, View
from core_solver.perception.networks.spec import NetworkSpec
from core_solver.perception.onnx_session import open_session

_MOST_THREADS = 64  # a user's network may be large

_TYPES = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(double)": np.float64,
    "tensor(uint8)": np.uint8,
    "tensor(int32)": np.int32,
    "tensor(int64)": np.int64,
}


class DeclaredSession:
    """An ONNX file with its declaration.

    Attributes:
        spec: the declaration.
        size: (width, height) of the input; None where the graph leaves it free and the declaration names none.
        batch: how many pictures at once; None for any number.
    """

    def __init__(self, spec: NetworkSpec, device: str) -> None:
        """Open the file and compare its signature with the declaration.

        Raises:
            ModelError: no such file, no network, or an input or output is not as declared; the message names it.
        """
        if not spec.file.is_file():
            raise ModelError(f"{spec.toml.name}: there is no file {spec.file}: correct the key 'file'")
        self.spec = spec
        self._session = open_session(spec.file, device, _MOST_THREADS)
        self._picture, *constants = self._split_inputs(self._session.get_inputs())
        self.batch, self.size = self._read_input(self._picture)
        self._constants = {node.name: self._constant(node) for node in constants}
        self._names = [self._output_name(role) for role in spec.kind.roles]
        shapes = {node.name: node.shape for node in self._session.get_outputs()}
        for role, name in zip(spec.kind.roles, self._names, strict=True):
            if name is not None and shapes[name]:
                self._check_output(role, name, shapes[name])

    def __call__(self, tensors: Sequence[NDArray]) -> list[NDArray | None]:
        """Run the network on pictures of one shape, in as few runs as the graph allows.

        Args:
            tensors: at least one, as `prepare.to_tensor` makes them.

        Returns:
            for each of the kind's roles its output over all pictures; None where an optional one is lacking.

        Raises:
            ModelError: the network fails, or an output's shape is not as declared.
        """
        dtype = _TYPES[self._picture.type]
        stack = np.stack(tensors).astype(dtype)
        at_once = self.batch or len(stack)
        parts = [self._run(stack[start : start + at_once], at_once) for start in range(0, len(stack), at_once)]
        return [None if outputs[0] is None else np.concatenate(outputs) for outputs in zip(*parts, strict=True)]

    def has(self, role: str) -> bool:
        """Whether the graph gives an optional output."""
        return any(
            r.name == role and name is not None for r, name in zip(self.spec.kind.roles, self._names, strict=True)
        )

    def _run(self, stack: NDArray, at_once: int) -> list[NDArray | None]:
        count = len(stack)
        missing = at_once - count  # a graph of fixed batch gets empty pictures
        stack = np.concatenate([stack, np.zeros((missing, *stack.shape[1:]), stack.dtype)])
        wanted = [name for name in self._names if name is not None]
        try:
            found = iter(self._session.run(wanted, {self._picture.name: stack, **self._constants}))
        except Exception as error:  # onnxruntime's errors have no public base class
            text = str(error).splitlines()[0]
            raise ModelError(f"{self.spec.file.name} does not run on {stack.shape}: {text}") from error
        outputs: list[NDArray | None] = []
        for role, name in zip(self.spec.kind.roles, self._names, strict=True):
            if name is None:
                outputs.append(None)
                continue
            array = np.asarray(next(found))
            self._check_output(role, name, array.shape)
            as_float = array.astype(np.float32, copy=False)
            outputs.append(as_float[:count] if self.spec.view is View.PERSON else as_float)
        return outputs

    def _split_inputs(self, inputs: Sequence[onnxruntime.NodeArg]) -> list[onnxruntime.NodeArg]:
        """The picture first, then the constants."""
        names = [node.name for node in inputs]
        for name in self.spec.constants:
            if name not in names:
                raise self._wrong(f"has no input '{name}', which [network.constants] sets: it has {', '.join(names)}")
        pictures = [node for node in inputs if node.name not in self.spec.constants]
        if len(pictures) != 1:
            named = ", ".join(f"'{node.name}' {shown(node.shape)}" for node in pictures)
            raise self._wrong(
                f"has the inputs {named}: one takes the picture, the others need a number in [network.constants]"
            )
        return pictures + [node for node in inputs if node.name in self.spec.constants]

    def _read_input(self, node: onnxruntime.NodeArg) -> tuple[int | None, tuple[int, int] | None]:
        """(batch, (width, height)) with None for what is free."""
        spec = self.spec
        batch = ANY if spec.view is View.PERSON else 1
        width, height = spec.input or (ANY, ANY)
        wanted = (batch, 3, height, width) if spec.layout == "NCHW" else (batch, height, width, 3)
        if not fits(node.shape, wanted):
            raise self._wrong(f"input '{node.name}' is {shown(node.shape)}, declared is {shown(wanted)}")
        if node.type not in _TYPES:
            raise self._wrong(f"input '{node.name}' takes {node.type}: allowed are {', '.join(_TYPES)}")
        rows, columns = (2, 3) if spec.layout == "NCHW" else (1, 2)
        found = node.shape[columns], node.shape[rows]
        fixed = (found[0], found[1]) if all(isinstance(n, int) for n in found) else None
        size = spec.input or fixed
        if size is None and spec.kind.task != "depth":
            raise self._wrong(f"input '{node.name}' is {shown(node.shape)}: say its size with the key 'input'")
        return (node.shape[0] if isinstance(node.shape[0], int) else None), size

    def _constant(self, node: onnxruntime.NodeArg) -> NDArray:
        if node.type not in _TYPES:
            raise self._wrong(f"input '{node.name}' takes {node.type}: a constant must be a number")
        return np.full(tuple(node.shape), self.spec.constants[node.name], _TYPES[node.type])

    def _output_name(self, role: Role) -> str | None:
        """What the graph calls a role's output."""
        names = [node.name for node in self._session.get_outputs()]
        declared = self.spec.outputs.get(role.name)
        if declared is not None:
            if declared not in names:
                raise self._wrong(f"has no output '{declared}' (outputs.{role.name}): it has {', '.join(names)}")
            return declared
        for usual in (*role.usual, role.name):
            if usual in names:
                return usual
        required = [r.name for r in self.spec.kind.roles if not r.optional]
        if role.optional:
            return None
        if len(names) == len(required):
            return names[required.index(role.name)]
        if len(names) < len(required):
            raise self._wrong(
                f'has only the outputs {", ".join(names)}, the decoder "{self.spec.decoder}" wants '
                f"{', '.join(required)}"
            )
        raise self._wrong(
            f"has the outputs {', '.join(names)}: say with outputs.{role.name} in {self.spec.toml.name} which is "
            f"the {role.name}"
        )

    def _check_output(self, role: Role, name: str, found: Sequence[object]) -> None:
        count = KEYPOINT_SETS[self.spec.keypoints].count
        wanted = [tuple(length(n, count) for n in shape) for shape in role.shapes]
        if not any(fits(found, shape) for shape in wanted):
            choices = " or ".join(map(shown, wanted))
            raise self._wrong(
                f"output '{name}' is {shown(found)}, the decoder \"{self.spec.decoder}\" wants {choices} "
                f"for its {role.name}"
            )

    def _wrong(self, words: str) -> ModelError:
        return ModelError(f"{self.spec.file.name} is not as {self.spec.toml.name} declares: {words}")


def length(axis: int | PerKeypoint, keypoints: int) -> int:
    """The length of an axis, or `ANY`, for a set of so many keypoints."""
    return axis if isinstance(axis, int) else axis.times * keypoints + axis.plus


def fits(found: Sequence[object], wanted: Sequence[int]) -> bool:
    """Whether a shape can be the wanted one; names and None in `found` stand for free lengths."""
    if len(found) != len(wanted):
        return False
    return all(not isinstance(f, int) or w in (ANY, f) for f, w in zip(found, wanted, strict=True))


def shown(shape: Sequence[object]) -> str:
    """A shape in words."""
    return "(" + ", ".join("any" if n is None or n == ANY else str(n) for n in shape) + ")"
