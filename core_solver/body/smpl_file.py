"""Read a user's own SMPL model file, .npz or the original .pkl, without running anything that stands in it."""

import io
import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from core_solver.body.skeleton import PARENTS
from core_solver.errors import ModelError

Array = NDArray[np.float64]

_BETAS = 10
_UNREADABLE = "{path} cannot be read as a body model: give an SMPL file (.npz or .pkl) that is whole"


@dataclass(frozen=True)
class SmplArrays:
    """The arrays of an SMPL file, in its own axes (y up, z to the front, x to the body's left), metres.

    Attributes:
        template: (V, 3). shape_directions: (V, 3, 10). pose_directions: (V, 3, 207).
        joint_regressor: (24, V). weights: (V, 24). faces: (F, 3).
    """

    template: Array
    shape_directions: Array
    pose_directions: Array
    joint_regressor: Array
    weights: Array
    faces: NDArray[np.int32]


def read_smpl_arrays(path: Path) -> SmplArrays:
    """Read and check an SMPL file.

    Raises:
        ModelError: not a file of the 24-joint SMPL model, damaged, or a pickle that holds anything but arrays.
    """
    entries = _read_npz(path) if path.suffix == ".npz" else _read_pickle(path)
    try:
        arrays = SmplArrays(
            template=_dense(entries["v_template"]),
            shape_directions=_dense(entries["shapedirs"])[:, :, :_BETAS],
            pose_directions=_dense(entries["posedirs"]),
            joint_regressor=_dense(entries["J_regressor"]),
            weights=_dense(entries["weights"]),
            faces=_dense(entries["f"]).astype(np.int32),
        )
    except KeyError as error:
        raise ModelError(f"{path} is not a body model that can be used: it lacks {error}; give an SMPL file") from error
    except (TypeError, ValueError, IndexError) as error:
        raise ModelError(f"{path} is not a body model that can be used: {error}") from error
    _check(path, arrays, entries.get("kintree_table"))
    return arrays


def unpickle_arrays(stream: BinaryIO) -> Any:
    """What a pickle holds, of Python 2 or 3, without running anything that stands in it.

    Numpy arrays, plain Python values, and stand-ins for sparse matrices and chumpy's wrapper come out; every other name
    is refused.

    Raises:
        ModelError: it names something else.
        Exception: it is damaged: almost any kind.
    """
    return _ArrayUnpickler(stream, encoding="latin1").load()


def _check(path: Path, arrays: SmplArrays, tree: Any) -> None:
    count, joints = len(arrays.template), len(PARENTS)
    expected = {
        "v_template": (arrays.template, (count, 3)),
        "shapedirs": (arrays.shape_directions, (count, 3, _BETAS)),
        "posedirs": (arrays.pose_directions, (count, 3, 9 * (joints - 1))),
        "J_regressor": (arrays.joint_regressor, (joints, count)),
        "weights": (arrays.weights, (count, joints)),
        "f": (arrays.faces, (len(arrays.faces), 3)),
    }
    for name, (array, shape) in expected.items():
        if array.shape != shape:
            raise ModelError(f"{path}: {name} is {array.shape}, but the 24-joint SMPL model needs {shape}")
        if not np.isfinite(array).all():
            raise ModelError(f"{path}: {name} holds numbers that are not finite")
    if len(arrays.faces) == 0 or arrays.faces.min() < 0 or arrays.faces.max() >= count:
        raise ModelError(f"{path}: its faces name vertices that are not there")
    if tree is not None and tuple(_dense(tree)[0, 1:].astype(int)) != PARENTS[1:]:
        raise ModelError(f"{path}: its joints are not SMPL's 24 (an SMPL-H or SMPL-X file?); use the SMPL model file")


def _read_npz(path: Path) -> dict[str, Any]:
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {name: archive[name] for name in archive.files}
    except Exception as error:  # a damaged archive raises almost anything
        raise ModelError(_UNREADABLE.format(path=path)) from error


