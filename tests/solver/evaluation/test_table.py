from dataclasses import fields, replace

from core_solver.evaluation.cases import label
from core_solver.evaluation.scores import MEASURES, Measures, Row
from core_solver.evaluation.table import COLUMNS, markdown_table, plain_table

NUMBERS = Measures(**{name: 0.5 + i for i, name in enumerate(MEASURES)})
ROWS = (
    Row("baseline", "none", (0,), replace(NUMBERS, mrpe_mm=1234.56, depth_order=None)),
    Row("fast", "contact and slip", (0,), replace(NUMBERS, mrpe_mm=7.0, ap25=0.875)),
    Row("paper", "E_I only", (0,), NUMBERS),
)


def test_every_measure_has_one_column():
    assert sorted(column.measure for column in COLUMNS) == sorted(field.name for field in fields(Measures))


def test_plain_columns_line_up_and_numbers_are_right():
    place, motion = plain_table(ROWS).split("\n\n")
    lines = place.splitlines()
    assert lines[2].split()[:2] == ["baseline", "1235"]
    assert lines[2].split()[-1] == "-"
    assert lines[3].startswith("fast, no contact and slip ")
    assert "87.5" in lines[3]
    assert lines[4].startswith("paper, E_I only ")
    ends = [line.index(cell) + len(cell) for line, cell in zip(lines[2:4], (" 1235", " 7"), strict=True)]
    assert ends[0] == ends[1]
    assert len(motion.splitlines()) == 2 + len(ROWS)


def test_markdown_has_a_row_for_each_case():
    lines = markdown_table(ROWS).splitlines()
    assert lines[0].startswith("|  | MRPE mm |")
    assert lines[2].startswith("| baseline | 1235 |")
    assert len({line.count("|") for line in lines[:5]}) == 1


def test_labels():
    assert [label(row.preset, row.ablation) for row in ROWS] == [
        "baseline",
        "fast, no contact and slip",
        "paper, E_I only",
    ]
