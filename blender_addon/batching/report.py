# SPDX-License-Identifier: GPL-3.0-or-later
"""What was done with every take, as JSON. Standard library only."""

import json
import math
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..export.verification import Check
from ..retarget.measures import Measures


@dataclass(frozen=True)
class PersonReport:
    """Somebody who was brought in: as in the take, and the character that moves instead ("" for none)."""

    id: int
    name: str
    height_m: float
    character: str


@dataclass(frozen=True)
class TakeReport:
    """One take.

    Attributes:
        take: its file.
        error: why nothing was written; empty when files were.
        people: who was brought in.
        frames: number of frames in the scene.
        files: what was written.
        verification: what was found on reading the files back.
        measures_before: of the people, where they were retargeted.
        measures_after: of the characters.
        warnings: plain sentences.
        seconds: that it took.
    """

    take: Path
    error: str = ""
    people: tuple[PersonReport, ...] = ()
    frames: int = 0
    files: tuple[Path, ...] = ()
    verification: tuple[Check, ...] = ()
    measures_before: Measures | None = None
    measures_after: Measures | None = None
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def passed(self) -> bool:
        """Whether all files are there and hold what they should."""
        return not self.error and all(check.passed for check in self.verification)


def write_report(path: Path, takes: Sequence[TakeReport]) -> None:
    """Write the report, whole or not at all.

    Raises:
        OSError: the disk refuses it.
    """
    document = {"passed": all(take.passed for take in takes), "takes": [_take(take) for take in takes]}
    path.parent.mkdir(parents=True, exist_ok=True)
    # In a folder of its own the part gets the permissions of any new file, as a single temporary file would not.
    with tempfile.TemporaryDirectory(prefix=".report-", dir=path.parent) as parts:
        part = Path(parts) / path.name
        part.write_text(json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False), encoding="utf-8")
        part.replace(path)


def _take(report: TakeReport) -> dict[str, Any]:
    return {
        "take": str(report.take),
        "passed": report.passed,
        "error": report.error,
        "people": [asdict(person) for person in report.people],
        "frames": report.frames,
        "files": [str(path) for path in report.files],
        "verification": [_numbers({**asdict(check), "passed": check.passed}) for check in report.verification],
        "measures": {
            name: _numbers(asdict(measures)) if measures else None
            for name, measures in (("before", report.measures_before), ("after", report.measures_after))
        },
        "warnings": list(report.warnings),
        "seconds": round(report.seconds, 2),
    }


def _numbers(values: dict[str, Any]) -> dict[str, Any]:
    """JSON knows no infinity: what could not be measured is null."""
    return {key: None if isinstance(v, float) and not math.isfinite(v) else v for key, v in values.items()}
