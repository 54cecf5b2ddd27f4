# SPDX-License-Identifier: GPL-3.0-or-later
"""Characters and camera to files for an engine: read, staged, written whole or not at all, and read back."""

import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import bpy

from ..scene_import.timing import split_rate
from .performance import (
    Character,
    ExportError,
    Performance,
    Shot,
    Timing,
    characters_among,
    film,
    perform,
    timing_of,
)
from .profiles import GENERIC, Profile, load_profile
from .showing import shown
from .staging import needs_rest_key, stage, stage_camera, units_of
from .temporary import free_names, object_mode, temporary_scene
from .verification import Check, verify
from .writing import Writer, writer_of

_FORBIDDEN = '<>:"/\\|?*'
"""In the names of files on some system."""

_SYSTEM_ERROR = re.compile(r"\[(?:Errno|WinError) \d+\] ([^:\n]+)")
"""What the system says about a file, as a traceback ends."""


@dataclass(frozen=True)
class Exported:
    """What was written.

    Attributes:
        files: the files.
        checks: one for each character in each file.
    """

    files: tuple[Path, ...]
    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether every file holds what it should."""
        return all(check.passed for check in self.checks)


@dataclass(frozen=True)
class Cast:
    """Who goes into one file.

    Attributes:
        file: its name.
        performances: its characters.
        nodes: names of their armatures in the file.
    """

    file: str
    performances: tuple[Performance, ...]
    nodes: tuple[str, ...]


def export_objects(context: bpy.types.Context, objects: Sequence[bpy.types.Object], path: Path) -> Exported:
    """Write characters, with a camera if there is one among the objects, to one file as they are in the scene.

    The file's ending, .glb or .fbx, chooses the format; otherwise as `export_characters`.
    """
    profile = replace(load_profile(GENERIC), format=path.suffix.lower().removeprefix("."))
    camera = next((obj for obj in objects if obj.type == "CAMERA"), None)
    return export_characters(context, characters_among(context, objects), profile, path.parent, path.name, camera)


def export_characters(
    context: bpy.types.Context,
    characters: Sequence[Character],
    profile: Profile,
    folder: Path,
    name: str,
    camera: bpy.types.Object | None = None,
) -> Exported:
    """Write characters as an engine wants them, over the scene's frame range, and read every file back.

    Old files are replaced only when all new ones are complete. The user's scene stays as it is. Hidden objects are
    written too. Neither format can hide somebody for a while: people who have not come yet or have left stand still
    where they were first or last seen, and the armatures' custom properties (extras of a GLB's nodes, user properties
    in FBX) say when they are there.

    Args:
        context: Blender's.
        characters: from `characters_among`.
        profile: format, units, names, how many files.
        folder: made when it is missing.
        name: of the file, its ending may be missing; with a file for each character, their names follow it.
        camera: goes along where all characters share a file.

    Returns:
        The files and what is in them; files that do not hold what they should are written nevertheless.

    Raises:
        UserError: nobody to export, a stretched armature, a missing exporter, or the disk refuses a file; nothing is
            written then.
    """
    write = writer_of(profile.format)
    _refuse_unfit(context, characters)
    with object_mode(context):
        timing = timing_of(context.scene, profile.frame_rate)
        performances, shot = _read(context, characters, None if profile.one_file_each else camera, timing)
        casts = _casts(performances, profile, name)
        _refuse_shared_files(casts)
        with free_names(_names(casts, shot)), _parts(folder) as parts:
            written = [_write(context, cast, shot, timing, profile, parts, write) for cast in casts]
            checks = [
                replace(check, file=cast.file)
                for part, cast in zip(written, casts, strict=True)
                for check in verify(context, part, cast.nodes, cast.performances, timing, profile)
            ]
            for part, cast in zip(written, casts, strict=True):
                part.replace(folder / cast.file)
    return Exported(tuple(folder / cast.file for cast in casts), tuple(checks))


@contextmanager
def _parts(folder: Path) -> Iterator[Path]:
    """A place within a folder for files that are not whole yet; a folder made for nothing is taken away again.

    Raises:
        ExportError: the disk or Blender's exporter refuses a file.
    """
    made: list[Path] = []
    try:
        made += [place for place in (folder, *folder.parents) if not place.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".export-", dir=folder) as parts:
            yield Path(parts)
    except (OSError, RuntimeError) as error:
        hint = "free some space or choose another place or name"
        raise ExportError(f"cannot write to {folder}: {_reason(error)}; {hint}") from error
    finally:
        for place in made:
            with suppress(OSError):  # a folder that holds files stays
                place.rmdir()


def _reason(error: OSError | RuntimeError) -> str:
    """Why the disk or an exporter refuses, in one line; Blender gives an exporter's own error with its traceback."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    refused = _SYSTEM_ERROR.search(str(error))
    lines = [line for line in str(error).splitlines() if line.strip() and not line.startswith("Location:")]
    return refused[1] if refused else lines[-1].strip() if lines else type(error).__name__


