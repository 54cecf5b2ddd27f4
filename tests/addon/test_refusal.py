"""Damaged and foreign files are refused with the reason, and Blender's scene stays as it was."""

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core_solver.errors import UserError
from core_solver.take import write_take

from .blender_truth import data_counts
from .take_factory import TakeSpec, make_take


def _good(path: Path) -> dict[str, np.ndarray]:
    write_take(path, make_take(TakeSpec(people=2, frames=4, points=20)))
    with np.load(path) as archive:
        return dict(archive)


def _cut_in_half(path: Path) -> None:
    _good(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def _another_archive(path: Path) -> None:
    np.savez(path, theta=np.zeros((4, 24, 3)))


def _text(path: Path) -> None:
    path.write_text("not an archive")


def _newer(path: Path) -> None:
    arrays = _good(path)
    document = json.loads(arrays["meta"].tobytes())
    document["version"] = 99
    arrays["meta"] = np.frombuffer(json.dumps(document).encode(), np.uint8)
    np.savez(path, **arrays)


def _not_finite(path: Path) -> None:
    arrays = _good(path)
    arrays["people/1/gamma"][2, 0] = np.nan
    np.savez(path, **arrays)


def _second_person_lost(path: Path) -> None:
    arrays = _good(path)
    del arrays["people/1/theta"]
    np.savez(path, **arrays)


def _faces_astray(path: Path) -> None:
    arrays = _good(path)
    arrays["people/0/faces"][0, 0] = 10_000
    np.savez(path, **arrays)


def _missing(path: Path) -> None:
    path.unlink(missing_ok=True)


def _a_list_of_entries_astray(path: Path) -> None:
    _good(path)
    content = bytearray(path.read_bytes())
    content[content.index(b"PK\x01\x02")] = 0
    path.write_bytes(content)


BAD_FILES = {
    "cut in half": (_cut_in_half, "archive"),
    "another archive": (_another_archive, "not a Scene-Aware Mocap take"),
    "a list of entries astray": (_a_list_of_entries_astray, "archive"),
    "text": (_text, "archive"),
    "newer": (_newer, "newer"),
    "not finite": (_not_finite, "people/1/gamma"),
    "second person lost": (_second_person_lost, "people/1/theta"),
    "faces astray": (_faces_astray, "faces of person 0"),
    "missing": (_missing, "no such file"),
}


@pytest.mark.parametrize("kind", BAD_FILES)
def test_refused_with_reason_and_scene_unchanged(kind: str, bpy: Any, tmp_path: Path) -> None:
    spoil, reason = BAD_FILES[kind]
    path = tmp_path / "bad.npz"
    spoil(path)
    bpy.ops.mesh.primitive_cube_add()
    before = data_counts(bpy)
    with pytest.raises(RuntimeError, match=reason) as refusal:
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(path))
    assert "Traceback" not in str(refusal.value)
    assert data_counts(bpy) == before


def test_a_take_that_cannot_be_reached_is_refused(bpy: Any, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"cannot read .*File name too long; choose another file") as refusal:
        bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / f"{'n' * 300}.npz"))
    assert "Traceback" not in str(refusal.value)


def test_a_take_that_must_not_be_read_is_refused(addon: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As root every file may be read: the system's refusal is played."""
    _good(tmp_path / "t.npz")

    def refuse(*_: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(UserError, match=r"cannot read .*t\.npz: Permission denied"):
        addon("scene_import.motion_files").read_motion_file(tmp_path / "t.npz")


def test_the_good_file_these_come_from_is_taken(bpy: Any, tmp_path: Path) -> None:
    _good(tmp_path / "good.npz")
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "good.npz")) == {"FINISHED"}


def test_a_take_without_people_brings_the_scene_alone(bpy: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=0))
    write_take(tmp_path / "empty.npz", take)
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "empty.npz")) == {"FINISHED"}
    assert not [o for o in bpy.data.objects if o.type == "ARMATURE"]


def test_a_person_without_skin_or_with_joints_in_one_place_still_gets_all_bones(bpy: Any, tmp_path: Path) -> None:
    take = make_take(TakeSpec(people=1))
    person = take.people[0]
    rest = person.rest_joints.copy()
    rest[22] = rest[20]
    rest[5] = rest[2]
    bare = dataclasses.replace(
        person,
        rest_joints=rest,
        rest_vertices=np.zeros((0, 3), np.float32),
        faces=np.zeros((0, 3), np.int32),
        weight_joints=np.zeros((0, 4), np.uint8),
        weights=np.zeros((0, 4), np.float32),
    )
    write_take(tmp_path / "bare.npz", dataclasses.replace(take, people=(bare,)))
    assert bpy.ops.import_scene.scene_aware_mocap(filepath=str(tmp_path / "bare.npz")) == {"FINISHED"}
    armature = next(o for o in bpy.data.objects if o.type == "ARMATURE")
    assert len(armature.data.bones) == 24
    assert not armature.children
