"""The files a benchmark leaves: results.json, scenes.json, table.md and pictures."""

import json
import os
import platform
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import scipy
import torch

from core_solver import __version__
from core_solver.evaluation import plots
from core_solver.evaluation.cases import FULL
from core_solver.evaluation.runner import Results
from core_solver.evaluation.scores import Row
from core_solver.evaluation.storage import scores_as_json
from core_solver.evaluation.table import markdown_table
from core_solver.text_files import write_text_whole


@dataclass(frozen=True)
class Origin:
    """Where the numbers come from.

    Attributes:
        suite: name.
        seeds: numbers.
        motions: "built in", or the name of the folder of captured motion.
        body: id of the body model.
        jobs: solves at a time.
        noise: what the modalities were corrupted with, by name.
    """

    suite: str
    seeds: tuple[int, ...]
    motions: str
    body: str
    jobs: int
    noise: dict[str, object]


def write_report(directory: Path, results: Results, rows: Sequence[Row], origin: Origin) -> list[Path]:
    """Write everything and return the paths; pictures are left out where matplotlib is missing."""
    facts = provenance(origin)
    document = {
        "rows": [row.as_json() for row in rows],
        "provenance": facts,
        "failures": [str(failure) for failure in results.failures],
    }
    scenes = [scores_as_json(s.seed, s.case, s.scores) for s in results.scored]
    texts = {
        "results.json": _json(document),
        "scenes.json": _json({"scenes": scenes}),
        "table.md": f"{_headline(facts)}\n\n{markdown_table(rows)}",
    }
    for name, text in texts.items():
        write_text_whole(directory / name, text)
    pictures = _draw(directory, results, rows) if rows and plots.can_draw() else []
    return [*(directory / name for name in texts), *pictures]


def provenance(origin: Origin) -> dict[str, object]:
    """Date, machine and versions beside the origin."""
    return {
        **asdict(origin),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": f"{platform.system()} {platform.machine()}, {_processor()}, {os.cpu_count()} cores",
        "versions": {
            "scene-aware-mocap": __version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "torch": str(torch.__version__),
        },
    }


def _headline(facts: dict[str, object]) -> str:
    versions = facts["versions"]
    listed = ", ".join(f"{name} {number}" for name, number in versions.items()) if isinstance(versions, dict) else ""
    return f"Suite {facts['suite']}, seeds {facts['seeds']}, {facts['date']}, {facts['machine']}, {listed}."


def _processor() -> str:
    """The processor's name; Linux keeps it in a file, elsewhere Python knows."""
    information = Path("/proc/cpuinfo")
    if information.is_file():
        for line in information.read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or "unknown processor"


def _draw(directory: Path, results: Results, rows: Sequence[Row]) -> list[Path]:
    bars, errors = directory / "measures.png", directory / "root_errors.png"
    plots.draw_bars(bars, rows)
    whole = [s for s in results.scored if s.case.ablation is FULL]
    if not whole:
        return [bars]
    # The scene with most people shows most.
    shown = max(whole, key=lambda s: len(s.scores.root_errors_mm))
    same = [s for s in whole if (s.seed, s.scores.scene) == (shown.seed, shown.scores.scene)]
    plots.draw_errors(errors, same, f"scene {shown.scores.scene}, seed {shown.seed}")
    return [bars, errors]


def _json(document: object) -> str:
    return json.dumps(document, indent=1, allow_nan=False) + "\n"
