"""Solves in processes of their own, a few at a time."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import core_solver
from core_solver.evaluation.cases import Case
from core_solver.evaluation.exchange import Outcome, read_outcome

_WORKER = "core_solver.evaluation.worker"
_GLANCE_S = 0.05


class SolveFailedError(Exception):
    """A solve ended without a solution; the message is the last line it said."""


@dataclass(frozen=True)
class Job:
    """One case of one problem.

    Attributes:
        case: how to solve.
        problem: file of the problem.
        outcome: file where the outcome goes; what the process says lies beside it.
    """

    case: Case
    problem: Path
    outcome: Path

    def result(self) -> Outcome:
        """What the finished process wrote.

        Raises:
            SolveFailedError: nothing.
        """
        if self.outcome.is_file():
            return read_outcome(self.outcome)
        lines = self._log.read_text(encoding="utf-8", errors="replace").strip().splitlines()
        raise SolveFailedError(lines[-1] if lines else "the process ended without a word (out of memory?)")

    @property
    def _log(self) -> Path:
        return self.outcome.with_suffix(".log")

    def start(self) -> subprocess.Popen[bytes]:
        """Start the process."""
        command = [sys.executable, "-m", _WORKER, str(self.problem), str(self.outcome), self.case.preset]
        # The same sources as ours, also where they are not installed.
        paths = [str(Path(core_solver.__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
        with self._log.open("wb") as log:
            return subprocess.Popen(
                [*command, *self.case.left_out], stdout=log, stderr=subprocess.STDOUT, env=environment
            )


def run_jobs(jobs: Sequence[Job], at_once: int) -> Iterator[Job]:
    """Run the jobs and yield each when its process has ended; processes do not outlive the iterator."""
    waiting = list(jobs)
    running: dict[subprocess.Popen[bytes], Job] = {}
    try:
        while waiting or running:
            while waiting and len(running) < at_once:
                job = waiting.pop(0)
                running[job.start()] = job
            time.sleep(_GLANCE_S)
            for process in [p for p in running if p.poll() is not None]:
                yield running.pop(process)
    finally:
        for process in running:
            process.kill()
            process.wait()
