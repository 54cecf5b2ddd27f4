"""`scene-aware-mocap evaluate people`: were the people of a clip found and kept apart?

Takes the observations that a solve has kept, so that no network runs again. Where the video shook, a solve follows
people in the picture held still: the take beside the observations knows how, and the reference is moved there too.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from core_solver.errors import UserError

if TYPE_CHECKING:
    import argparse
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

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
    from core_solver.perception.perceive import label_size  # noqa: PLC0415
    from core_solver.stabilise import steady  # noqa: PLC0415
    from core_solver.tracking import find_people, read_edits  # noqa: PLC0415
    from core_solver.tracking.identities import apply_edits  # noqa: PLC0415

    reference = read_people(options.reference)
    edits = read_edits(options.identities) if options.identities else ()
    observations = list(read_observations(options.work))
    frames = [o.frame.index for o in observations]
    looked_at = reference.within(frames)
    maps = _steadying(options.work, frames)
    if maps is not None:
        observations = steady(observations, maps, reference.image_size, label_size(*reference.image_size))
        looked_at = looked_at.moved(dict(zip(frames, maps, strict=True)))
    people = apply_edits(find_people(observations, reference.image_size).people, edits, frames)
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


def _steadying(work: Path, frames: Sequence[int]) -> NDArray[np.float64] | None:
    """(T, 3, 3) how these frames of the video lie over the first one; None where it did not shake or is not solved.

    Raises:
        UserError: the take beside the observations is damaged, or has other frames.
    """
    from core_solver.take import read_take  # noqa: PLC0415

    path = work.with_suffix(".npz")
    take = read_take(path) if path.is_file() else None
    if take is None or take.steadying is None:
        return None
    if [take.meta.first_frame + take.meta.frame_step * frame for frame in range(take.frame_count)] != list(frames):
        raise UserError(f"{path.name} has other frames than {work.name}: solve again")
    return take.steadying


def _facts(scores: PeopleScores) -> dict[str, float]:
    return {
        "people": scores.people, "precision": scores.precision, "recall": scores.recall,
        "switches": scores.switches, "fragmentations": scores.fragmentations,
    }  # fmt: skip
