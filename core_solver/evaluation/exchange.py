"""What passes between a benchmark and the process that solves for it: plain numpy archives, nothing pickled."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from core_solver.body import BodyModel
from core_solver.camera import Camera
from core_solver.geometry import GroundFrame
from core_solver.optimise.solution import Solution
from core_solver.tracking.tracks import Modalities, Track

_BODY_ARRAYS = (
    "template", "shape_directions", "joint_regressor", "weights", "faces", "keypoint_regressor", "neutral_betas",
    "proxy",
)  # fmt: skip
_TRACK_ARRAYS = ("valid", "keypoints", "confidence", "landmarks", "regressed")  # the last may be missing
_GROUND = "ground."
_NUMBERS = ("seconds", "cpu_seconds", "peak_mb")

Arrays = Mapping[str, NDArray]


@dataclass(frozen=True)
class Problem:
    """What a solver is given.

    Attributes:
        modalities: seen.
        camera: intrinsics.
        body: body model.
    """

    modalities: Modalities
    camera: Camera
    body: BodyModel


@dataclass(frozen=True)
class Outcome:
    """What a solver gave, and what it took.

    Attributes:
        solution: all people.
        seconds: of the solve alone, by the clock.
        cpu_seconds: of all its threads; on a busy machine the fairer number.
        peak_mb: highest resident memory of its process, 10^6 bytes.
    """

    solution: Solution
    seconds: float
    cpu_seconds: float
    peak_mb: float


def write_problem(path: Path, problem: Problem) -> None:
    """Write a problem as an .npz."""
    modalities, body = problem.modalities, problem.body
    facts = {
        "camera": {name: getattr(problem.camera, name) for name in Camera.__dataclass_fields__},
        "image_size": modalities.image_size,
        "tracks": [[track.id, track.score] for track in modalities.tracks],
        "body": [body.id, body.licence],
    }
    arrays = {f"body.{name}": getattr(body, name) for name in (*_BODY_ARRAYS, "pose_directions")}
    arrays |= {name: getattr(modalities, name) for name in ("times", "frames", "labels", "disparity")}
    for index, track in enumerate(modalities.tracks):
        arrays |= {f"track{index}.{name}": getattr(track, name) for name in _TRACK_ARRAYS}
    present = {name: array for name, array in arrays.items() if array is not None}
    np.savez(path, facts=np.frombuffer(json.dumps(facts).encode(), np.uint8), **present)


def read_problem(path: Path) -> Problem:
    """Read what `write_problem` wrote."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    facts = json.loads(arrays["facts"].tobytes())
    tracks = (
        Track(id=number, score=score, **{name: arrays.get(f"track{index}.{name}") for name in _TRACK_ARRAYS})  # type: ignore[arg-type]
        for index, (number, score) in enumerate(facts["tracks"])
    )
    width, height = facts["image_size"]
    modalities = Modalities(
        arrays["times"], arrays["frames"], (width, height), tuple(tracks), arrays["labels"], arrays.get("disparity")
    )
    camera = Camera(**{**facts["camera"], "distortion": tuple(facts["camera"]["distortion"])})
    identity, licence = facts["body"]
    body = BodyModel(
        id=identity,
        licence=licence,
        pose_directions=arrays.get("body.pose_directions"),
        **{name: arrays[f"body.{name}"] for name in _BODY_ARRAYS},
    )
    return Problem(modalities, camera, body)


def write_outcome(path: Path, outcome: Outcome) -> None:
    """Write an outcome as an .npz."""
    solution = outcome.solution
    arrays = {field.name: getattr(solution, field.name) for field in fields(Solution) if field.name != "ground"}
    ground = {_GROUND + field.name: getattr(solution.ground, field.name) for field in fields(GroundFrame)}
    numbers = {name: getattr(outcome, name) for name in _NUMBERS}
    np.savez(path, **numbers, **arrays, **ground)


def read_outcome(path: Path) -> Outcome:
    """Read what `write_outcome` wrote."""
    with np.load(path, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    ground = GroundFrame(arrays[_GROUND + "gravity"], arrays[_GROUND + "normal"], float(arrays[_GROUND + "offset"]))
    known = {field.name: arrays[field.name] for field in fields(Solution) if field.name != "ground"}
    return Outcome(Solution(ground=ground, **known), **{name: float(arrays[name]) for name in _NUMBERS})
