# SPDX-License-Identifier: GPL-3.0-or-later
"""What an export needs to know: the same for the sidebar's section and for the operator."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import bpy

from ..export.profiles import Profile, load_profile, profile_ids
from ..export.verification import Check

rpt_ = bpy.app.translations.pgettext_rpt

# Newer Blenders warn of "//" where a property does not say that it takes it.
TAKES_RELATIVE = {"PATH_SUPPORTS_BLEND_RELATIVE"} if bpy.app.version >= (4, 5) else set()
_AS_PROFILE = ("PROFILE", "As the Engine Likes", "As the engine's profile says")


def _engines() -> tuple[tuple[str, str, str], ...]:
    profiles = [load_profile(name) for name in profile_ids()]
    return tuple((profile.id, profile.title, profile.description) for profile in profiles)


class ExportInputs:
    """Properties that the section and the operator share."""

    engine: bpy.props.EnumProperty(
        name="Engine", description="For which engine: decides axes, unit, bone names and root", items=_engines()
    )
    file_format: bpy.props.EnumProperty(
        name="Format",
        description="Kind of file",
        items=(
            _AS_PROFILE,
            ("glb", "GLB", "One binary glTF file, always in metres"),
            ("fbx", "FBX", "An FBX file with one key per frame"),
        ),
    )
    files: bpy.props.EnumProperty(
        name="Files",
        description="How many files",
        items=(
            _AS_PROFILE,
            ("ALL", "All Together", "One file with all characters, in one animation"),
            ("EACH", "One per Character", "A file for each character, with its name behind the file's"),
        ),
    )
    contents: bpy.props.EnumProperty(
        name="Contents",
        description="What goes into the files",
        items=(
            _AS_PROFILE,
            ("MESHES", "Bodies and Motion", "Meshes with their materials, armatures and motion"),
            ("MOTION", "Motion Alone", "Armatures and motion, for characters that the engine has already"),
        ),
    )
    frame_rate: bpy.props.FloatProperty(
        name="Frame Rate",
        description="Frames per second of the files; 0 for the scene's, or the engine's if it has one",
        min=0.0,
        max=1000.0,
        default=0.0,
    )
    camera: bpy.props.BoolProperty(
        name="Camera",
        description="The scene's camera too, where all characters share a file",
        default=False,
    )


class CheckRow(bpy.types.PropertyGroup):
    """One line of what was found on reading the files back: `name`, which every entry has, is the character's."""

    file: bpy.props.StringProperty()
    passed: bpy.props.BoolProperty()
    text: bpy.props.StringProperty()


class ExportSettings(ExportInputs, bpy.types.PropertyGroup):
    """The sidebar's Export section."""

    folder: bpy.props.StringProperty(
        name="Folder",
        description="Where the files go; // is the folder of this Blender file",
        subtype="DIR_PATH",
        options=TAKES_RELATIVE,
    )
    file_name: bpy.props.StringProperty(name="Name", description="Of the files, without ending", default="scene")
    checks: bpy.props.CollectionProperty(type=CheckRow)


def profile_of(inputs: Any) -> Profile:
    """The engine's profile with what the user wants otherwise."""
    profile = load_profile(inputs.engine)
    if inputs.file_format != "PROFILE":
        profile = replace(profile, format=inputs.file_format)
    if inputs.files != "PROFILE":
        profile = replace(profile, one_file_each=inputs.files == "EACH")
    if inputs.contents != "PROFILE":
        profile = replace(profile, meshes=inputs.contents == "MESHES")
    return replace(profile, frame_rate=inputs.frame_rate or profile.frame_rate)


def copy_inputs(source: Any, target: Any) -> None:
    """Carry the section's choices over to the operator's properties."""
    for name in ExportInputs.__annotations__:
        setattr(target, name, getattr(source, name))


def show_checks(settings: Any, checks: Sequence[Check]) -> None:
    """Fill the section's list."""
    settings.checks.clear()
    for check in checks:
        row = settings.checks.add()
        row.name, row.file, row.passed, row.text = check.character, check.file, check.passed, summary(check)


def summary(check: Check) -> str:
    """One line about a character in a file."""
    if not check.passed:
        return "; ".join(check.problems)
    return rpt_("{} bones, joints within {:.3f} mm").format(check.bones, 1000 * check.joint_error_m)
