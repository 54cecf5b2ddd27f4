"""The model store: nothing unverified is used, nothing half-fetched stays, and every error says what to do.

Packages are served by a small web server on this computer, so that these tests need no network.
"""

from __future__ import annotations

import errno
import functools
import hashlib
import http.server
import io
import json
import os
import re
import shutil
import tarfile
import threading
import time
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from core_solver.errors import ModelError
from core_solver.perception import packages
from core_solver.perception.packages import Member, Package
from core_solver.perception.store import MODELS_DIR_VARIABLE, ModelEntry, ModelStore, catalogue, default_models_dir

if TYPE_CHECKING:
    from collections.abc import Iterator

CONTENT = b"weights" * 5000


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def quiet(_done: int, _total: int) -> None:
    """Progress that nobody watches."""


class Handler(http.server.SimpleHTTPRequestHandler):
    """Serves a directory; files called cut-* promise more than they send."""

    def log_message(self, *_arguments: object) -> None:
        pass

    def do_GET(self) -> None:
        if "/cut-" not in self.path:
            super().do_GET()
            return
        self.send_response(200)
        self.send_header("Content-Length", str(len(CONTENT)))
        self.end_headers()
        self.wfile.write(CONTENT[:1000])


@pytest.fixture
def served(tmp_path: Path) -> Iterator[tuple[Path, str]]:
    """A directory and the address at which it is served."""
    folder = tmp_path / "served"
    folder.mkdir()
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Handler, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield folder, f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


@pytest.fixture
def single(served: tuple[Path, str]) -> ModelEntry:
    """An entry that is one file at an address."""
    folder, address = served
    (folder / "net.onnx").write_bytes(CONTENT)
    package = Package("https", len(CONTENT), sha256(CONTENT), address=f"{address}/net.onnx")
    return ModelEntry("net", "disparity", False, "MIT", "", "", "", package)


