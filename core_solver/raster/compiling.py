"""How this room's functions become machine code: fast mathematics that still knows NaN, kept on disk."""

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from platformdirs import user_cache_path

# Everything of fast-math except the promise that there are no NaN: a vertex that cannot be drawn is marked by NaN.
_FAST = {"reassoc", "contract", "arcp", "nsz", "afn"}


def helper(function: Callable) -> Any:
    """Compile a small function for use inside kernels, where it is inlined."""
    return numba.njit(fastmath=_FAST, error_model="numpy")(function)


def kernel(function: Callable) -> Any:
    """Compile an entry function whose `numba.prange` loops run in parallel, and keep its machine code on disk."""
    return _cached(function, parallel=True)


def _cached(function: Callable, *, parallel: bool) -> Any:
    options = {"fastmath": _FAST, "error_model": "numpy", "parallel": parallel}
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined]
    numba.config.CACHE_DIR = str(_cache_folder(before))  # type: ignore[attr-defined]
    try:
        return numba.njit(cache=True, **options)(function)
    except RuntimeError:  # numba found no folder it may write to
        return numba.njit(**options)(function)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]


@cache
def _cache_folder(parent: str) -> Path:
    """A folder that changes with this room's sources.

    Numba notices a change in the file of an entry function but not in the files of the helpers inlined in it, so its
    own cache would go on running yesterday's helpers.
    """
    digest = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("*.py")):
        digest.update(path.read_bytes())
    folder = Path(parent) if parent else user_cache_path("scene-aware-mocap", appauthor=False) / "compiled"
    return folder / digest.hexdigest()[:16]
