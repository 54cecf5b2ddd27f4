"""`scene-aware-mocap evaluate multiview | mupots | panoptic`: takes of real clips against real truth."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from core_solver.errors import UserError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Callable, Sequence

    from core_solver.evaluation.mupots import OfficialScores
    from core_solver.evaluation.real_scores import RealRow
    from core_solver.evaluation.real_truth import RealTruth
    from core_solver.evaluation.take_people import TakePeople
    from core_solver.progress import Progress
    from core_solver.take import Take

    # The type of what `add_subparsers` returns has no public name.
    Kinds = argparse._SubParsersAction[argparse.ArgumentParser]

TAKE = "take.npz"

_STOPPED = "stopped: nothing was written"


def add_parsers(kinds: Kinds, make_progress: Callable[[], Progress]) -> tuple[argparse.ArgumentParser, ...]:
    """Add the kinds of truth that come from real clips; returns their parsers."""
    multiview = kinds.add_parser("multiview", help="one take against joints measured with several cameras")
    multiview.add_argument("take", type=Path, metavar="TAKE")
    multiview.add_argument("--truth", type=Path, required=True, metavar="TRUTH.npz", help="see docs/evaluation.md")
    multiview.add_argument("--camera", required=True, metavar="NAME", help="the camera that filmed the take's clip")
    multiview.set_defaults(run=evaluate_multiview)

    mupots = kinds.add_parser("mupots", help=f"takes TSn/{TAKE} against MuPoTS-3D")
    mupots.add_argument("directory", type=Path, metavar="DIR", help="the dataset: TS1/annot.mat and so on")
    mupots.set_defaults(run=lambda options: evaluate_mupots(options, make_progress()))

    panoptic = kinds.add_parser("panoptic", help="takes SEQ/take_CAMERA.npz against CMU Panoptic")
    panoptic.add_argument("directory", type=Path, metavar="DIR", help="the dataset, or one sequence of it")
    panoptic.add_argument("--camera", metavar="NAME", help=f"the camera of takes that are called {TAKE}, like 00_16")
    panoptic.set_defaults(run=lambda options: evaluate_panoptic(options, make_progress()))

    for parser in (mupots, panoptic):
        parser.add_argument("--takes", type=Path, metavar="DIR2", help="where the sequences' takes are (default: DIR)")
    parsers = (multiview, mupots, panoptic)
    for parser in parsers:
        parser.add_argument("--json", action="store_true", help="print the rows as JSON instead of a table")
        parser.set_defaults(stopped=_STOPPED)
    return parsers


def evaluate_multiview(options: argparse.Namespace) -> int:
    """One take against the truth of one camera."""
    from core_solver.evaluation.multiview import read_multiview  # noqa: PLC0415 - keeps --help and bad input fast
    from core_solver.evaluation.take_people import people_of  # noqa: PLC0415
    from core_solver.take import read_take  # noqa: PLC0415

    document = read_multiview(options.truth)
    take = read_take(options.take)
    truth, people = document.seen_by(options.camera, take), people_of(take)
    truth.require_all(people.frames)
    row = _row(truth, people, take)
    if row.people and all(person.take_id is None for person in row.people):
        raise UserError(
            f"nobody of {options.take.name} is where camera {options.camera} of {options.truth.name} sees people: "
            "check --camera and the clip"
        )
    _show([row], as_json=options.json)
    return 0


def evaluate_mupots(options: argparse.Namespace, progress: Progress) -> int:
    """All sequences of MuPoTS-3D that have a take."""
    from core_solver.evaluation.mupots_layout import find_sequences, read_mupots  # noqa: PLC0415
    from core_solver.evaluation.take_people import people_of  # noqa: PLC0415
    from core_solver.take import read_take  # noqa: PLC0415

    rows = []
    for directory in find_sequences(_existing(options.directory, "DIR")):
        path = _take_directory(options, directory) / TAKE
        if not path.is_file():
            progress.note(f"{directory.name} has no take and is left out: {path}")
            continue
        take, sequence = read_take(path), read_mupots(directory)
        people = people_of(take)
        sequence.truth.require_all(people.frames)
        rows.append(_row(sequence.truth, people, take, sequence.official(people)))
    _show_all(rows, f"TS1/{TAKE}", options)
    return 0


def evaluate_panoptic(options: argparse.Namespace, progress: Progress) -> int:
    """All sequences of CMU Panoptic that have takes, each camera by itself."""
    from core_solver.evaluation.panoptic import find_sequences, read_panoptic  # noqa: PLC0415
    from core_solver.evaluation.take_people import people_of  # noqa: PLC0415
    from core_solver.take import read_take  # noqa: PLC0415

    rows = []
    for directory in find_sequences(_existing(options.directory, "DIR")):
        takes = _takes_of_cameras(_take_directory(options, directory), options.camera)
        if not takes:
            progress.note(f"{directory.name} has no take and is left out")
            continue
        sequence = read_panoptic(directory)
        for camera, path in takes.items():
            take = read_take(path)
            rows.append(_row(sequence.seen_by(camera, take), people_of(take), take))
    _show_all(rows, "SEQ/take_00_16.npz (or take.npz with --camera)", options)
    return 0


def _row(truth: RealTruth, people: TakePeople, take: Take, official: OfficialScores | None = None) -> RealRow:
    from core_solver.evaluation.real_scores import RealRow, measure, pair_up, person_scores  # noqa: PLC0415

    here = truth.at(people.frames)
    pairing = pair_up(here, people, max(take.meta.camera.width, take.meta.camera.height))
    return RealRow(
        truth.name, take.meta.preset, measure(here, people, pairing, official), person_scores(here, people, pairing)
    )


def _takes_of_cameras(directory: Path, camera: str | None) -> dict[str, Path]:
    takes = {path.stem.removeprefix("take_"): path for path in sorted(directory.glob("take_*.npz"))}
    if camera is not None and (directory / TAKE).is_file():
        takes[camera] = directory / TAKE
    return takes


def _take_directory(options: argparse.Namespace, sequence: Path) -> Path:
    if options.takes is None:
        return sequence
    return _existing(options.takes, "--takes") / sequence.resolve().name


def _existing(directory: Path, what: str) -> Path:
    if not directory.is_dir():
        raise UserError(f"there is no directory {directory}: check {what}")
    return directory


def _show_all(rows: list[RealRow], wanted: str, options: argparse.Namespace) -> None:
    from core_solver.evaluation.real_scores import mean_of  # noqa: PLC0415

    if not rows:
        raise UserError(f"no takes in {options.takes or options.directory}: solve the clips into {wanted} first")
    _show([*rows, mean_of(rows)], as_json=options.json)


def _show(rows: Sequence[RealRow], *, as_json: bool) -> None:
    from core_solver.evaluation.real_table import plain_table  # noqa: PLC0415

    text = json.dumps({"rows": [row.as_json() for row in rows]}, indent=1) if as_json else plain_table(rows)
    sys.stdout.write(text + "\n")