def _refuse_unfit(context: bpy.types.Context, characters: Sequence[Character]) -> None:
    if not characters:
        raise ExportError("nobody to export: select an armature, or a mesh that one moves")
    names = [character.armature.name for character in characters]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise ExportError(f"two characters are called '{twice}': rename one, or export them one by one")
    there = _visible(context)
    for character in characters:
        if character.armature not in there:
            raise ExportError(f"'{character.armature.name}' is in no visible collection: include it in the view layer")


def _read(
    context: bpy.types.Context, characters: Sequence[Character], camera: bpy.types.Object | None, timing: Timing
) -> tuple[tuple[Performance, ...], Shot | None]:
    """All that is needed of the user's scene; hidden things are shown meanwhile, as Blender does not move them."""
    objects = [obj for character in characters for obj in (character.armature, *character.meshes)]
    objects += [camera] if camera else []
    there = _visible(context)
    with shown(context, [obj for obj in objects if obj in there]):
        performances = tuple(perform(context, character, timing) for character in characters)
        return performances, film(context, camera, timing) if camera else None


def _visible(context: bpy.types.Context) -> set[bpy.types.Object]:
    """What is in the view layer, hidden or not; what has just been made gets there by an update."""
    context.view_layer.update()
    return set(context.view_layer.objects)


def file_name(name: str, profile: Profile) -> str:
    """The name of the one file that an export called `name` gives; its ending may be missing."""
    return _file_name(*_stem_and_ending(name, profile))


def _stem_and_ending(name: str, profile: Profile) -> tuple[str, str]:
    ending = f".{profile.format}"
    return (Path(name).stem, Path(name).suffix) if Path(name).suffix.lower() == ending else (name, ending)


def _casts(performances: tuple[Performance, ...], profile: Profile, name: str) -> tuple[Cast, ...]:
    stem, ending = _stem_and_ending(name, profile)
    if not profile.one_file_each:
        alone = profile.armature_name if len(performances) == 1 else ""
        nodes = tuple(alone or performance.name for performance in performances)
        return (Cast(_file_name(stem, ending), performances, nodes),)
    return tuple(
        Cast(_file_name(f"{stem}_{p.name}", ending), (p,), (profile.armature_name or p.name,)) for p in performances
    )


def _file_name(stem: str, ending: str) -> str:
    """A file's name that every system takes."""
    return ("".join("_" if sign in _FORBIDDEN else sign for sign in stem).strip() or "scene") + ending


def _refuse_shared_files(casts: Sequence[Cast]) -> None:
    """Names of characters may differ in signs that files' names leave out, or in capitals that some systems ignore."""
    owners: dict[str, Cast] = {}
    for cast in casts:
        other = owners.setdefault(cast.file.casefold(), cast)
        if other is not cast:
            names = " and ".join(f"'{each.performances[0].name}'" for each in (other, cast))
            raise ExportError(f"{names} would be written to the same file {other.file}: rename one")


def _names(casts: Sequence[Cast], shot: Shot | None) -> set[str]:
    """All names that the files' contents shall bear."""
    names = {name for cast in casts for name in (*cast.nodes, Path(cast.file).stem)}
    bodies = [body for cast in casts for performance in cast.performances for body in performance.bodies]
    names |= {name for body in bodies for name in (body.name, body.data_name)}
    return names | ({shot.name, shot.data_name} if shot else set())


def _write(
    context: bpy.types.Context,
    cast: Cast,
    shot: Shot | None,
    timing: Timing,
    profile: Profile,
    folder: Path,
    write: Writer,
) -> Path:
    """Write one file in a folder for parts, and give its path."""
    path = folder / f"{Path(cast.file).stem}.{profile.format}"
    with temporary_scene(context, path.stem) as scene:
        scene.render.fps, scene.render.fps_base = split_rate(timing.rate)
        scene.frame_start, scene.frame_end = int(timing.frames[0]), int(timing.frames[-1])
        # So that Blender's FBX exporter writes the stage's units as the file's own.
        scene.unit_settings.scale_length = 1 / units_of(profile)
        for performance, node in zip(cast.performances, cast.nodes, strict=True):
            stage(context, performance, timing, profile, node)
        if shot is not None:
            stage_camera(context, shot, timing, profile)
        scene.frame_set(scene.frame_start - needs_rest_key(profile))
        write(context, path, profile)
    return path
