"""Fixtures that every room shares, and a clean end for runs in which Blender was loaded."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from core_solver.perception.store import ModelStore

REPO_ROOT = Path(__file__).resolve().parents[1]
EXIT_CODE = pytest.StashKey[int]()


@pytest.fixture(scope="session")
def repo_root() -> Path:
    """The directory that holds build.py."""
    return REPO_ROOT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The development data beside the clone."""
    folder = REPO_ROOT.parent / "shared" / "data"
    if not folder.is_dir():
        pytest.skip("no development data beside the clone")
    return folder


@pytest.fixture(scope="session")
def models() -> ModelStore:
    """A store that holds the default models: the user's own, filled on first use."""
    from core_solver.errors import ModelError
    from core_solver.perception.store import ModelStore

    store = ModelStore()
    try:
        for entry in store.entries():
            if entry.default:
                store.fetch(entry.name)
    except ModelError as error:
        pytest.skip(f"the default models cannot be had: {error}")
    return store


def pytest_sessionfinish(session: pytest.Session, exitstatus: int) -> None:
    """Keep the exit code for `pytest_unconfigure`, which is not told."""
    session.config.stash[EXIT_CODE] = int(exitstatus)


@pytest.hookimpl(trylast=True)
def pytest_unconfigure(config: pytest.Config) -> None:
    """Leave at once after the summary: some Blenders crash or hang while Python takes them apart."""
    if "bpy" in sys.modules and EXIT_CODE in config.stash:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(config.stash[EXIT_CODE])
