import subprocess
import sys
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from core_solver.evaluation import processes, runner
from core_solver.evaluation.cases import FULL, Case
from core_solver.evaluation.processes import Job, SolveFailedError, run_jobs
from core_solver.evaluation.runner import Benchmark, Results, Scored, run_benchmark
from core_solver.evaluation.storage import ScoreCache
from core_solver.progress import SilentProgress
from tests.solver.evaluation.fakes import good_and_broken, make_fake, start_here, tiny_suite

CASES = (Case("baseline", FULL),)
BALLAST_MB = 600


class Notes(SilentProgress):
    def __init__(self) -> None:
        self.notes: list[str] = []

    def note(self, message: str) -> None:
        self.notes.append(message)


class StopsAfterOne(SilentProgress):
    """Ctrl-C as soon as one solve is finished."""

    @contextmanager
    def stage(self, *_):
        def advance(_steps):
            raise KeyboardInterrupt

        yield advance


@pytest.fixture
def cache(tmp_path):
    return ScoreCache(tmp_path / "cache", "tiny")


def never(seed):
    pytest.fail(f"seed {seed} was generated again")


def test_a_failing_solve_is_named_and_the_rest_goes_on_and_is_kept(cache):
    progress = Notes()
    ballast = np.ones(BALLAST_MB * 10**6 // 8)
    results = run_benchmark(Benchmark(good_and_broken, 2, (0,), CASES, cache), progress)
    assert ballast.all()
    (scored,), (failure,) = results.scored, results.failures
    assert (failure.scene, failure.case.preset) == ("broken", "baseline")
    assert "broken" in progress.notes[0]
    assert "ValueError" in failure.reason
    measures = scored.scores.measures
    assert 0 < measures.seconds < 60
    # Its own memory: neither the scene's truth nor whatever else this process holds.
    assert 50 < measures.peak_mb < BALLAST_MB
    assert measures.mrpe_mm > 50
    row = results.rows(CASES)[0].as_json()
    assert (row["preset"], row["ablation"], row["seeds"]) == ("baseline", "none", [0])
    assert row["mrpe_mm"] == pytest.approx(measures.mrpe_mm)
    assert cache.read(0, "good", CASES[0]) == scored.scores
    assert cache.read(0, "broken", CASES[0]) is None


def test_a_stopped_run_goes_on_where_it_was(cache, monkeypatch):
    monkeypatch.setattr(Job, "start", start_here)
    benchmark = Benchmark(tiny_suite, 2, (0,), CASES, cache)
    with pytest.raises(KeyboardInterrupt):
        run_benchmark(benchmark, StopsAfterOne())
    first = cache.read(0, "first", CASES[0])
    assert first is not None
    started = []
    monkeypatch.setattr(Job, "start", lambda job: started.append(job) or start_here(job))
    results = run_benchmark(benchmark, SilentProgress())
    assert len(started) == 1
    assert [scored.scores.scene for scored in results.scored] == ["first", "second"]
    assert results.scored[0].scores == first
    again = run_benchmark(replace(benchmark, scenes=never), SilentProgress())
    assert again == results


def test_a_solution_that_is_not_finite_is_a_failure(cache, monkeypatch):
    fake = make_fake()
    broken = replace(fake.solution, gamma=np.full_like(fake.solution.gamma, np.nan))

    def pretend(jobs, at_once):
        yield from jobs

    monkeypatch.setattr(runner, "run_jobs", pretend)
    monkeypatch.setattr(Job, "result", lambda _: processes.Outcome(broken, 1.0, 1.0, 100.0))
    results = run_benchmark(Benchmark(lambda _: [fake.scene], 1, (0,), CASES, cache), SilentProgress())
    assert results.scored == ()
    assert "not finite" in results.failures[0].reason


def test_rows_keep_the_order_of_cases_and_skip_those_without_scores():
    scores = _scores()
    exact, fast, paper = (Case(name, FULL) for name in ("exact", "fast", "paper"))
    results = Results((Scored(1, fast, scores), Scored(0, exact, scores), Scored(0, fast, scores)), ())
    rows = results.rows((paper, exact, fast))
    assert [(row.preset, row.seeds) for row in rows] == [("exact", (0,)), ("fast", (0, 1))]


def _scores():
    from core_solver.evaluation.scores import evaluate_scene

    fake = make_fake()
    return evaluate_scene(fake.scene, fake.solution, 1.0, 1.0)


# --- processes ---


def command(monkeypatch, code_for):
    """Jobs run a line of Python instead of a solve."""
    monkeypatch.setattr(Job, "start", lambda job: subprocess.Popen([sys.executable, "-c", code_for(job)]))


def make_jobs(tmp_path, names):
    return [Job(CASES[0], tmp_path / "p.npz", tmp_path / f"{name}.npz") for name in names]


def test_no_process_outlives_a_stopped_run(tmp_path, monkeypatch):
    command(monkeypatch, lambda job: "pass" if job.outcome.stem == "quick" else "import time; time.sleep(600)")
    started = []
    start = Job.start
    monkeypatch.setattr(Job, "start", lambda job: started.append(start(job)) or started[-1])
    jobs = run_jobs(make_jobs(tmp_path, ["quick", "endless"]), 2)
    assert next(jobs).outcome.stem == "quick"
    assert started[1].poll() is None
    jobs.close()
    assert started[1].poll() is not None


def test_no_more_processes_at_once_than_asked_for(tmp_path, monkeypatch):
    command(monkeypatch, lambda _: "import time; time.sleep(0.2)")
    running, most = [], []
    start = Job.start

    def counted(job):
        running.append(start(job))
        most.append(sum(process.poll() is None for process in running))
        return running[-1]

    monkeypatch.setattr(Job, "start", counted)
    assert len(list(run_jobs(make_jobs(tmp_path, "abcde"), 2))) == 5
    assert max(most) == 2


def test_a_process_that_dies_in_silence_is_still_explained(tmp_path):
    (job,) = make_jobs(tmp_path, ["a"])
    job.outcome.with_suffix(".log").write_text("")
    with pytest.raises(SolveFailedError, match="out of memory"):
        job.result()
