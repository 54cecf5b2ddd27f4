"""How long work tells that it is alive. The CLI draws bars, the add-on reads lines, tests stay silent."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol

Advance = Callable[[int], None]


class Progress(Protocol):
    """Something that can show stages of known length."""

    def stage(self, name: str, total: int) -> AbstractContextManager[Advance]:
        """Open a stage of `total` steps; the value of the context is called with the number of steps just done."""
        ...

    def note(self, message: str) -> None:
        """Show one plain sentence to the user, once."""
        ...


class SilentProgress:
    """Shows nothing."""

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:  # noqa: ARG002 - the protocol's signature
        """Open a stage that nobody watches."""
        yield lambda _steps: None

    def note(self, message: str) -> None:
        """Say nothing."""
