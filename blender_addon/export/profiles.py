# SPDX-License-Identifier: GPL-3.0-or-later
"""What a game engine wants of a file: profiles as JSON data beside this module. Standard library only.

Each profile is one object with exactly the keys of `Profile`, but for `id`, which is the file's name.
"""

import json
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

from core_solver.errors import UserError

_FOLDER = Path(__file__).with_name("profiles")
GENERIC = "generic"


@dataclass(frozen=True)
class Profile:
    """How files for one engine are written.

    Attributes:
        id: name of its file without ending.
        title: shown to the user.
        description: one sentence for the tooltip.
        format: "glb" or "fbx".
        units_per_metre: 1 for metres, 100 for centimetres; FBX only, as GLB always has metres.
        fbx_scale: how the FBX file says its unit, an option of Blender's exporter.
        axis_forward: of the FBX file: "X", "-X", "Y", ...
        axis_up: of the FBX file.
        armature_name: of the armature's node; empty for the character's own name. Only in files of one character.
        root_bone: a bone of this name is put above all others unless there is one; empty for none.
        root_moves: the added root bone follows the hips over the ground; otherwise it stays at the origin.
        frame_rate: frames per second of the file; 0 for the scene's.
        one_file_each: a file for every character instead of one for all.
        meshes: bodies too; otherwise armatures and motion alone.
        bone_names: new names of the bones of people that came from a take; other rigs keep theirs.
    """

    id: str
    title: str
    description: str
    format: str
    units_per_metre: float
    fbx_scale: str
    axis_forward: str
    axis_up: str
    armature_name: str
    root_bone: str
    root_moves: bool
    frame_rate: float
    one_file_each: bool
    meshes: bool
    bone_names: dict[str, str]


class ProfileError(UserError):
    """A profile that does not exist or is damaged."""


def profile_ids() -> tuple[str, ...]:
    """All profiles, the generic one first."""
    others = sorted(path.stem for path in _FOLDER.glob("*.json") if path.stem != GENERIC)
    return (GENERIC, *others)


def load_profile(name: str) -> Profile:
    """A profile by its id.

    Raises:
        ProfileError: there is none of that name, or it is damaged.
    """
    if name not in profile_ids():
        raise ProfileError(f"there is no engine profile {name!r}: choose one of {', '.join(profile_ids())}")
    return _read(_FOLDER / f"{name}.json")


@cache
def _read(path: Path) -> Profile:
    try:
        document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ProfileError(f"the engine profile {path.name} cannot be read: {error}") from error
    wanted = {field.name for field in fields(Profile)} - {"id"}
    if document.keys() != wanted:
        odd = ", ".join(sorted(document.keys() ^ wanted))
        raise ProfileError(f"the engine profile {path.name} lacks or does not know: {odd}")
    return Profile(id=path.stem, **document)
