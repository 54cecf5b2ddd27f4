"""The humanoid map in VRM files."""

import json
import struct
from pathlib import Path
from typing import Any

import pytest

from core_solver.errors import UserError

NODES = ["Root", "Hip Bone", "Belly", "Breast", "Skull", "Bein L", "腕", "Eye"]
HUMANS = {"hips": 1, "spine": 2, "upperChest": 3, "head": 4, "leftUpperLeg": 5, "rightUpperArm": 6, "leftEye": 7}
ROLES = {
    ("hips", "Hip Bone"), ("spine", "Belly"), ("spine", "Breast"), ("head", "Skull"), ("left_thigh", "Bein L"),
    ("right_upper_arm", "腕"),
}  # fmt: skip


def write_glb(path: Path, extensions: Any) -> Path:
    text = json.dumps({"nodes": [{"name": name} for name in NODES], "extensions": extensions}).encode()
    text += b" " * (-len(text) % 4)
    path.write_bytes(struct.pack("<4sIII4s", b"glTF", 2, 20 + len(text), len(text), b"JSON") + text)
    return path


def vrm0(humans: dict[str, int]) -> Any:
    bones = [{"bone": human, "node": node, "useDefaultValues": True} for human, node in reversed(humans.items())]
    return {"VRM": {"humanoid": {"humanBones": bones}}}


def vrm1(humans: dict[str, int]) -> Any:
    return {"VRMC_vrm": {"humanoid": {"humanBones": {human: {"node": node} for human, node in humans.items()}}}}


@pytest.mark.parametrize("version", [vrm0, vrm1])
def test_both_versions_are_read(addon: Any, tmp_path: Path, version: Any) -> None:
    found = addon("retarget.vrm").read_vrm_map(write_glb(tmp_path / "a.vrm", version(HUMANS)))
    assert set(found.bones) == ROLES
    assert found.spine == ("Belly", "Breast")


def test_a_real_file(addon: Any, shared_data: Path) -> None:
    found = addon("retarget.vrm").read_vrm_map(shared_data / "rigs" / "mh_vrm1.vrm")
    assert found.bone("left_forearm") == "mixamorig:LeftForeArm"
    assert found.spine == ("mixamorig:Spine", "mixamorig:Spine1", "mixamorig:Spine2")
    assert len(found.bones) == 22


@pytest.mark.parametrize(
    ("extensions", "match"),
    [
        ({}, "holds no humanoid map"),
        (vrm1({}), "holds no humanoid map"),
        (vrm1({"hips": 99}), "damaged"),
        ({"VRMC_vrm": {"humanoid": []}}, "damaged"),
        ({"VRM": {}}, "damaged"),
        (vrm0({"hips": "x"}), "damaged"),  # type: ignore[dict-item]
        ([], "holds no humanoid map"),
    ],
)
def test_files_without_a_map_are_refused(addon: Any, tmp_path: Path, extensions: Any, match: str) -> None:
    with pytest.raises(UserError, match=f"a.vrm.*{match}|{match}.*a.vrm|map in a.vrm is {match}"):
        addon("retarget.vrm").read_vrm_map(write_glb(tmp_path / "a.vrm", extensions))


@pytest.mark.parametrize("content", [b"", b"glTF", b"PK\x03\x04" + bytes(40), b"glTF" + bytes(60)])
def test_other_files_are_refused(addon: Any, tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.vrm").write_bytes(content)
    with pytest.raises(UserError, match=r"a\.vrm is no VRM or GLB file"):
        addon("retarget.vrm").read_vrm_map(tmp_path / "a.vrm")


def test_a_truncated_file_is_refused(addon: Any, tmp_path: Path) -> None:
    path = write_glb(tmp_path / "a.vrm", vrm1(HUMANS))
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(UserError, match="no VRM"):
        addon("retarget.vrm").read_vrm_map(path)


def test_a_missing_file_is_told(addon: Any, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="cannot read"):
        addon("retarget.vrm").read_vrm_map(tmp_path / "none.vrm")
