"""Text files that appear whole or not at all."""

import os
import tempfile
from pathlib import Path

from core_solver.errors import UserError


def write_text_whole(path: Path, text: str) -> None:
    """Write a UTF-8 file, and its folders where they are missing.

    Raises:
        UserError: the disk refuses it; an older file stays.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=f".{path.name}.", suffix=".part", dir=path.parent)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; choose another place with -o") from error
    temporary = Path(name)
    try:
        # Names of files need not be Unicode: what cannot be written is replaced.
        with os.fdopen(handle, "w", encoding="utf-8", errors="replace", newline="\n") as stream:
            stream.write(text)
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise UserError(f"cannot write {path}: {error.strerror}; free some space or choose another place") from error
    finally:
        temporary.unlink(missing_ok=True)
