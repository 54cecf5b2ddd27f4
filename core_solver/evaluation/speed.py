"""`python -m core_solver.evaluation.speed`: seconds and memory of the fast preset on clips of growing size."""

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from core_solver.body import BodyModel, load_body
from core_solver.errors import UserError
from core_solver.evaluation.cases import FULL, Case, choose_cases
from core_solver.evaluation.exchange import Problem, write_problem
from core_solver.evaluation.processes import Job, SolveFailedError, run_jobs
from core_solver.evaluation.synthetic import sized_scene
from core_solver.perception.store import ModelStore

_WARM_UP = (30, 1)  # a machine's first solve also compiles
SIZES = ((300, 3), (600, 3), (1200, 3))
LONG_SIZE = (3000, 5)
BAR_SECONDS, BAR_MB = 20.0, 2000.0

_TITLES = ("frames", "people", "seconds", "CPU s", "peak MB", "CPU ms a person-frame", "growth")
_WIDTHS = (7, 8, 9, 9, 9, 23, 8)
_HEADER = "".join(title.rjust(width) for title, width in zip(_TITLES, _WIDTHS, strict=True))


@dataclass(frozen=True)
class Timing:
    """One solve.

    Attributes:
        frames: T.
        people: N.
        seconds: of the solve, by the clock.
        cpu_seconds: of all its threads.
        peak_mb: of its process.
    """

    frames: int
    people: int
    seconds: float
    cpu_seconds: float
    peak_mb: float

    @property
    def milliseconds(self) -> float:
        """CPU time for each person and frame."""
        return 1000 * self.cpu_seconds / (self.frames * self.people)

    def line(self, first: "Timing") -> str:
        """A line of the table; growth 1.00 means linear in person-frames since the first size."""
        cells = (
            f"{self.frames}", f"{self.people}", f"{self.seconds:.1f}", f"{self.cpu_seconds:.1f}", f"{self.peak_mb:.0f}",
            f"{self.milliseconds:.2f}", f"{self.milliseconds / first.milliseconds:.2f}",
        )  # fmt: skip
        return "".join(cell.rjust(width) for cell, width in zip(cells, _WIDTHS, strict=True))


def measure(sizes: Sequence[tuple[int, int]], preset: str, body: BodyModel) -> Iterator[Timing]:
    """Solve a scene of each size, (frames, people), in a process of its own.

    Raises:
        UserError: a solve failed.
    """
    case = Case(preset, FULL)
    for frames, people in sizes:
        with tempfile.TemporaryDirectory(prefix="scene-aware-mocap-speed-") as folder:
            scene = sized_scene(frames, people, 0, body)
            problem = Path(folder) / "problem.npz"
            write_problem(problem, Problem(scene.modalities, scene.camera, scene.body))
            del scene
            job = Job(case, problem, Path(folder) / "outcome.npz")
            for finished in run_jobs([job], 1):
                try:
                    outcome = finished.result()
                except SolveFailedError as error:
                    raise UserError(f"{frames} frames with {people} people were not solved: {error}") from error
                yield Timing(frames, people, outcome.seconds, outcome.cpu_seconds, outcome.peak_mb)


def verdict(timing: Timing) -> str:
    """How the first size stands against its bars."""
    met = timing.seconds <= BAR_SECONDS and timing.peak_mb <= BAR_MB
    return (
        f"{timing.frames} frames x {timing.people} people: {timing.seconds:.1f} s (bar {BAR_SECONDS:.0f} s), "
        f"{timing.peak_mb:.0f} MB (bar {BAR_MB:.0f} MB): {'met' if met else 'MISSED'}"
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table while it grows."""
    parser = argparse.ArgumentParser(prog="python -m core_solver.evaluation.speed", description=__doc__)
    parser.add_argument("--long", action="store_true", help="also 3000 frames of 5 people")
    parser.add_argument("--preset", default="fast", metavar="P")
    parser.add_argument("--models-dir", type=Path, metavar="DIR", help="where models are kept")
    options = parser.parse_args(arguments)
    try:
        choose_cases("standard", [options.preset])
        body = load_body(ModelStore(options.models_dir).require("open-body"))
        list(measure((_WARM_UP,), options.preset, body))
        _say(_HEADER)
        timings: list[Timing] = []
        for timing in measure((*SIZES, LONG_SIZE) if options.long else SIZES, options.preset, body):
            timings.append(timing)
            _say(timing.line(timings[0]))
    except UserError as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    _say(verdict(timings[0]))
    return 0


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
