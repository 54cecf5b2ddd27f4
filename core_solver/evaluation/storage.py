"""What a benchmark keeps on disk: finished scores, so that a run can be stopped and go on; and its results."""

import functools
import hashlib
import json
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import core_solver
from core_solver.errors import UserError
from core_solver.evaluation.cases import Case
from core_solver.evaluation.scores import Details, Measures, SceneScores
from core_solver.text_files import write_text_whole

# The parts of the program that numbers depend on; what only talks to people may change in the middle of a run.
_ROOMS = ("body", "energy", "evaluation", "geometry", "optimise", "raster", "scene", "tracking")


@dataclass(frozen=True)
class ScoreCache:
    """Scores of finished solves, one small file each.

    Attributes:
        directory: where they lie.
        origin: all that the scenes depend on, in one line: suite, motions, body.
    """

    directory: Path
    origin: str

    def read(self, seed: int, scene: str, case: Case) -> SceneScores | None:
        """The scores, or None if this was not solved yet by this version with these settings."""
        path = self._path(seed, scene, case)
        return _scores_from_json(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None

    def write(self, seed: int, case: Case, scores: SceneScores) -> None:
        """Keep scores."""
        write_text_whole(self._path(seed, scores.scene, case), json.dumps(asdict(scores), allow_nan=False))

    def read_names(self, seed: int) -> tuple[str, ...] | None:
        """The names of a seed's scenes, or None before it was once run to its end."""
        path = self._file("names", seed)
        return tuple(json.loads(path.read_text(encoding="utf-8"))) if path.is_file() else None

    def write_names(self, seed: int, names: Sequence[str]) -> None:
        """Keep the names, so that finished scenes need not be generated again."""
        write_text_whole(self._file("names", seed), json.dumps(list(names)))

    def _path(self, seed: int, scene: str, case: Case) -> Path:
        return self._file("scores", seed, scene, case.preset, case.settings())

    def _file(self, *facts: object) -> Path:
        everything = repr((program_hash(), self.origin, *facts))
        return self.directory / f"{hashlib.sha256(everything.encode()).hexdigest()[:24]}.json"


@functools.cache
def program_hash() -> str:
    """A digest of the sources that numbers depend on."""
    root = Path(core_solver.__file__).parent
    digest = hashlib.sha256(core_solver.__version__.encode())
    for room in _ROOMS:
        for path in sorted((root / room).rglob("*.py")):
            digest.update(path.relative_to(root).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()


def scores_as_json(seed: int, case: Case, scores: SceneScores) -> dict[str, object]:
    """A scene's entry in the file of all scenes."""
    return {"preset": case.preset, "ablation": case.ablation.name, "seed": seed, **asdict(scores)}


def make_directory(path: Path) -> None:
    """Make the output directory and find out at once whether it can be written.

    Raises:
        UserError: it cannot.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path):
            pass
    except OSError as error:
        raise UserError(f"cannot write to {path} ({error.strerror}): choose another directory with -o") from error


def _scores_from_json(entry: dict) -> SceneScores:
    errors: Sequence[Sequence[float | None]] = entry["root_errors_mm"]
    return SceneScores(
        entry["scene"], Measures(**entry["measures"]), Details(**entry["details"]), tuple(tuple(e) for e in errors)
    )
