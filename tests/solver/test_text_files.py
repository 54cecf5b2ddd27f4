"""A text file is there whole, or the older one is."""

from pathlib import Path

import pytest

from core_solver.errors import UserError
from core_solver.text_files import write_text_whole


def test_folders_are_made_and_the_text_is_utf8_with_plain_line_ends(tmp_path: Path) -> None:
    write_text_whole(tmp_path / "deep" / "new" / "a.txt", "Zoë\nund \udc80\n")
    assert (tmp_path / "deep" / "new" / "a.txt").read_bytes() == "Zoë\nund ?\n".encode()
    assert [p.name for p in (tmp_path / "deep" / "new").iterdir()] == ["a.txt"]


def test_a_full_disk_leaves_the_older_file_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "results.json"
    write_text_whole(path, "old")
    monkeypatch.setattr(Path, "replace", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(UserError, match=r"No space left.*free some space"):
        write_text_whole(path, "new")
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["results.json"]


def test_a_place_that_is_none_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(UserError, match=r"cannot write .*choose another place with -o"):
        write_text_whole(tmp_path / "file" / "a.txt", "text")
