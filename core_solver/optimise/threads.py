"""Threads of the libraries below."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from threadpoolctl import threadpool_limits


@contextmanager
def single_thread() -> Iterator[None]:
    """One thread for torch and BLAS: sums in a fixed order give the same take on every machine.

    Small products gain nothing from more, and threads that wait for each other on a busy machine lose a lot.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with threadpool_limits(limits=1, user_api="blas"):
            yield
    finally:
        torch.set_num_threads(before)
