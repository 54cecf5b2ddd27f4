"""`scene-aware-mocap evaluate people`: were the people of a clip found and kept apart?

Takes the observations that a solve has kept, so that no network runs again.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import argparse

    from core_solver.evaluation.people import PeopleScores


def add_parser(kinds: argparse._SubParsersAction[argparse.ArgumentParser]) -> argparse.ArgumentParser:
    """Add the kind `people` of the `evaluate` command."""
    people = kinds.add_parser("people", help="identities over a clip, against people named by hand")
    people.add_argument("work", type=Path, metavar="TAKE.work", help="what a solve has kept beside its take")
    people.add_argument("--reference", type=Path, required=True, metavar="FILE", help="who is where, by hand (JSON)")
    people.add_argument("--identities", type=Path, metavar="FILE", help="edits of who is who")
    people.add_argument("--json", action="store_true", help="for programs: keys stay the same")
    people.set_defaults(run=evaluate_people, stopped="stopped: nothing was changed")
    return people


def evaluate_people(options: argparse.Namespace) -> int:
    """Track again, compare with the reference and print.

    Raises:
        UserError: a file is missing or damaged, or an edit is impossible.
    """
    from core_solver.evaluation.people import describe_scores, people_boxes, read_people, score_people  # noqa: PLC0415
    from core_solver.perception.cache import read_observations  # noqa: PLC0415
    from core_solver.tracking import find_people, read_edits  # noqa: PLC0415
    from core_solver.tracking.identities import apply_edits  # noqa: PLC0415

    reference = read_people(options.reference)
    edits = read_edits(options.identities) if options.identities else ()
    observations = list(read_observations(options.work))
    frames = [o.frame.index for o in observations]
    people = apply_edits(find_people(observations, reference.image_size).people, edits, frames)
    looked_at = reference.within(frames)
    one_second = sum(o.frame.time < observations[0].frame.time + 1 for o in observations)
    seen = score_people(looked_at, people_boxes(people, frames))
    followed = score_people(looked_at, people_boxes(people, frames, one_second))
    if options.json:
        facts = {"seen": _facts(seen), "followed": _facts(followed), "tracks": len(people)}
        sys.stdout.write(json.dumps(facts, indent=1) + "\n")
        return 0
    lines = ["where tracks are seen", *describe_scores(seen), "with gaps of up to a second filled"]
    lines += describe_scores(followed)[:2]
    sys.stdout.write("\n".join(lines) + "\n")
    return 0


def _facts(scores: PeopleScores) -> dict[str, float]:
    return {
        "people": scores.people, "precision": scores.precision, "recall": scores.recall,
        "switches": scores.switches, "fragmentations": scores.fragmentations,
    }  # fmt: skip
