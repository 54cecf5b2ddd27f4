"""Read a take, with every shape checked before anyone uses it."""

import zipfile
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import TakeError
from core_solver.take import keys
from core_solver.take.metadata import decode_meta, parse_document
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
    if not path.is_file():
        raise TakeError("no such file")
    try:
        arrays = _load_archive(path)
    except (OSError, ValueError, EOFError, KeyError, NotImplementedError, zipfile.BadZipFile, zlib.error) as error:
        raise TakeError(f"not a readable .npz archive ({error}): copy or solve it again") from error
    if keys.META not in arrays:
        raise TakeError("not a Scene-Aware Mocap take: it has no meta entry")
    return arrays


def _load_archive(path: Path) -> dict[str, NDArray[Any]]:
    archive = np.load(path, allow_pickle=False)
    if not isinstance(archive, np.lib.npyio.NpzFile):
        return {}
    with archive:
        return {key: archive[key] for key in archive.files}


def _assemble(arrays: dict[str, NDArray[Any]]) -> Take:
    document = parse_document(arrays.pop(keys.META).tobytes())
    meta = decode_meta(document)
    times = _pop(arrays, keys.TIMES)
    people = tuple(_read_person(arrays, index, facts) for index, facts in enumerate(document.get("people", [])))
    scene = Scene(**{field: _pop(arrays, keys.SCENE.format(field=field)) for field in keys.SCENE_ARRAYS})
    take = Take(meta, times, people, scene, extra=arrays)
    check_take(take)
    return take


def _read_person(arrays: dict[str, NDArray[Any]], index: int, facts: dict[str, Any]) -> Person:
    values: dict[str, Any] = {
        field: _pop(arrays, keys.PERSON.format(index=index, field=field)) for field in keys.PERSON_ARRAYS
    }
    try:
        values["scale"] = float(values["scale"])
        red, green, blue = (float(c) for c in facts["colour"])
        return Person(
            id=int(facts["id"]),
            name=str(facts["name"]),
            height_m=float(facts["height_m"]),
            colour=(red, green, blue),
            **values,
        )
    except (KeyError, TypeError, ValueError) as error:
        raise TakeError(f"the facts of person {index} are damaged ({error})") from error


def _pop(arrays: dict[str, NDArray[Any]], key: str) -> NDArray[Any]:
    if key not in arrays:
        raise TakeError(f"the entry {key} is missing: the file is damaged")
    return arrays.pop(key)
