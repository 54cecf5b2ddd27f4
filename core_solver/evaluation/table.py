"""Rows for people: plain text in fixed columns, and Markdown."""

from collections.abc import Sequence
from dataclasses import dataclass

from core_solver.evaluation.cases import label
from core_solver.evaluation.scores import Row


@dataclass(frozen=True)
class Column:
    """How a measure is shown.

    Attributes:
        measure: its name.
        title: short.
        unit: after the title.
        digits: after the point.
        factor: from the measure's unit to the one shown.
        is_better_high: whether more is better.
    """

    measure: str
    title: str
    unit: str
    digits: int
    factor: float = 1.0
    is_better_high: bool = False

    @property
    def heading(self) -> str:
        """Title and unit."""
        return f"{self.title} {self.unit}".strip()

    def text(self, row: Row) -> str:
        """The row's number, or a dash."""
        value = getattr(row.measures, self.measure)
        return "-" if value is None else f"{value * self.factor:.{self.digits}f}"


PLACE_AND_POSE = (
    Column("mrpe_mm", "MRPE", "mm", 0),
    Column("ap25_matched", "AP25 matched", "%", 1, 100, is_better_high=True),
    Column("ap25", "AP25", "%", 1, 100, is_better_high=True),
    Column("pck3d", "3DPCK", "%", 1, 100, is_better_high=True),
    Column("mpjpe_mm", "MPJPE", "mm", 1),
    Column("pa_mpjpe_mm", "PA-MPJPE", "mm", 1),
    Column("group_w_mm", "group-W", "mm", 0),
    Column("height_error", "height", "%", 1, 100),
    Column("depth_order", "order", "%", 1, 100, is_better_high=True),
)
MOTION_AND_COST = (
    Column("jitter_paper_mm", "jitter", "mm", 2),
    Column("jitter_wham", "jitter WHAM", "10 m/s^3", 1),
    Column("skate_mm", "skate", "mm", 2),
    Column("penetration_mm", "penetration", "mm", 1),
    Column("contact_f1", "contact", "F1", 3, is_better_high=True),
    Column("seconds", "time", "s", 1),
    Column("peak_mb", "memory", "MB", 0),
)
COLUMNS = (*PLACE_AND_POSE, *MOTION_AND_COST)


def plain_table(rows: Sequence[Row]) -> str:
    """Two blocks of fixed columns: place and pose, then motion and cost."""
    blocks = [_block(rows, columns) for columns in (PLACE_AND_POSE, MOTION_AND_COST)]
    return "\n\n".join("\n".join(lines) for lines in blocks)


def markdown_table(rows: Sequence[Row]) -> str:
    """The same as Markdown."""
    blocks = []
    for columns in (PLACE_AND_POSE, MOTION_AND_COST):
        lines = [["", *(column.heading for column in columns)], ["---", *("---:" for _ in columns)]]
        lines += [[label(row.preset, row.ablation), *(column.text(row) for column in columns)] for row in rows]
        blocks.append("\n".join("| " + " | ".join(cells) + " |" for cells in lines))
    return "\n\n".join(blocks) + "\n"


def _block(rows: Sequence[Row], columns: Sequence[Column]) -> list[str]:
    table = [["", *(column.title for column in columns)], ["", *(column.unit for column in columns)]]
    table += [[label(row.preset, row.ablation), *(column.text(row) for column in columns)] for row in rows]
    widths = [max(len(cell) for cell in cells) for cells in zip(*table, strict=True)]
    return [
        "  ".join([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]).rstrip()
        for line in table
    ]
