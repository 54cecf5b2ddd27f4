"""Rows of real sequences for people: plain text in fixed columns."""

from collections.abc import Sequence

from core_solver.evaluation.real_scores import PersonScores, RealRow
from core_solver.evaluation.table import PLACE_AND_POSE, Column

_DISTANCE = Column("pair_distance_mm", "distance", "mm", 0)
_BLOCKS = (
    (*PLACE_AND_POSE, _DISTANCE),
    (
        Column("pck3d_official_all", "3DPCK all", "%", 1, 100, is_better_high=True),
        Column("pck3d_official_matched", "3DPCK matched", "%", 1, 100, is_better_high=True),
        Column("w_mpjpe_mm", "W-MPJPE", "mm", 0),
        Column("w_mpjpe_scaled_mm", "W scaled", "mm", 0),
        Column("wa_mpjpe_mm", "WA-MPJPE", "mm", 0),
        Column("wa_mpjpe_scaled_mm", "WA scaled", "mm", 0),
        Column("group_w_scaled_mm", "group-W scaled", "mm", 0),
        Column("jitter_paper_mm", "jitter", "mm", 2),
        Column("jitter_wham", "jitter WHAM", "10 m/s^3", 1),
        Column("true_jitter_wham", "truth's", "10 m/s^3", 1),
        Column("found_share", "found", "%", 1, 100, is_better_high=True),
    ),
)


def plain_table(rows: Sequence[RealRow]) -> str:
    """Place and pose; other variants and motion, without columns that nothing fills; every person."""
    blocks = [_block(rows, columns) for columns in _BLOCKS]
    return "\n\n".join([*blocks, _people(rows)])


def _block(rows: Sequence[RealRow], columns: Sequence[Column]) -> str:
    filled = [column for column in columns if any(getattr(row.measures, column.measure) is not None for row in rows)]
    table = [["", *(column.title for column in filled)], ["", *(column.unit for column in filled)]]
    table += [[row.sequence, *(_text(column, row) for column in filled)] for row in rows]
    return _aligned(table)


def _people(rows: Sequence[RealRow]) -> str:
    table = [["", "in the take", "height m", "true height m", "MRPE mm", "MPJPE mm", "jitter WHAM", "truth's"]]
    table += [
        [f"{row.sequence}: {person.name}", _id(person), *(_number(value, digits) for value, digits in _facts(person))]
        for row in rows
        for person in row.people
    ]
    return _aligned(table)


def _facts(person: PersonScores) -> tuple[tuple[float | None, int], ...]:
    return (
        (person.height_m, 3), (person.true_height_m, 3), (person.mrpe_mm, 0), (person.mpjpe_mm, 1),
        (person.jitter_wham, 1), (person.true_jitter_wham, 1),
    )  # fmt: skip


def _id(person: PersonScores) -> str:
    return "nobody" if person.take_id is None else f"Person {person.take_id}"


def _text(column: Column, row: RealRow) -> str:
    value = getattr(row.measures, column.measure)
    return _number(None if value is None else value * column.factor, column.digits)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _aligned(table: list[list[str]]) -> str:
    """The first column to the left, numbers to the right."""
    widths = [max(len(cell) for cell in cells) for cells in zip(*table, strict=True)]
    return "\n".join(
        "  ".join([line[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]).rstrip()
        for line in table
    )
