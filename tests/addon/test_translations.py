"""The catalogues: complete, with nothing stale, and with the same places for values as the English."""

import string
from pathlib import Path
from typing import Any

import pytest

from .ui_strings import class_strings, composed_strings, source_strings

LANGUAGES = ("de",)


@pytest.fixture(scope="module")
def shown(bpy_installed: Any, addon: Any, repo_root: Path) -> set[str]:
    in_words = addon("retarget.validation").in_words
    import bl_ext.user_default.scene_aware_mocap as package  # pyright: ignore[reportMissingImports]

    parts = {in_words(role).title() for role in addon("retarget.roles").ROLES}
    return class_strings(bpy_installed, package._CLASSES) | source_strings(repo_root / "blender_addon") | parts


def test_there_are_strings(shown: set[str]) -> None:
    assert {"Solve Video", "Import Take", "Footage", "Load Sample Rig", "Solver {} found", "Fast"} <= shown
    assert len(shown) > 100


@pytest.mark.parametrize("language", LANGUAGES)
def test_the_catalogue_is_complete_and_has_nothing_stale(language: str, addon: Any, shown: set[str]) -> None:
    catalogue = addon("translations").catalogues()[language]
    assert not sorted(shown - set(catalogue)), "not translated"
    assert not sorted(set(catalogue) - shown), "no longer shown"
    assert all(own.strip() for own in catalogue.values())


@pytest.mark.parametrize("language", LANGUAGES)
def test_values_keep_their_places(language: str, addon: Any) -> None:
    def places(text: str) -> list[tuple[str | None, str | None]]:
        return [(name, spec) for _, name, spec, _ in string.Formatter().parse(text) if name is not None]

    for english, own in addon("translations").catalogues()[language].items():
        if "{" in english:
            assert places(english) == places(own), english
        assert english.endswith(".") == own.endswith("."), english


def test_whatever_is_shown_can_be_translated(repo_root: Path) -> None:
    assert not composed_strings(repo_root / "blender_addon")
