"""`scene-aware-mocap evaluate`: scenes with exact truth, solved and measured, and takes of real clips with real truth.

`core_solver.cli` calls `add_parser` and then the handler that the parsed arguments carry as `run`. Errors leave as
`UserError`; the caller prints them on one line.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from core_solver.errors import UserError
from core_solver.evaluation import people_cli, real_cli

if TYPE_CHECKING:
    from collections.abc import Callable

    from core_solver.body import BodyModel
    from core_solver.evaluation.cases import Case
    from core_solver.evaluation.report import Origin
    from core_solver.evaluation.runner import Benchmark
    from core_solver.progress import Progress

SUITES = ("standard", "ablation", "stress")
_MOST_SEEDS = 1000


def add_parser(
    subparsers: argparse._SubParsersAction[argparse.ArgumentParser], make_progress: Callable[[], Progress]
) -> tuple[argparse.ArgumentParser, ...]:
    """Add the `evaluate` command; returns the parsers of its kinds, for options that all commands share."""
    evaluate = subparsers.add_parser("evaluate", help="measure the solver against truth")
    kinds = evaluate.add_subparsers(dest="kind", required=True, metavar="KIND")
    synthetic = kinds.add_parser("synthetic", help="generated scenes with exact truth")
    synthetic.add_argument("--suite", choices=SUITES, default="standard", help="which scenes (default: standard)")
    synthetic.add_argument(
        "--seed",
        dest="seeds",
        type=parse_seeds,
        default=(0,),
        metavar="N|A-B|A,B",
        help="random draws (default: 0)",
    )
    synthetic.add_argument(
        "--preset", dest="presets", action="append", metavar="P", help="how to solve; give it several times to compare"
    )
    synthetic.add_argument("--motions", type=Path, metavar="DIR", help="BVH files to take motion from")
    synthetic.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="where the results go")
    synthetic.add_argument("--json", action="store_true", help="print the rows as JSON instead of a table")
    synthetic.add_argument(
        "--jobs", type=_count, default=1, metavar="N", help="solves at a time; with more than 1 the times mean little"
    )
    synthetic.add_argument("--models-dir", type=Path, metavar="DIR", help="where models are kept")
    synthetic.set_defaults(
        run=lambda options: evaluate_synthetic(options, make_progress()),
        stopped="stopped: finished solves are kept; give the same command to go on",
    )
    return (synthetic, people_cli.add_parser(kinds), *real_cli.add_parsers(kinds, make_progress))


def evaluate_synthetic(options: argparse.Namespace, progress: Progress) -> int:
    """Run the suite, print the table and write the report; 1 if a solve failed."""
    from core_solver.body import load_body  # noqa: PLC0415 - keeps --help and bad input fast
    from core_solver.evaluation import plots, report, table  # noqa: PLC0415
    from core_solver.evaluation.cases import choose_cases  # noqa: PLC0415
    from core_solver.evaluation.runner import run_benchmark  # noqa: PLC0415
    from core_solver.evaluation.storage import make_directory  # noqa: PLC0415
    from core_solver.perception.store import ModelStore  # noqa: PLC0415

    if options.motions is not None and not options.motions.is_dir():
        raise UserError(f"there is no directory {options.motions}: check --motions")
    cases = choose_cases(options.suite, options.presets)
    make_directory(options.output)
    body = load_body(ModelStore(options.models_dir).require("open-body"))
    results = run_benchmark(_benchmark(options, cases, body), progress)
    rows = results.rows(cases)
    paths = report.write_report(options.output, results, rows, _origin(options, body))
    if options.json:
        _say(json.dumps({"rows": [row.as_json() for row in rows]}, indent=1))
    else:
        _say(table.plain_table(rows))
        for path in paths:
            _say(str(path))
    if not plots.can_draw():
        progress.note(plots.MISSING)
    for failure in results.failures:
        _say(str(failure), error=True)
    return 1 if results.failures else 0


def _benchmark(options: argparse.Namespace, cases: tuple[Case, ...], body: BodyModel) -> Benchmark:
    from core_solver.evaluation.runner import Benchmark  # noqa: PLC0415
    from core_solver.evaluation.storage import ScoreCache  # noqa: PLC0415
    from core_solver.evaluation.synthetic import SUITES, suite_scenes  # noqa: PLC0415

    return Benchmark(
        scenes=lambda seed: suite_scenes(options.suite, seed, body, options.motions),
        scene_count=len(SUITES[options.suite].kinds),
        seeds=options.seeds,
        cases=cases,
        cache=ScoreCache(options.output / "cache", f"{options.suite} {_motions(options)} {body.id}"),
        jobs=options.jobs,
    )


def _origin(options: argparse.Namespace, body: BodyModel) -> Origin:
    from core_solver.evaluation.report import Origin  # noqa: PLC0415
    from core_solver.evaluation.synthetic import NoiseLevels  # noqa: PLC0415

    motions = "built in" if options.motions is None else options.motions.name
    return Origin(options.suite, options.seeds, motions, body.id, options.jobs, vars(NoiseLevels()))


def _motions(options: argparse.Namespace) -> str:
    """The captured motion that scenes depend on: which files, and how large they are."""
    if options.motions is None:
        return "built in"
    return repr([(path.name, path.stat().st_size) for path in sorted(options.motions.rglob("*.bvh"))])


def parse_seeds(text: str) -> tuple[int, ...]:
    """Seeds from "3", "0-9" or "0,2,5-7", ascending and each once.

    Raises:
        argparse.ArgumentTypeError: anything else.
    """
    seeds: set[int] = set()
    for part in text.split(","):
        first, dash, last = part.strip().partition("-")
        if not (first.isdecimal() and (last.isdecimal() if dash else True)):
            raise argparse.ArgumentTypeError(f"{text!r} names no seeds: give a number, a range like 0-9, or 0,2,5")
        start, stop = int(first), int(last) if dash else int(first)
        if stop < start or stop - start >= _MOST_SEEDS:
            raise argparse.ArgumentTypeError(f"{part.strip()!r} is no range of seeds: give it like 0-9")
        seeds.update(range(start, stop + 1))
    return tuple(sorted(seeds))


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(text)


def _say(text: str, *, error: bool = False) -> None:
    (sys.stderr if error else sys.stdout).write(text + "\n")
