"""Pictures of a benchmark; matplotlib is an extra and is imported only here."""

import math
from collections.abc import Sequence
from pathlib import Path

from core_solver.evaluation.cases import label
from core_solver.evaluation.runner import Scored
from core_solver.evaluation.scores import Row
from core_solver.evaluation.table import COLUMNS

MISSING = "no pictures were drawn: install them with pip install 'scene-aware-mocap[benchmarks]'"

_PANELS_ACROSS = 4
_DPI = 110


def can_draw() -> bool:
    """Whether matplotlib is installed."""
    try:
        import matplotlib as mpl  # noqa: PLC0415 - an extra
    except ImportError:
        return False
    mpl.use("Agg")
    return True


def draw_bars(path: Path, rows: Sequence[Row]) -> None:
    """One panel for each measure, one bar for each row."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    down = math.ceil(len(COLUMNS) / _PANELS_ACROSS)
    height = 1.0 + 0.22 * len(rows)
    figure, axes = plt.subplots(down, _PANELS_ACROSS, figsize=(15, height * down), sharey=True, squeeze=False)
    places = range(len(rows))
    for axis in axes.flat[len(COLUMNS) :]:
        axis.remove()
    for axis, column in zip(axes.flat, COLUMNS, strict=False):
        values = [getattr(row.measures, column.measure) for row in rows]
        bars = axis.barh(places, [(v or 0.0) * column.factor for v in values], color=[f"C{i % 10}" for i in places])
        axis.bar_label(bars, [column.text(row) for row in rows], padding=2, fontsize=7)
        axis.set_title(f"{column.heading}, {'more' if column.is_better_high else 'less'} is better", fontsize=9)
        axis.set_yticks(places, [label(row.preset, row.ablation) for row in rows], fontsize=8)
        axis.invert_yaxis() if axis is axes[0, 0] else None
        axis.margins(x=0.2)
        axis.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)


def draw_errors(path: Path, scored: Sequence[Scored], title: str) -> None:
    """Each person's root error over the frames of one scene, a panel for each person, a line for each case."""
    from matplotlib import pyplot as plt  # noqa: PLC0415 - an extra

    people = max(len(s.scores.root_errors_mm) for s in scored)
    figure, axes = plt.subplots(people, 1, figsize=(10, 1 + 2 * people), sharex=True, squeeze=False)
    for person, axis in enumerate(axes[:, 0]):
        for each in scored:
            errors = [math.nan if e is None else e for e in each.scores.root_errors_mm[person]]
            axis.plot(errors, linewidth=1.2, label=each.case.label)
        axis.set_ylabel(f"person {person + 1}\nroot error, mm", fontsize=9)
        axis.set_ylim(bottom=0)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0, 0].set_title(title, fontsize=10)
    axes[0, 0].legend(fontsize=7, ncols=3)
    axes[-1, 0].set_xlabel("frame")
    figure.tight_layout()
    figure.savefig(path, dpi=_DPI)
    plt.close(figure)