def _read_pickle(path: Path) -> dict[str, Any]:
    try:
        entries = unpickle_arrays(io.BytesIO(path.read_bytes()))
    except ModelError:
        raise
    except Exception as error:  # a damaged pickle raises almost anything
        raise ModelError(_UNREADABLE.format(path=path)) from error
    if not isinstance(entries, dict):
        raise ModelError(f"{path} is not an SMPL model: it holds no table of arrays")
    return {str(name): value for name, value in entries.items()}


class _PlainState:
    """Stands for a class whose instances are only read as the plain attributes that they were saved with."""

    def __setstate__(self, state: Any) -> None:
        self.state = state if isinstance(state, dict) else {}


class _Chumpy(_PlainState):
    """chumpy's array wrapper `Ch`: its value is kept under "x"; `Select` picks entries of another one."""

    def value(self) -> Array:
        if "x" in self.state:
            return _dense(self.state["x"])
        chosen = _dense(self.state["a"]).ravel()[np.asarray(self.state["idxs"])]
        return chosen.reshape(self.state["preferred_shape"]) if "preferred_shape" in self.state else chosen


class _SparseMatrix(_PlainState):
    """A scipy sparse matrix in compressed columns or rows, whatever scipy wrote it."""

    by_rows = False

    def value(self) -> Array:
        shape = self.state["_shape"] if "_shape" in self.state else self.state["shape"]
        parts = (self.state["data"], self.state["indices"], self.state["indptr"])
        matrix = sparse.csr_matrix(parts, shape=shape) if self.by_rows else sparse.csc_matrix(parts, shape=shape)
        return matrix.toarray()


class _SparseRows(_SparseMatrix):
    by_rows = True


def _dense(value: Any) -> Array:
    if isinstance(value, _Chumpy | _SparseMatrix):
        return value.value()
    return np.asarray(value, dtype=float)


def _latin1_encode(text: str, encoding: str) -> bytes:
    """What `_codecs.encode` does in pickles written by Python 2; no other codec is let through."""
    if encoding != "latin1":
        raise ModelError("this model file is not a plain table of arrays and was not opened (it names a codec)")
    return text.encode("latin1")


def _reconstruct_object(kind: type, base: type, state: object) -> object:
    """What `copy_reg._reconstructor` does, for the stand-ins above only."""
    if not issubclass(kind, _PlainState) or base is not object or state is not None:
        raise ModelError("this model file is not a plain table of arrays and was not opened")
    return kind()


class _ArrayUnpickler(pickle.Unpickler):
    """Knows numpy arrays, sparse matrices and chumpy's wrapper, and refuses every other name."""

    def find_class(self, module: str, name: str) -> Any:
        module = module.replace("numpy._core", "numpy.core")
        known = _KNOWN_NAMES.get((module, name))
        if known is not None:
            return known
        root = module.split(".")[0]
        if root == "chumpy" and name in {"Ch", "Select"}:
            return _Chumpy
        if module.startswith("scipy.sparse") and name in {"csc_matrix", "csc_array"}:
            return _SparseMatrix
        if module.startswith("scipy.sparse") and name in {"csr_matrix", "csr_array"}:
            return _SparseRows
        raise ModelError(
            f"this model file names {module}.{name}, which a table of arrays does not need: it was not opened"
        )


_KNOWN_NAMES: dict[tuple[str, str], Any] = {
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    # numpy's own helpers, asked of numpy because their module has moved between versions.
    ("numpy.core.multiarray", "_reconstruct"): np.zeros(1).__reduce__()[0],
    ("numpy.core.multiarray", "scalar"): np.float64(0).__reduce__()[0],
    ("_codecs", "encode"): _latin1_encode,
    ("copy_reg", "_reconstructor"): _reconstruct_object,
    ("copyreg", "_reconstructor"): _reconstruct_object,
    ("__builtin__", "object"): object,
    ("builtins", "object"): object,
    ("__builtin__", "set"): set,
    ("builtins", "set"): set,
}
