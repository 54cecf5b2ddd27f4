# SPDX-License-Identifier: GPL-3.0-or-later
"""What retargeting needs to know: the same for the sidebar's section and for the operator."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

import math
from typing import Any

import bpy

from ..retarget.measures import Measures
from ..retarget.options import Options

n_ = bpy.app.translations.pgettext_n

_ROOTS = (
    (
        "root_bone",
        "Root Bone",
        "The rig's root takes way and heading, as game engines read them, and the hips the rest: all without a root",
    ),
    ("hips", "Hips", "The hips take all, the root stays where it is"),
    ("in_place", "In Place", "Nobody moves over the ground: the way is lost, a game moves the characters instead"),
)
_DRIVES = (
    ("fk", "FK", "Key the controls that turn limbs: what you see is what was filmed, joint by joint"),
    ("ik", "IK", "Key the controls that hands and feet follow: easier to correct where they touch things"),
)


class RetargetInputs:
    """Properties that the section and the operator share."""

    copied: bpy.props.BoolProperty(
        name="A Copy per Person",
        description="Each person gets a copy of the rig that shares its meshes, and the rig itself stays as it is. "
        "Otherwise the rig itself gets an action, which only works for one person",
        default=True,
    )
    root: bpy.props.EnumProperty(name="Root Motion", description="What carries a character", items=_ROOTS)
    scale: bpy.props.FloatProperty(
        name="Scene Scale",
        description="One factor on everybody's place, so that distances between people keep their proportions; "
        "1 keeps metres. Characters of other size need no factor: their legs are taken care of",
        default=1.0,
        min=0.01,
        max=100.0,
        precision=3,
    )
    feet: bpy.props.BoolProperty(
        name="Keep Footprints",
        description="Feet stand where the person's stood, by bending the rig's own legs; "
        "without it feet slide on rigs whose legs are of other length",
        default=True,
    )
    refine: bpy.props.BoolProperty(
        name="Refine Whole Scene",
        description="Hands that touched somebody or something touch it again, and bodies do not run into each other; "
        "takes longer",
        default=True,
    )
    drive: bpy.props.EnumProperty(
        name="Controls", description="Which controls are keyed on rigs that have both kinds", items=_DRIVES
    )


class MeasureRow(bpy.types.PropertyGroup):
    """One line of the table that is shown after retargeting."""

    label: bpy.props.StringProperty()
    people: bpy.props.StringProperty()
    rigs: bpy.props.StringProperty()


class RetargetSettings(RetargetInputs, bpy.types.PropertyGroup):
    """The sidebar's Retarget section."""

    rig: bpy.props.PointerProperty(
        name="Rig",
        description="The armature of the character that shall move as the people do",
        type=bpy.types.Object,
        poll=lambda _settings, obj: obj.type == "ARMATURE",
    )
    table: bpy.props.CollectionProperty(type=MeasureRow)


def options_of(inputs: Any) -> Options:
    """The options that settings or an operator describe."""
    return Options(root=inputs.root, scale=inputs.scale, feet=inputs.feet, refine=inputs.refine, drive=inputs.drive)


def copy_inputs(source: Any, target: Any) -> None:
    """Carry the section's choices over to the operator's properties."""
    for name in RetargetInputs.__annotations__:
        setattr(target, name, getattr(source, name))


def show_measures(settings: Any, people: Measures, rigs: Measures) -> None:
    """Fill the section's table."""
    settings.table.clear()
    for label, unit, digits, name in _ROWS:
        row = settings.table.add()
        row.label = label
        row.people, row.rigs = (_figure(getattr(measures, name), unit, digits) for measures in (people, rigs))


_ROWS = (
    (n_("Feet slide by"), "mm", 1, "skate_mm"),
    (n_("Feet sink by"), "mm", 1, "penetration_mm"),
    (n_("Feet in place"), "%", 0, "contact_recall"),
    (n_("Distances are off by"), "mm", 0, "spacing_mm"),
    (n_("Hands miss by"), "mm", 0, "touch_mm"),
    (n_("Bodies overlap by"), "mm", 0, "overlap_mm"),
)


def _figure(value: float, unit: str, digits: int) -> str:
    if math.isnan(value):
        return "-"
    return f"{100 * value if unit == '%' else value:.{digits}f} {unit}"
