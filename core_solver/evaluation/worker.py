"""One solve in a process of its own, so that its time and memory are its alone.

`python -m core_solver.evaluation.worker PROBLEM.npz OUTCOME.npz PRESET [TERM ...]`; the terms are left out.
"""

import sys
import time
from pathlib import Path

from core_solver.evaluation.baseline import NAME, baseline
from core_solver.evaluation.exchange import Outcome, Problem, read_problem, write_outcome
from core_solver.evaluation.memory import peak_mb
from core_solver.optimise.presets import PRESETS
from core_solver.optimise.solution import Solution
from core_solver.optimise.solve import solve
from core_solver.progress import SilentProgress


def main(arguments: list[str]) -> int:
    """Read the problem, solve it, write the outcome."""
    problem_path, outcome_path, preset, *without = arguments
    problem = read_problem(Path(problem_path))
    started, cpu_started = time.perf_counter(), time.process_time()
    solution = run_preset(problem, preset, without)
    seconds, cpu_seconds = time.perf_counter() - started, time.process_time() - cpu_started
    write_outcome(Path(outcome_path), Outcome(solution, seconds, cpu_seconds, peak_mb()))
    return 0


def run_preset(problem: Problem, preset: str, without: list[str]) -> Solution:
    """Solve with the named preset, or as the baseline does."""
    if preset == NAME:
        return baseline(problem.modalities, problem.camera, problem.body)
    chosen = PRESETS[preset].without(*without)
    return solve(problem.modalities, problem.camera, problem.body, SilentProgress(), chosen)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
