# SPDX-License-Identifier: GPL-3.0-or-later
"""Any file that can be imported, told apart by what it holds. numpy only."""

import zipfile
from pathlib import Path

from core_solver.errors import TakeError
from core_solver.take import Take, read_take

from .smpl_motion import is_smpl_motion, read_smpl_motion, take_of


def read_motion_file(path: Path) -> Take:
    """A take, or an SMPL motion as a take.

    Raises:
        TakeError: missing, unreachable, damaged, foreign or newer file; the message names the reason.
    """
    if is_smpl_motion(_entries(path)):
        return take_of(read_smpl_motion(path), path.stem)
    return read_take(path)


def _entries(path: Path) -> list[str]:
    """Names of an archive's arrays; none for what is no archive or is not there, which `read_take` then explains.

    Raises:
        TakeError: the system keeps the file from us.
    """
    try:
        if path.is_dir():
            return []
        with path.open("rb") as stream, zipfile.ZipFile(stream) as archive:
            return [name.removesuffix(".npy") for name in archive.namelist()]
    except (FileNotFoundError, NotADirectoryError, zipfile.BadZipFile):
        return []
    except OSError as error:
        raise TakeError(f"cannot read {path}: {error.strerror}; choose another file") from error
