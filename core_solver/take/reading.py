"""Read a take, with every shape checked before anyone uses it."""

import zipfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import TakeError
from core_solver.take import keys
from core_solver.take.metadata import decode_meta, parse_document, people_facts
from core_solver.take.model import Person, Scene, Take
from core_solver.take.validation import check_take


def read_take(path: Path) -> Take:
    """Read and check a take.

    Raises:
        TakeError: missing, damaged, foreign or newer file; the message names the reason.
    """
    path = Path(path)
    try:
        arrays = _read_arrays(path)
        return _assemble(arrays)
    except TakeError as error:
        raise TakeError(f"{path.name}: {error}") from error


def _read_arrays(path: Path) -> dict[str, NDArray[Any]]:
    try:
        arrays = _load_archive(path)
    except TakeError:
        raise
    except Exception as error:  # a damaged archive raises almost anything
        raise TakeError(f"not a readable .npz archive ({_reason(path, error)}): copy or solve it again") from error
    if keys.META not in arrays:
        raise TakeError("not a Scene-Aware Mocap take: it has no meta entry")
    return arrays


def _reason(path: Path, error: Exception) -> str:
    if not zipfile.is_zipfile(path):  # numpy would take it for a pickle and speak of that
        return "another kind of file, or cut off"
    return str(error).partition("\n")[0] or type(error).__name__


def _load_archive(path: Path) -> dict[str, NDArray[Any]]:
    if path.is_dir():
        raise TakeError("this is a directory: give the take itself")
    if not path.is_file():
        raise TakeError("no such file: check the path")
    archive = np.load(path, allow_pickle=False)
    if isinstance(archive, np.ndarray):
        return {}
    with archive:
        arrays = {key: archive[key] for key in archive.files}
    strangers = [key for key, value in arrays.items() if not isinstance(value, np.ndarray)]
    if strangers:
        raise TakeError(f"the entry {strangers[0]} is not an array: the file is damaged or foreign")
    return arrays


def _assemble(arrays: dict[str, NDArray[Any]]) -> Take:
    document = parse_document(_pop(arrays, keys.META, keys.META_ARRAY).tobytes())
    meta = decode_meta(document)
    times = _pop(arrays, keys.TIMES, keys.TIMES_ARRAY)
    people = tuple(_read_person(arrays, index, facts) for index, facts in enumerate(people_facts(document)))
    scene = Scene(**{
        field: _pop(arrays, keys.SCENE.format(field=field), spec) for field, spec in keys.SCENE_ARRAYS.items()
    })  # fmt: skip
    steadying = _pop(arrays, keys.STEADYING, keys.STEADYING_ARRAY) if keys.STEADYING in arrays else None
    take = Take(meta, times, people, scene, steadying, extra=arrays)
    check_take(take)
    return take


def _read_person(arrays: dict[str, NDArray[Any]], index: int, facts: dict[str, Any]) -> Person:
    values: dict[str, Any] = {
        field: _pop(arrays, keys.PERSON.format(index=index, field=field), spec)
        for field, spec in keys.PERSON_ARRAYS.items()
    }
    values["scale"] = float(values["scale"])
    try:
        red, green, blue = (float(c) for c in facts["colour"])
        return Person(
            id=int(facts["id"]),
            name=str(facts["name"]),
            height_m=float(facts["height_m"]),
            colour=(red, green, blue),
            **values,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise TakeError(f"the facts of person {index} are damaged ({type(error).__name__}: {error})") from error


def _pop(arrays: dict[str, NDArray[Any]], key: str, spec: keys.ArraySpec) -> NDArray[Any]:
    """Take the array out, of exactly the file's type; lengths are for `check_take`."""
    if key not in arrays:
        raise TakeError(f"the entry {key} is missing: the file is damaged")
    array = arrays.pop(key)
    if array.dtype != spec.dtype or array.ndim != len(spec.shape):
        raise TakeError(
            f"the entry {key} holds {array.dtype} of shape {array.shape} instead of "
            f"{np.dtype(spec.dtype)} with {len(spec.shape)} axes: the file is damaged or foreign"
        )
    return array
