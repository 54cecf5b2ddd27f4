"""Threads and memory of the libraries below."""

import ctypes
import functools
import platform
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits

_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3  # of glibc's mallopt
_KEEP_BYTES = 1 << 30


@functools.cache
def keep_freed_memory() -> None:
    """Let the C library keep what arrays give back instead of returning it to the system after every operation.

    Fetching fresh pages for each array costs more than most of the arithmetic here. Elsewhere than on Linux with glibc
    this does nothing.
    """
    if platform.libc_ver()[0] == "glibc":
        library = ctypes.CDLL(None)
        library.mallopt(_MMAP_THRESHOLD, _KEEP_BYTES)
        library.mallopt(_TRIM_THRESHOLD, _KEEP_BYTES)


@contextmanager
def single_thread() -> Iterator[None]:
    """One thread for torch and BLAS: sums in a fixed order give the same take on every machine.

    Small products gain nothing from more, and threads that wait for each other on a busy machine lose a lot.
    """
    keep_freed_memory()
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before)
