"""Run a suite: generate scenes, solve each in every case, measure, and keep what is finished."""

import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from core_solver.evaluation.cases import Case
from core_solver.evaluation.exchange import Problem, write_problem
from core_solver.evaluation.processes import Job, SolveFailedError, run_jobs
from core_solver.evaluation.scores import Row, SceneScores, evaluate_scene, mean_row
from core_solver.evaluation.storage import ScoreCache
from core_solver.evaluation.truth import SyntheticScene
from core_solver.optimise.solution import Solution
from core_solver.progress import Progress


@dataclass(frozen=True)
class Benchmark:
    """What to run.

    Attributes:
        scenes: the scenes of a seed, one after the other.
        scene_count: how many a seed has.
        seeds: whose scenes.
        cases: how to solve each.
        cache: where finished scores are kept.
        jobs: solves at a time; times are only comparable with 1.
    """

    scenes: Callable[[int], Iterable[SyntheticScene]]
    scene_count: int
    seeds: tuple[int, ...]
    cases: tuple[Case, ...]
    cache: ScoreCache
    jobs: int = 1


@dataclass(frozen=True)
class Scored:
    """Scores and where they come from."""

    seed: int
    case: Case
    scores: SceneScores


@dataclass(frozen=True)
class Failure:
    """A solve that gave nothing.

    Attributes:
        seed: of the scene.
        scene: its name.
        case: how it was to be solved.
        reason: one line.
    """

    seed: int
    scene: str
    case: Case
    reason: str

    def __str__(self) -> str:
        return f"scene {self.scene} of seed {self.seed} was not solved by {self.case.label}: {self.reason}"


@dataclass(frozen=True)
class Results:
    """All that a run gave."""

    scored: tuple[Scored, ...]
    failures: tuple[Failure, ...]

    def rows(self, cases: Iterable[Case]) -> tuple[Row, ...]:
        """One row for each case that solved anything."""
        return tuple(row for case in cases if (row := self._row(case)))

    def _row(self, case: Case) -> Row | None:
        own = [scored for scored in self.scored if scored.case == case]
        seeds = sorted({scored.seed for scored in own})
        return mean_row(case.preset, case.ablation.name, seeds, [s.scores for s in own]) if own else None


def run_benchmark(benchmark: Benchmark, progress: Progress) -> Results:
    """Run everything that is not in the cache yet; a solve that fails is noted and the rest goes on."""
    scored: list[Scored] = []
    failures: list[Failure] = []
    total = benchmark.scene_count * len(benchmark.seeds) * len(benchmark.cases)
    with progress.stage("Solve scenes", total) as advance:
        for seed in benchmark.seeds:
            for result in _finished(benchmark, seed) or _run_seed(benchmark, seed):
                advance(1)
                if isinstance(result, Failure):
                    failures.append(result)
                    progress.note(str(result))
                else:
                    scored.append(result)
    return Results(tuple(scored), tuple(failures))


def _finished(benchmark: Benchmark, seed: int) -> list[Scored] | None:
    """All scores of a seed from the cache, without generating a scene; None if one is missing."""
    names = benchmark.cache.read_names(seed)
    if names is None:
        return None
    kept = [
        (case, scores)
        for name in names
        for case in benchmark.cases
        if (scores := benchmark.cache.read(seed, name, case)) is not None
    ]
    is_whole = len(kept) == len(names) * len(benchmark.cases)
    return [Scored(seed, case, scores) for case, scores in kept] if is_whole else None


def _run_seed(benchmark: Benchmark, seed: int) -> Iterator[Scored | Failure]:
    names = []
    for scene in benchmark.scenes(seed):
        names.append(scene.name)
        yield from _run_scene(benchmark, seed, scene)
    benchmark.cache.write_names(seed, names)


def _run_scene(benchmark: Benchmark, seed: int, scene: SyntheticScene) -> Iterator[Scored | Failure]:
    missing = []
    for case in benchmark.cases:
        kept = benchmark.cache.read(seed, scene.name, case)
        if kept is None:
            missing.append(case)
        else:
            yield Scored(seed, case, kept)
    if not missing:
        return
    benchmark.cache.directory.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="solve-", dir=benchmark.cache.directory) as folder:
        problem = Path(folder) / "problem.npz"
        write_problem(problem, Problem(scene.modalities, scene.camera, scene.body))
        jobs = [Job(case, problem, Path(folder) / f"{index}.npz") for index, case in enumerate(missing)]
        for job in run_jobs(jobs, benchmark.jobs):
            yield _score(benchmark.cache, seed, scene, job)


def _score(cache: ScoreCache, seed: int, scene: SyntheticScene, job: Job) -> Scored | Failure:
    try:
        outcome = job.result()
    except SolveFailedError as error:
        return Failure(seed, scene.name, job.case, str(error))
    if not _is_finite(outcome.solution):
        return Failure(seed, scene.name, job.case, "the solution holds numbers that are not finite")
    scores = evaluate_scene(scene, outcome.solution, outcome.seconds, outcome.peak_mb)
    cache.write(seed, job.case, scores)
    return Scored(seed, job.case, scores)


def _is_finite(solution: Solution) -> bool:
    arrays = [value for value in vars(solution).values() if isinstance(value, np.ndarray)]
    return all(np.isfinite(array).all() for array in arrays)
