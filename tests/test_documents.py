"""The pages: links lead somewhere, and pictures are small."""

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
