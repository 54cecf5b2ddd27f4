# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone maps of well-known skeletons, as JSON files: which names play which roles.

A file holds a `title`, `roles`, and an optional `priority` for rigs that fit several presets. A role has the names it
may go by; the first that a rig has is taken, and for the spine all that it has, from the hips upwards. A limb's role
without its side stands for both: its names then hold {side} (left, right) or {s} (l, r). Names are compared without
regard to case, separators and prefixes.
"""

import json
import os
import re
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from core_solver.errors import UserError

from .bone_map import BoneMap
from .names import canonical, readings
from .roles import LIMBS, NEEDED, ROLES, SIDES, SPINE
from .skeleton import Skeleton

BUILT_IN = Path(__file__).with_name("presets")
SUFFIX = ".json"


@dataclass(frozen=True)
class Preset:
    """A kind of skeleton, known by its bones' names.

    Attributes:
        title: shown to users.
        roles: the names by which each role goes.
        priority: of two presets that fit a rig completely, the one with the higher number is meant.
    """

    title: str
    roles: dict[str, tuple[str, ...]]
    priority: int = 0


def built_in_presets() -> tuple[Preset, ...]:
    """Those that come with the extension, by title."""
    return read_presets(BUILT_IN)[0]


def read_presets(folder: Path) -> tuple[tuple[Preset, ...], tuple[str, ...]]:
    """All presets of a folder by title, and what is wrong with files that are none."""
    presets, problems = [], []
    for path in sorted(folder.glob(f"*{SUFFIX}")):
        try:
            presets.append(read_preset(path))
        except UserError as error:
            problems.append(str(error))
    return tuple(sorted(presets, key=lambda preset: preset.title)), tuple(problems)


def read_preset(path: Path) -> Preset:
    """Read one file.

    Raises:
        UserError: it cannot be read or is no preset.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"cannot read the bone map {path}: {error.strerror}") from None
    except ValueError:
        raise UserError(f"{path.name} is no bone map: it is not valid JSON") from None
    fault = _fault(content)
    if fault:
        raise UserError(f"{path.name} is no bone map: {fault}")
    roles: dict[str, tuple[str, ...]] = {}
    for role, names in content["roles"].items():
        roles.update(_both_sides(role, tuple(names)) if role in LIMBS else {role: tuple(names)})
    return Preset(content["title"], roles, content.get("priority", 0))


def save_preset(folder: Path, title: str, bone_map: BoneMap) -> Path:
    """Write a map as a preset of the user's, over one of the same title.

    Raises:
        UserError: there is no title, or the file cannot be written.
    """
    stem = re.sub(r"\W+", "_", title).strip("_").lower()
    if not stem:
        raise UserError("the bone map needs a name: type one")
    roles: dict[str, list[str]] = {}
    for role, bone in bone_map.bones:
        roles.setdefault(role, []).append(bone)
    path = folder / f"{stem}{SUFFIX}"
    try:
        _write_whole(path, json.dumps({"title": title, "priority": 1, "roles": roles}, ensure_ascii=False, indent=2))
    except OSError as error:
        raise UserError(f"cannot write the bone map {path}: {error.strerror}") from None
    return path


def matched(preset: Preset, skeleton: Skeleton) -> BoneMap:
    """The roles of a preset that a rig has bones for; a bone plays one role only."""
    maps = [_matched_by(preset, bones) for bones in _all_readings(skeleton)]
    return max(maps, key=lambda bone_map: len(bone_map.bones))


def coverage(bone_map: BoneMap) -> float:
    """0..1 how many of the needed roles a map fills."""
    return sum(bone_map.bone(role) is not None for role in NEEDED) / len(NEEDED)


def _all_readings(skeleton: Skeleton) -> tuple[dict[str, str], ...]:
    exact = {name: name for name in skeleton.names}
    return tuple({**reading, **exact} for reading in readings(skeleton.names))


def _matched_by(preset: Preset, bones: dict[str, str]) -> BoneMap:
    pairs: list[tuple[str, str]] = []
    for role, names in preset.roles.items():
        found = [bones.get(name) or bones.get(canonical(name)) for name in names]
        free = [bone for bone in dict.fromkeys(found) if bone and bone not in {taken for _, taken in pairs}]
        pairs += [(role, bone) for bone in (free if role == SPINE else free[:1])]
    return BoneMap(tuple(pairs), source=preset.title)


def _both_sides(limb: str, names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    return {f"{side}_{limb}": tuple(_with_side(name, side) for name in names) for side in SIDES}


def _with_side(name: str, side: str) -> str:
    return name.replace("{side}", side).replace("{s}", side[0])


def _fault(content: Any) -> str | None:
    """What keeps the content of a file from being a preset."""
    if not isinstance(content, dict) or not isinstance(content.get("title"), str):
        return "it has no title"
    if not isinstance(content.get("priority", 0), int):
        return "its priority is no whole number"
    roles = content.get("roles")
    if not isinstance(roles, dict) or not roles:
        return "it has no roles"
    for role, names in roles.items():
        if role not in ROLES and role not in LIMBS:
            return f"there is no role '{role}'"
        if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
            return f"the names of '{role}' are no list of texts"
    return None


def _write_whole(path: Path, text: str) -> None:
    """Write a file so that it is there whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, draft = tempfile.mkstemp(dir=path.parent, suffix=".part")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(draft).replace(path)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise
