"""What lies in a folder of modalities, and what its optional `modalities.toml` says about it."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from core_solver.errors import UserError

SETTINGS_FILE = "modalities.toml"

JOINTS, SMPL, DEPTH, MASKS = "joints", "smpl", "depth", "masks"
MODALITIES = (JOINTS, SMPL, DEPTH, MASKS)

DISPARITY_KIND, METRIC_KIND = "disparity", "depth"

# Lower-case names; first the project's own, then those that other programs write.
_NAMES = {
    JOINTS: ("joints", "alphapose", "openpose", "alphapose-results.json", "keypoints.json"),
    SMPL: ("smpl", "romp_predictions", "bev_predictions", "romp", "bev", "smpl.npz", "video_results.npz"),
    DEPTH: ("depth", "disparity", "dpt_large_monodepth", "dpt_hybrid_monodepth", "midas_monodepth", "depth.npz",
            "disparity.npz"),
    MASKS: ("masks", "mask2former_instances", "masks.json"),
}  # fmt: skip
_METRIC_NAMES = ("depth", "depth.npz")  # the others are networks' disparity
_UNTRACKED_NAMES = ("mask2former_instances",)  # ids that start anew in every picture


@dataclass(frozen=True)
class Source:
    """One modality's files and how to read them.

    Attributes:
        path: a folder or a file.
        label: its place in the folder of modalities, for messages.
        first: number of the video's first frame; None to find out.
        size: (width, height) of the pictures that the pixels refer to; None where the files say, or the video's.
        identities: whether ids stay with a person from frame to frame.
        is_metric: depth rather than disparity.
        stretch: lay pictures of another shape over the whole video.
    """

    path: Path
    label: str
    first: int | None = None
    size: tuple[int, int] | None = None
    identities: bool = True
    is_metric: bool = False
    stretch: bool = False


@dataclass(frozen=True)
class Folder:
    """The sources of a folder, None for a modality that it lacks.

    Attributes:
        path: the folder.
        joints: 2D joints.
        smpl: SMPL poses.
        depth: depth or disparity.
        masks: people's masks.
    """

    path: Path
    joints: Source | None = None
    smpl: Source | None = None
    depth: Source | None = None
    masks: Source | None = None

    def sources(self) -> tuple[Source, ...]:
        """Those that there are."""
        return tuple(s for s in (self.joints, self.smpl, self.depth, self.masks) if s is not None)

    def files(self) -> tuple[Path, ...]:
        """Every file that decides what is seen, in a fixed order."""
        settings = self.path / SETTINGS_FILE
        found = [settings] if settings.is_file() else []
        for source in self.sources():
            inside = source.path.rglob("*") if source.path.is_dir() else [source.path]
            found += sorted(file for file in inside if file.is_file())
        return tuple(found)


@dataclass(frozen=True)
class _Wishes:
    """A table of modalities.toml."""

    values: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""

    def get(self, key: str, kind: type) -> Any:
        value = self.values.get(key)
        if value is not None and (not isinstance(value, kind) or (kind is int and isinstance(value, bool))):
            raise UserError(f"{SETTINGS_FILE}: {key} of [{self.name}] must be {_KIND_NAMES[kind]}")
        return value


_KIND_NAMES: dict[type, str] = {str: "a text", int: "a whole number", bool: "true or false", list: "a list"}
_KEYS = {"path", "first", "size", "identities", "kind", "stretch"}


def open_folder(path: Path) -> Folder:
    """Find out what is in a folder of modalities.

    Raises:
        UserError: no folder, nothing in it that is known, two sources for one modality, or a damaged modalities.toml.
    """
    if not path.is_dir():
        raise UserError(f"{path} is no folder of modalities: check --modalities")
    wishes = _read_wishes(path / SETTINGS_FILE)
    entries = {entry.name.lower(): entry for entry in sorted(path.iterdir())}
    sources = {name: _source(path, name, entries, wishes[name]) for name in MODALITIES}
    if not any(sources.values()):
        known = ", ".join(f"{name}/" for name in MODALITIES)
        raise UserError(f"{path} holds no modality: put files into {known} or name them in {SETTINGS_FILE}")
    return Folder(path, **sources)


def _source(folder: Path, name: str, entries: Mapping[str, Path], wishes: _Wishes) -> Source | None:
    place = _place(folder, name, entries, wishes)
    if place is None:
        return None
    known_name = place.name.lower()
    kind = wishes.get("kind", str) or (METRIC_KIND if known_name in _METRIC_NAMES else DISPARITY_KIND)
    if kind not in (DISPARITY_KIND, METRIC_KIND):
        raise UserError(f'{SETTINGS_FILE}: kind of [{name}] must be "{DISPARITY_KIND}" or "{METRIC_KIND}"')
    identities = wishes.get("identities", bool)
    return Source(
        path=place,
        label=place.relative_to(folder).as_posix() if place.is_relative_to(folder) else str(place),
        first=wishes.get("first", int),
        size=_wished_size(wishes),
        identities=known_name not in _UNTRACKED_NAMES if identities is None else identities,
        is_metric=kind == METRIC_KIND,
        stretch=bool(wishes.get("stretch", bool)),
    )


def _place(folder: Path, name: str, entries: Mapping[str, Path], wishes: _Wishes) -> Path | None:
    wished = wishes.get("path", str)
    if wished is not None:
        place = folder / wished
        if not place.exists():
            raise UserError(f"there is no {place}: mend path of [{name}] in {SETTINGS_FILE}")
        return place
    found = [entries[known] for known in _NAMES[name] if known in entries and _holds_something(entries[known])]
    if len(found) > 1:
        names = " and ".join(place.name for place in found)
        raise UserError(f"{folder} holds {name} twice, {names}: name one with path of [{name}] in {SETTINGS_FILE}")
    return found[0] if found else None


def _holds_something(place: Path) -> bool:
    return place.is_file() or any(place.iterdir())


def _wished_size(wishes: _Wishes) -> tuple[int, int] | None:
    size = wishes.get("size", list)
    if size is None:
        return None
    if len(size) != 2 or not all(isinstance(n, int) and n > 0 for n in size):
        raise UserError(f"{SETTINGS_FILE}: size of [{wishes.name}] must be [width, height]")
    return size[0], size[1]


def _read_wishes(file: Path) -> dict[str, _Wishes]:
    try:
        tables = tomllib.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    except (ValueError, OSError) as error:
        raise UserError(f"{file} cannot be read ({' '.join(str(error).split())}): mend it") from error
    for name, table in tables.items():
        unknown = set(table) - _KEYS if isinstance(table, dict) else {name}
        if name not in MODALITIES or unknown:
            known = ", ".join(f"[{m}]" for m in MODALITIES)
            raise UserError(
                f"{file}: {', '.join(sorted(unknown)) or name} is not known there; tables are {known} with "
                f"{', '.join(sorted(_KEYS))}"
            )
    return {name: _Wishes(tables.get(name, {}), name) for name in MODALITIES}
