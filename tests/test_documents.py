"""The pages: links lead somewhere, and pictures are small."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
LARGEST = 200_000  # bytes of a picture
LINK = re.compile(r"\]\((?!https?://|#)([^)#]+)")


def links(page: Path) -> list[Path]:
    return [page.parent / target for target in LINK.findall(page.read_text(encoding="utf-8"))]


def test_there_are_links() -> None:
    assert len(PAGES) > 10
    assert sum(len(links(page)) for page in PAGES) > 30


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_to_files(page: Path) -> None:
    assert not [str(target) for target in links(page) if not target.exists()]


def test_pictures_are_small_and_used() -> None:
    shown = {target.resolve() for page in PAGES for target in links(page)}
    pictures = sorted((ROOT / "docs" / "images").iterdir())
    assert not {picture.name for picture in pictures if picture.stat().st_size > LARGEST}
    assert not {picture.name for picture in pictures if picture not in shown}


def literals() -> str:
    """All string literals of the product, and the fixed parts of composed ones."""
    files = [file for folder in ("blender_addon", "core_solver") for file in (ROOT / folder).rglob("*.py")]
    nodes = (node for file in files for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))))
    return "\n".join(node.value for node in nodes if isinstance(node, ast.Constant) and isinstance(node.value, str))


def test_messages_that_are_explained_are_given() -> None:
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    cells = [line.split("|")[1] for line in page.splitlines() if line.startswith("| ")]
    messages = [part for cell in cells for quoted in re.findall(r"\*([^*]+)\*", cell) for part in quoted.split(" ... ")]
    assert len(messages) > 30
    known = literals()
    assert not [message for message in messages if message not in known]
