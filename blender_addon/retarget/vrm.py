# SPDX-License-Identifier: GPL-3.0-or-later
"""The humanoid map that a VRM file holds: version 0.x and 1.0, in .vrm and .glb files."""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from core_solver.errors import UserError

from .bone_map import BoneMap
from .roles import SIDES, SPINE

SOURCE = "the file's own map"

_MAGIC, _JSON = b"glTF", b"JSON"
_LARGEST_JSON = 1 << 30

_TRUNK = {"hips": "hips", "spine": SPINE, "chest": SPINE, "upperChest": SPINE, "neck": "neck", "head": "head"}
_LIMBS = {
    "Shoulder": "clavicle", "UpperArm": "upper_arm", "LowerArm": "forearm", "Hand": "hand",
    "UpperLeg": "thigh", "LowerLeg": "shin", "Foot": "foot", "Toes": "toe",
}  # fmt: skip
ROLE_OF_HUMAN_BONE = _TRUNK | {f"{side}{bone}": f"{side}_{role}" for side in SIDES for bone, role in _LIMBS.items()}
"""VRM's human bones, spine from the hips upwards; fingers, eyes and jaw play no role here."""


def map_of_human_bones(bones: Mapping[str, str]) -> BoneMap:
    """A map from VRM's human bones to the names of a rig's bones; unknown and empty ones are left out."""
    pairs = tuple((role, bones[human]) for human, role in ROLE_OF_HUMAN_BONE.items() if bones.get(human))
    return BoneMap(pairs, source=SOURCE)


def read_vrm_map(path: Path) -> BoneMap:
    """The map of a VRM file.

    Raises:
        UserError: it cannot be read, is no binary glTF, or holds no humanoid.
    """
    content = _json_of(path)
    try:
        names = [node.get("name", "") for node in content.get("nodes", [])]
        humans = {human: names[node] for human, node in _human_nodes(content.get("extensions", {})).items()}
    except (AttributeError, IndexError, KeyError, TypeError, ValueError):
        raise UserError(f"the humanoid map in {path.name} is damaged: choose a preset instead") from None
    if not humans:
        raise UserError(f"{path.name} holds no humanoid map: choose a VRM file, or a preset")
    return map_of_human_bones(humans)


def _human_nodes(extensions: Any) -> dict[str, int]:
    """Human bones and the numbers of their nodes."""
    if "VRMC_vrm" in extensions:
        return {human: int(entry["node"]) for human, entry in extensions["VRMC_vrm"]["humanoid"]["humanBones"].items()}
    if "VRM" in extensions:
        return {entry["bone"]: int(entry["node"]) for entry in extensions["VRM"]["humanoid"]["humanBones"]}
    return {}


def _json_of(path: Path) -> dict[str, Any]:
    """The first chunk of a binary glTF: 12 bytes of header, then its length, its kind and the text."""
    try:
        with path.open("rb") as file:
            magic, _, _, length, kind = struct.unpack("<4sIII4s", file.read(20))
            is_glb = magic == _MAGIC and kind == _JSON and length < _LARGEST_JSON
            content = json.loads(file.read(length)) if is_glb else None
    except OSError as error:
        raise UserError(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, struct.error):
        content = None
    if not isinstance(content, dict):
        raise UserError(f"{path.name} is no VRM or GLB file: choose another one")
    return content
