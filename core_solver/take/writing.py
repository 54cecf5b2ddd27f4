"""Write a take, whole or not at all."""

import os
import tempfile
import zipfile
from pathlib import Path
from typing import IO

import numpy as np

from core_solver.errors import TakeError
from core_solver.take import keys
from core_solver.take.metadata import encode_meta
from core_solver.take.model import Take
from core_solver.take.validation import check_take

# The zip format's earliest date: the same take gives the same bytes whenever it is written.
_ZIP_EPOCH = (1980, 1, 1, 0, 0, 0)


def write_take(path: Path, take: Take) -> None:
    """Write `take` to `path`; an old file there is replaced only when the new one is complete.

    Raises:
        TakeError: the take is inconsistent, or the disk refuses it (message says why); the old file stays.
    """
    check_take(take)
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise TakeError(f"cannot write {path}: {error.strerror}; choose another place with -o") from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            _write_archive(stream, take)
            stream.flush()
            os.fsync(stream.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise TakeError(f"cannot write {path}: {error.strerror}; free some space or choose another place") from error
    finally:
        temporary.unlink(missing_ok=True)


def take_arrays(take: Take) -> dict[str, np.ndarray]:
    """All arrays of the file under their keys, in the file's types."""
    arrays = dict(take.extra)
    arrays[keys.META] = np.frombuffer(encode_meta(take.meta, take.people, take.frame_count), np.uint8)
    arrays[keys.TIMES] = np.asarray(take.times, np.float64)
    if take.steadying is not None:
        arrays[keys.STEADYING] = np.asarray(take.steadying, np.float64)
    for index, person in enumerate(take.people):
        for field, spec in keys.PERSON_ARRAYS.items():
            arrays[keys.PERSON.format(index=index, field=field)] = np.asarray(getattr(person, field), spec.dtype)
    for field, spec in keys.SCENE_ARRAYS.items():
        arrays[keys.SCENE.format(field=field)] = np.asarray(getattr(take.scene, field), spec.dtype)
    return arrays


def _write_archive(stream: IO[bytes], take: Take) -> None:
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=4) as archive:
        for key, array in take_arrays(take).items():
            entry = zipfile.ZipInfo(f"{key}.npy", _ZIP_EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            with archive.open(entry, "w", force_zip64=True) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)
