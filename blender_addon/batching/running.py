# SPDX-License-Identifier: GPL-3.0-or-later
"""One take after the other: import, clean, retarget, export."""

import contextlib
import io
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from core_solver.errors import UserError

from ..clean.foot_lock import BLEND
from ..export.exporting import Exported, export_characters, file_name
from ..export.performance import characters_among
from ..retarget.bone_map import TAKE_MAP
from ..retarget.measures import Measures
from ..retarget.options import Options
from ..rig.cleaning import Step, clean, drift_removal, finish, foot_lock, gap_filling, ground_snap, smoothing
from ..rig.retargeting import Role, retarget
from ..scene_import.motion_files import read_motion_file
from ..scene_import.take_import import Imported, ImportOptions, chosen_people, import_take
from .report import PersonReport, TakeReport
from .request import Request
from .rigs import load_character

_CUTOFF_HZ = 6.0
"""Faster than this no limb is moved on purpose."""


@dataclass(frozen=True)
class _Cast:
    """Who is to be written.

    Attributes:
        armatures: of the people, or of the characters that move instead.
        before: measures of the people; None without retargeting.
        after: measures of the characters.
        notes: plain sentences.
    """

    armatures: tuple[bpy.types.Object, ...]
    before: Measures | None = None
    after: Measures | None = None
    notes: tuple[str, ...] = ()


def run(request: Request, path: Path) -> TakeReport:
    """Do all that is asked for with one take, in an empty Blender file; what a user can mend becomes a report.

    Args:
        request: what is asked for.
        path: one of its takes.
    """
    start = time.perf_counter()
    try:
        # Importers and exporters talk about their progress.
        with contextlib.redirect_stdout(io.StringIO()):
            report = _run(request, path)
    except UserError as error:
        report = TakeReport(path, error=str(error))
    return replace(report, seconds=time.perf_counter() - start)


def _run(request: Request, path: Path) -> TakeReport:
    take = read_motion_file(path)
    people = chosen_people(take, request.people)
    bpy.ops.wm.read_homefile(use_empty=True)
    context = bpy.context
    options = ImportOptions(people=request.people, behind=False)
    imported = import_take(context, take, path, options)
    notes = [*imported.notes, *_clean(context, imported.armatures, request.cleaning)]
    cast = _retarget(context, imported, request) if request.rig else _Cast(imported.armatures)
    exported = _export(context, cast, imported, request, path)
    return TakeReport(
        take=path,
        people=tuple(
            PersonReport(person.id, person.name, round(person.height_m, 3), rig.name if request.rig else "")
            for person, rig in zip(people, cast.armatures, strict=True)
        ),
        frames=len(imported.clock.frames),
        files=exported.files,
        verification=exported.checks,
        measures_before=cast.before,
        measures_after=cast.after,
        warnings=(*notes, *cast.notes),
    )


def unreadable(request: Request) -> str:
    """Why the first take cannot be read, in one line; empty when it can."""
    try:
        chosen_people(read_motion_file(request.takes[0]), request.people)
    except UserError as error:
        return str(error)
    return ""


def clash(request: Request) -> str:
    """Which two takes would be written to the same file in the folder, in one line; empty when none would."""
    owners: dict[str, Path] = {}
    for path in request.takes:
        file = file_name(path.stem, request.profile)
        # Some systems ignore capitals.
        other = owners.setdefault(file.casefold(), path)
        if other is not path:
            return (
                f"{other} and {path} would be written to the same files: rename one, or give each call its own --export"
            )
    return ""


def _clean(context: bpy.types.Context, people: Sequence[bpy.types.Object], names: Sequence[str]) -> list[str]:
    if not names:
        return []
    steps: dict[str, Step] = {
        "gaps": gap_filling("INBETWEEN", 0.0),
        "smooth": smoothing(_CUTOFF_HZ),
        "drift": drift_removal("AUTO"),
        "ground": ground_snap("AUTO", BLEND),
        "footlock": foot_lock(BLEND),
    }
    return finish(clean(context, people, [steps[name] for name in names], "ACTION")).notes


def _retarget(context: bpy.types.Context, imported: Imported, request: Request) -> _Cast:
    """Everybody onto a copy of the rig, which takes the person's name."""
    if request.rig is None:
        return _Cast(imported.armatures)
    character = load_character(context, request.rig, request.bone_map)
    roles = [
        Role(person, TAKE_MAP, character.armature, character.bone_map, copied=True) for person in imported.armatures
    ]
    done = retarget(roles, Options(refine=request.refine), lambda _: None)
    names = [person.name for person in imported.armatures]
    for person, rig, name in zip(imported.armatures, done.rigs, names, strict=True):
        person.name = f"{name} in the take"
        rig.name = name
    found = f"bones of {request.rig.name} found by {character.bone_map.source}"
    return _Cast(done.rigs, done.outcome.people, done.outcome.rigs, (found, *done.notes))


def _export(context: bpy.types.Context, cast: _Cast, imported: Imported, request: Request, path: Path) -> Exported:
    place = request.out or (request.folder or Path()) / path.stem
    camera = imported.camera if request.out else None
    characters = characters_among(context, cast.armatures)
    return export_characters(context, characters, request.profile, place.parent, place.name, camera)
