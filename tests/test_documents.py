"""The commands that README and docs tell users to type are commands of this program."""

import importlib.util
import re
import shlex
from pathlib import Path

import pytest

from core_solver import cli

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
PROGRAM = "scene-aware-mocap"


def blocks(text: str) -> list[str]:
    return re.findall(r"^```\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def commands(text: str, program: str) -> list[list[str]]:
    """The arguments of each call of a program in the blocks of a document."""
    lines = [line for block in blocks(text) for line in block.splitlines() if line.startswith(f"{program} ")]
    return [shlex.split(line.removeprefix(program), comments=True) for line in lines]


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_command_can_be_typed(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    for arguments in commands(text, PROGRAM):
        assert cli._parser().parse_args(arguments).command == arguments[0]
    for module, *_ in commands(text, "python -m"):
        assert importlib.util.find_spec(module) is not None, module


def test_quoted_figures_have_their_commands() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    section = text[text.index("## How well it works") : text.index("## How to judge it yourself")]
    measured = {tuple(arguments[:2]) for arguments in commands(section, PROGRAM)}
    assert measured >= {("solve", "cam01.mp4"), ("evaluate", "multiview"), ("evaluate", "people")}
    assert [module for module, *_ in commands(section, "python -m")] == ["core_solver.evaluation.perception_speed"]
