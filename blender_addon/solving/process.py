# SPDX-License-Identifier: GPL-3.0-or-later
"""A running solver: what it says, how far it is, and its end. No Blender in here, and nothing that waits."""

import contextlib
import json
import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from .python import MODULE, NO_WINDOW, SolverError, environment
from .request import SolveRequest

_GRACE_S = 5.0
"""So long a cancelled solver may take to tidy up before it is killed."""
_BAR = re.compile(r"^(?P<name>[^:|]+):\s+(?P<percent>\d+)%\|")
"""Downloads of networks, which come before the first stage, are shown as bars."""


@dataclass(frozen=True)
class Stage:
    """What the solver is doing.

    Attributes:
        name: as the solver calls it; empty before the first stage.
        done: steps.
        total: steps.
        began: `time.monotonic()` at its beginning.
    """

    name: str = ""
    done: int = 0
    total: int = 0
    began: float = 0.0

    @property
    def fraction(self) -> float:
        """0 to 1."""
        return min(self.done / self.total, 1.0) if self.total else 0.0

    def seconds_left(self, now: float) -> float | None:
        """Until the end of this stage, as fast as it went so far; None before the first step."""
        return (now - self.began) * (self.total - self.done) / self.done if self.done else None


class SolverProcess:
    """The solver at work on one video. `poll` it now and then; it never blocks.

    Attributes:
        request: what was asked.
        stage: what it is doing.
        lines: what it has said so far, without its progress.
        cancelled: whether it was told to stop.
    """

    def __init__(self, python: Path, request: SolveRequest) -> None:
        """Start it.

        Raises:
            SolverError: the Python does not run, or the log cannot be written.
        """
        self.request = request
        self.stage = Stage()
        self.lines: list[str] = []
        self.cancelled = False
        self._cancelled_at = 0.0
        self._said: queue.SimpleQueue[str | None] = queue.SimpleQueue()
        self._listening = True
        command = [str(python), "-m", MODULE, *request.words()]
        try:
            request.log.parent.mkdir(parents=True, exist_ok=True)
            self._log = request.log.open("w", encoding="utf-8")
        except OSError as error:
            raise SolverError(f"the solver's log cannot be written: {error}") from error
        try:
            self._child = _start(command)
        except OSError as error:
            self._log.close()
            request.log.unlink()
            raise SolverError(f"the solver cannot be started: {error}") from error
        threading.Thread(target=_listen, args=(self._child.stdout, self._said), daemon=True).start()

    def poll(self) -> bool:
        """Take in what was said; False once the solver has ended and everything is read."""
        if self.cancelled and time.monotonic() > self._cancelled_at + _GRACE_S:
            self._kill()
        while self._listening and not self._said.empty():
            line = self._said.get()
            if line is None:
                self._end()
            else:
                self._hear(line)
        return self._listening

    def wait(self) -> None:
        """Block until the end, for scripts."""
        while self.poll():
            time.sleep(0.05)

    def cancel(self) -> None:
        """Ask the solver and all that it has started to stop; goes on to `poll` until they have."""
        if not self._listening or self.cancelled:
            return
        self.cancelled, self._cancelled_at = True, time.monotonic()
        if sys.platform == "win32":
            self._kill()  # without a console of its own, nothing gentler reaches it
        else:
            _signal_group(self._child.pid, signal.SIGINT)

    def check(self) -> None:
        """Look at how it ended.

        Raises:
            SolverError: it failed or was stopped; says why.
        """
        if self.cancelled:
            raise SolverError("the solve was cancelled: nothing was written")
        if self._child.returncode != 0:
            reason = next((line for line in reversed(self.lines) if line.startswith("error: ")), None)
            code = self._child.returncode
            raise SolverError(reason.removeprefix("error: ") if reason else f"the solver ended with code {code}")
        if not self.request.take.is_file():
            raise SolverError("the solver has written no take")

    def _hear(self, line: str) -> None:
        event = _event(line)
        if event is None:
            if line.strip():
                self._keep(line)
        elif "note" in event:
            self._keep(event["note"])
        elif "stage" in event:
            name, done, total = event["stage"], event["done"], event["total"]
            before, now = self.stage, time.monotonic()
            goes_on = name == before.name and done >= before.done
            self.stage = Stage(name, done, total, before.began if goes_on else now)
            if done >= total and not (goes_on and before.done >= total):
                self._keep(f"{name}: {total} done in {now - self.stage.began:.1f} s")

    def _keep(self, line: str) -> None:
        self.lines.append(line)
        self._log.write(line + "\n")
        self._log.flush()

    def _end(self) -> None:
        self._child.wait()
        self._listening = False
        if self.cancelled:
            # Whoever is killed in the middle of writing leaves this behind.
            take = self.request.take
            for part in take.parent.glob(f".{take.name}.*.part"):
                part.unlink(missing_ok=True)
        self._log.close()

    def _kill(self) -> None:
        if sys.platform == "win32":
            words = ["taskkill", "/F", "/T", "/PID", str(self._child.pid)]
            subprocess.run(words, capture_output=True, check=False, creationflags=NO_WINDOW)
        else:
            _signal_group(self._child.pid, signal.SIGKILL)


def _start(command: list[str]) -> subprocess.Popen[str]:
    """A group of its own can be stopped with all that it starts, without Blender."""
    return subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        encoding="utf-8",
        errors="replace",
        env=environment(),
        start_new_session=sys.platform != "win32",
        creationflags=NO_WINDOW,
    )


def _listen(stream: IO[str] | None, said: "queue.SimpleQueue[str | None]") -> None:
    """Pass on line by line, then None: reading a pipe may block, so a thread does it."""
    if stream is not None:
        with stream:
            for line in stream:
                said.put(line.rstrip("\r\n"))
    said.put(None)


def _event(line: str) -> dict[str, Any] | None:
    """A line of progress as the object it is, also where it is a bar; None for any other line."""
    bar = _BAR.match(line)
    if bar is not None:
        return {"stage": bar["name"], "done": int(bar["percent"]), "total": 100}
    if not line.startswith("{"):
        return None
    try:
        event = json.loads(line)
    except ValueError:
        return None
    return event if isinstance(event, dict) else None


def _signal_group(group: int, what: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.killpg(group, what)