def wheel_entry(folder: Path, name: str = "sam_test_package") -> ModelEntry:
    """A wheel in `folder` that pip can find, and the entry for it."""
    data = io.BytesIO()
    metadata = f"{name}-1.0.dist-info"
    with zipfile.ZipFile(data, "w") as wheel:
        wheel.writestr(f"{name}/net.tflite", CONTENT)
        wheel.writestr(f"{name}/other.bin", b"not wanted")
        wheel.writestr(f"{metadata}/METADATA", f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        wheel.writestr(f"{metadata}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: false\nTag: cp311-cp311-win_amd64\n")
        wheel.writestr(f"{metadata}/RECORD", "")
    (folder / f"{name}-1.0-cp311-cp311-win_amd64.whl").write_bytes(data.getvalue())
    package = Package("wheel", len(data.getvalue()), sha256(data.getvalue()), name, "1.0", platform="win_amd64")
    members = (Member(f"{name}/net.tflite", sha256(CONTENT)),)
    return ModelEntry("from-wheel", "landmarks", True, "MIT", "", "", "", package, members)


def store_with(tmp_path: Path, *entries: ModelEntry, offline: bool = False) -> ModelStore:
    return ModelStore(tmp_path / "models", offline=offline, known=entries)


def left_behind(store: ModelStore) -> list[Path]:
    return sorted(store.models_dir.iterdir()) if store.models_dir.exists() else []


def test_every_entry_is_pinned_and_licensed() -> None:
    tasks, entries = catalogue()
    assert {"movenet-multipose", "blazepose-full", "open-body", "midas-v2.1-small", "lab-two-people"} <= {
        entry.name for entry in entries
    }
    for entry in entries:
        assert re.fullmatch(r"[0-9a-f]{64}", entry.package.sha256), entry.name
        assert all(re.fullmatch(r"[0-9a-f]{64}", member.sha256) for member in entry.members if not member.is_folder)
        assert entry.licence, entry.name
        assert entry.package.size > 0, entry.name
        assert entry.home.startswith("https://"), entry.name
        assert Path(entry.main_file).suffix in next(task.suffixes for task in tasks if task.name == entry.task)


def test_nothing_over_plain_https_is_fetched_by_default() -> None:
    assert all(entry.package.kind in ("wheel", "npm") for entry in catalogue()[1] if entry.default)


def test_fetches_once_then_works_offline(tmp_path: Path, single: ModelEntry) -> None:
    seen: list[tuple[int, int]] = []
    path = store_with(tmp_path, single).fetch("net", lambda done, total: seen.append((done, total)))
    assert path.read_bytes() == CONTENT
    assert seen[-1] == (len(CONTENT), len(CONTENT))
    offline = store_with(tmp_path, single, offline=True)
    assert offline.require("net") == offline.path("net") == path
    assert left_behind(offline) == [tmp_path / "models" / "net"]


def test_offline_names_the_command(tmp_path: Path, single: ModelEntry) -> None:
    store = store_with(tmp_path, single, offline=True)
    with pytest.raises(ModelError, match="scene-aware-mocap models fetch net"):
        store.require("net")
    assert left_behind(store) == []


def test_wrong_checksum_is_refused(tmp_path: Path, single: ModelEntry) -> None:
    changed = replace(single, package=replace(single.package, sha256="0" * 64))
    store = store_with(tmp_path, changed)
    with pytest.raises(ModelError, match="wrong checksum"):
        store.fetch("net", quiet)
    assert left_behind(store) == []


def test_cut_off_download_leaves_nothing(tmp_path: Path, served: tuple[Path, str], single: ModelEntry) -> None:
    cut = replace(single, package=replace(single.package, address=f"{served[1]}/cut-net.onnx"))
    store = store_with(tmp_path, cut)
    with pytest.raises(ModelError, match=r"cut off after 1000 of 35000 bytes: try again"):
        store.fetch("net", quiet)
    assert left_behind(store) == []


def test_interrupted_download_leaves_nothing(tmp_path: Path, single: ModelEntry) -> None:
    def interrupt(_done: int, _total: int) -> None:
        raise KeyboardInterrupt

    store = store_with(tmp_path, single)
    with pytest.raises(KeyboardInterrupt):
        store.fetch("net", interrupt)
    assert left_behind(store) == []


def test_no_network_says_so(tmp_path: Path, single: ModelEntry) -> None:
    nowhere = replace(single, package=replace(single.package, address="https://127.0.0.1:9/net.onnx"))
    with pytest.raises(ModelError, match="check the network"):
        store_with(tmp_path, nowhere).fetch("net", quiet)


def test_full_disk_says_how_much_room(tmp_path: Path, single: ModelEntry, monkeypatch: pytest.MonkeyPatch) -> None:
    def no_room(*_arguments: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(packages, "save_address", no_room)
    store = store_with(tmp_path, single)
    with pytest.raises(ModelError, match=r"the disk is full: make room for \d+ MB"):
        store.fetch("net", quiet)
    assert left_behind(store) == []


def test_too_little_room_is_noticed_before_fetching(tmp_path: Path, single: ModelEntry) -> None:
    huge = replace(single, package=replace(single.package, size=1 << 60))
    with pytest.raises(ModelError, match="the disk is full"):
        store_with(tmp_path, huge).fetch("net", quiet)


def test_damaged_file_is_fetched_again(tmp_path: Path, single: ModelEntry) -> None:
    store = store_with(tmp_path, single)
    path = store.fetch("net", quiet)
    path.write_bytes(b"damaged")
    assert store.path("net") is None
    assert store.fetch("net", quiet).read_bytes() == CONTENT


def test_new_recipe_replaces_the_old_result(tmp_path: Path, single: ModelEntry) -> None:
    store_with(tmp_path, single).fetch("net", quiet)
    assert store_with(tmp_path, replace(single, converter_version=2)).path("net") is None


def test_leftovers_of_a_killed_process_are_swept(tmp_path: Path, single: ModelEntry) -> None:
    store = store_with(tmp_path, single)
    old, recent = store.models_dir / ".partial-net-old", store.models_dir / ".partial-net-recent"
    old.mkdir(parents=True)
    recent.mkdir()
    three_days_ago = time.time() - 3 * 24 * 3600
    os.utime(old, (three_days_ago, three_days_ago))
    store.fetch("net", quiet)
    assert not old.exists()
    assert recent.exists(), "another process may still be writing there"


def test_wheel_for_another_system_comes_through_pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = wheel_entry(tmp_path)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    store = store_with(tmp_path, entry)
    path = store.fetch("from-wheel", quiet)
    assert path.read_bytes() == CONTENT
    assert sorted(file.name for file in path.parent.iterdir()) == ["net.tflite", "receipt.json"]
    assert left_behind(store) == [path.parent]


def test_unknown_wheel_is_reported_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry = wheel_entry(tmp_path)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.delenv("PIP_FIND_LINKS", raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    store = store_with(tmp_path, entry)
    with pytest.raises(ModelError, match=r"could not download sam_test_package 1\.0: check the network") as caught:
        store.fetch("from-wheel", quiet)
    assert "\n" not in str(caught.value)
    assert left_behind(store) == []


@pytest.mark.parametrize(
    ("said", "reason"),
    [
        (
            (
                "WARNING: Retrying (Retry(total=0)) after connection broken by 'NewConnectionError('<pip.Connection "
                "object at 0x7f01>: Failed to establish a new connection: [Errno 111] Connection refused')': /anny/"
            ),
            "(Failed to establish a new connection: [Errno 111] Connection refused)",
        ),
        (
            (
                "WARNING: Retrying (Retry(total=0)) after connection broken by 'ProtocolError('Connection aborted.', "
                "RemoteDisconnected('Remote end closed connection without response'))': /anny/"
            ),
            "(Connection aborted., Remote end closed connection without response)",
        ),
        ("npm error code ECONNREFUSED\nnpm error syscall connect", "(npm error code ECONNREFUSED)"),
    ],
)
def test_reasons_are_words_and_no_python(said: str, reason: str) -> None:
    assert packages.failure(Package("wheel", 1, "", "anny", "0.6.2"), said).endswith(reason)


def test_npm_package_comes_over_https_without_npm(
    tmp_path: Path, served: tuple[Path, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, address = served
    tarball = io.BytesIO()
    with tarfile.open(fileobj=tarball, mode="w:gz") as archive:
        entry = tarfile.TarInfo("package/models/net.onnx")
        entry.size = len(CONTENT)
        archive.addfile(entry, io.BytesIO(CONTENT))
    (folder / "net.tgz").write_bytes(tarball.getvalue())
    version = folder / "@scope%2fnet" / "1.0.0"
    for candidate in (version, folder / "@scope" / "net" / "1.0.0"):  # servers read the name either way
        candidate.parent.mkdir(parents=True, exist_ok=True)
        candidate.write_text(json.dumps({"dist": {"tarball": f"{address}/net.tgz"}}))
    monkeypatch.setattr(shutil, "which", lambda _name: None)
    monkeypatch.setenv("npm_config_registry", address)
    monkeypatch.setenv("NPM_CONFIG_USERCONFIG", str(tmp_path / "no-npmrc"))
    package = Package("npm", len(tarball.getvalue()), sha256(tarball.getvalue()), "@scope/net", "1.0.0")
    members = (Member("models/net.onnx", sha256(CONTENT)),)
    store = store_with(tmp_path, ModelEntry("net", "joints", True, "MIT", "", "", "", package, members))
    assert store.fetch("net", quiet).read_bytes() == CONTENT


def test_npm_registry_follows_npms_rules(tmp_path: Path) -> None:
    settings = tmp_path / ".npmrc"
    settings.write_text("# mine\nregistry = https://mirror.example/npm/\n@scope:registry=https://scoped.example/\n")
    user = {"NPM_CONFIG_USERCONFIG": str(settings)}
    assert packages.npm_registry("plain", user) == "https://mirror.example/npm/"
    assert packages.npm_registry("@scope/net", user) == "https://scoped.example/"
    assert (
        packages.npm_registry("plain", {**user, "npm_config_registry": "https://env.example/"})
        == "https://env.example/"
    )
    assert packages.npm_registry("plain", {"NPM_CONFIG_USERCONFIG": str(tmp_path / "none")}).startswith("https://")


def test_member_with_wrong_checksum_is_refused(tmp_path: Path) -> None:
    archive = tmp_path / "a.whl"
    with zipfile.ZipFile(archive, "w") as wheel:
        wheel.writestr("net.tflite", CONTENT)
    package = Package("wheel", 1, "", "a", "1")
    with pytest.raises(ModelError, match=r"net\.tflite of a 1 has the wrong checksum"):
        packages.unpack(package, archive, [Member("net.tflite", "0" * 64)], tmp_path / "out")


def test_folder_member_cannot_climb_out(tmp_path: Path) -> None:
    archive = tmp_path / "a.whl"
    with zipfile.ZipFile(archive, "w") as wheel:
        wheel.writestr("data/../../evil.txt", b"x")
    with pytest.raises(ModelError, match="outside its folder"):
        packages.unpack(Package("wheel", 1, "", "a", "1"), archive, [Member("data/")], tmp_path / "out" / "unpacked")
    assert not list(tmp_path.rglob("evil.txt"))


def test_folder_member_keeps_its_tree(tmp_path: Path) -> None:
    archive = tmp_path / "a.whl"
    with zipfile.ZipFile(archive, "w") as wheel:
        wheel.writestr("body/data/deep/file.txt", b"x")
        wheel.writestr("body/code.py", b"never")
    packages.unpack(Package("wheel", 1, "", "a", "1"), archive, [Member("body/data/")], tmp_path / "out")
    assert [p.relative_to(tmp_path / "out").as_posix() for p in (tmp_path / "out").rglob("*") if p.is_file()] == [
        "data/deep/file.txt"
    ]


def test_own_files_are_added_and_found_before_fetched_ones(tmp_path: Path, single: ModelEntry) -> None:
    store = store_with(tmp_path, single)
    assert store.find("disparity") is None
    fetched = store.fetch("net", quiet)
    assert store.find("disparity") == fetched
    mine = tmp_path / "Mine.ONNX"
    mine.write_bytes(b"mine")
    added = store.add(mine, None, "disparity")
    assert added.read_bytes() == b"mine"
    assert added.stat().st_mode == mine.stat().st_mode, "others may read a shared models directory"
    assert store.find("disparity") == added
    by_hand = store.models_dir / "disparity" / "0-by-hand.onnx"
    by_hand.write_bytes(b"hand")
    assert store.files("disparity") == (by_hand, added, fetched)


@pytest.mark.parametrize(
    ("file", "name", "task", "complaint"),
    [
        ("missing.onnx", None, "disparity", "not a file"),
        ("empty.onnx", None, "disparity", "not a file with something in it"),
        ("net.txt", None, "disparity", r"must end in \.onnx"),
        ("net.onnx", "../../escape", "disparity", "cannot name a model"),
        ("net.onnx", None, "cooking", "choose one of"),
    ],
)
def test_add_refuses_what_cannot_be_used(
    tmp_path: Path, file: str, name: str | None, task: str, complaint: str
) -> None:
    (tmp_path / "empty.onnx").touch()
    for real in ("net.txt", "net.onnx"):
        (tmp_path / real).write_bytes(b"x")
    store = store_with(tmp_path)
    with pytest.raises(ModelError, match=complaint):
        store.add(tmp_path / file, name, task)
    assert left_behind(store) == []


def test_unknown_name_lists_the_known(tmp_path: Path, single: ModelEntry) -> None:
    with pytest.raises(ModelError, match="choose one of net"):
        store_with(tmp_path, single).path("nothing")


def test_environment_names_the_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(MODELS_DIR_VARIABLE, str(tmp_path))
    assert ModelStore().models_dir == tmp_path
    monkeypatch.delenv(MODELS_DIR_VARIABLE)
    assert "scene-aware-mocap" in default_models_dir().as_posix()


@pytest.mark.models
def test_default_models_are_there_and_verified(models: ModelStore) -> None:
    offline = ModelStore(models.models_dir, offline=True)
    for entry in offline.entries():
        if entry.default:
            assert offline.require(entry.name).stat().st_size > 100_000
