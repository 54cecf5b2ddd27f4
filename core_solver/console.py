"""Progress for people at a terminal, and for programs that read our lines."""

import json
import sys
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import TextIO

from tqdm import tqdm

from core_solver.progress import Advance

_BAR_FORMAT = "{desc:<22}{percentage:3.0f} %|{bar:28}| {n_fmt}/{total_fmt}  {elapsed}, {remaining} left"
_LINE_EVERY_PERCENT = 10
_JSON_EVERY_S = 0.2


class ConsoleProgress:
    """Remembers the seconds of every stage; what is shown of it is its children's."""

    def __init__(self, stream: TextIO | None = None) -> None:
        """Show on `stream`, by default standard error."""
        self._stream = stream if stream is not None else sys.stderr
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, total: int) -> Iterator[Advance]:
        """Open a stage of `total` steps; the value of the context is called with the number of steps just done."""
        started = time.perf_counter()
        try:
            with self._shown(name, total) as advance:
                yield advance
        finally:
            self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - started

    def note(self, message: str) -> None:
        """Show one plain sentence."""
        raise NotImplementedError

    def summary(self) -> str:
        """A table of the seconds each stage took; empty before the first stage."""
        if not self.seconds:
            return ""
        rows = [*self.seconds.items(), ("total", sum(self.seconds.values()))]
        width = max(len(name) for name, _ in rows)
        return "\n".join(f"  {name:<{width}}  {seconds:8.1f} s" for name, seconds in rows)

    def _shown(self, name: str, total: int) -> AbstractContextManager[Advance]:
        raise NotImplementedError

    def _line(self, text: str) -> None:
        self._stream.write(text + "\n")
        self._stream.flush()


class BarProgress(ConsoleProgress):
    """Bars with the time left on a terminal; elsewhere a plain line every 10 %."""

    def note(self, message: str) -> None:
        """Show one plain sentence."""
        if self._stream.isatty():
            tqdm.write(message, file=self._stream)
        else:
            self._line(message)

    def _shown(self, name: str, total: int) -> AbstractContextManager[Advance]:
        return self._bar(name, total) if self._stream.isatty() else self._lines(name, total)

    @contextmanager
    def _bar(self, name: str, total: int) -> Iterator[Advance]:
        with tqdm(total=total, desc=name, file=self._stream, bar_format=_BAR_FORMAT, dynamic_ncols=True) as bar:
            yield lambda steps: _discard(bar.update(steps))

    @contextmanager
    def _lines(self, name: str, total: int) -> Iterator[Advance]:
        started, done, shown = time.perf_counter(), 0, 0

        def advance(steps: int) -> None:
            nonlocal done, shown
            done += steps
            percent = 100 * done // max(total, 1)
            if percent >= shown + _LINE_EVERY_PERCENT:
                shown = percent - percent % _LINE_EVERY_PERCENT
                elapsed = time.perf_counter() - started
                left = elapsed * max(total - done, 0) / max(done, 1)
                self._line(f"{name}: {percent} % ({elapsed:.0f} s, {left:.0f} s left)")

        self._line(f"{name}: started")
        yield advance


class JsonProgress(ConsoleProgress):
    """One JSON object a line, for programs: `{"stage": ..., "done": n, "total": m}` and `{"note": ...}`.

    A stage is told of at its beginning, at most five times a second while it goes on, and when it is complete.
    """

    def note(self, message: str) -> None:
        """Tell one plain sentence."""
        self._line(json.dumps({"note": message}))

    @contextmanager
    def _shown(self, name: str, total: int) -> Iterator[Advance]:
        done, told_at = 0, -_JSON_EVERY_S

        def tell() -> None:
            nonlocal told_at
            told_at = time.monotonic()
            self._line(json.dumps({"stage": name, "done": done, "total": total}))

        def advance(steps: int) -> None:
            nonlocal done
            done += steps
            if done >= total or time.monotonic() >= told_at + _JSON_EVERY_S:
                tell()

        tell()
        yield advance


def _discard(_value: object) -> None:
    """Forget a value: `Advance` returns nothing."""
