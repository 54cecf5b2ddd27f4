# SPDX-License-Identifier: GPL-3.0-or-later
"""What cleaning needs to know: the same for the sidebar's section and for the operators."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

import math

import bpy

from ..clean.foot_lock import BLEND

_RESULTS = (
    (
        "ACTION",
        "New Action",
        "The cleaned motion becomes the action. The old one is kept, NLA tracks are muted",
    ),
    (
        "LAYER",
        "New NLA Layer",
        "The cleaned motion goes on a track above all others: mute it to go back",
    ),
)
_SURFACES = (
    ("AUTO", "Automatic", "The scene's points if the people stand on them, otherwise the level floor at height 0"),
    ("CLOUD", "Scene Points", "The scene's points, with stairs and slopes, however well they were seen"),
    ("FLOOR", "Level Floor", "The plane at height 0; the scene's points are not asked"),
)
_FILLINGS = (
    ("INBETWEEN", "In-Between", "Come to rest after the person was last seen, and go over smoothly to the next pose"),
    ("HOLD", "Hold", "Stay in the last pose, until shortly before the person is seen again"),
)


class ResultInput:
    """What becomes of the cleaned motion."""

    result: bpy.props.EnumProperty(
        name="Result", description="Where the cleaned motion goes. Nothing is overwritten", items=_RESULTS
    )


class SmoothInputs:
    """Properties of smoothing."""

    cutoff: bpy.props.FloatProperty(
        name="Cut-Off (Hz)",
        description="What moves faster than so many times a second is taken out: 6 keeps a fast walk crisp, "
        "2 leaves slow gestures only",
        default=6.0,
        min=0.1,
        max=60.0,
    )
    keep_contacts: bpy.props.BoolProperty(
        name="Keep Standing Feet",
        description="Bend the legs so that standing feet stay where they stood; otherwise they drift with the body",
        default=True,
    )


class BlendInput:
    """How quickly feet are drawn to their places."""

    blend: bpy.props.FloatProperty(
        name="Blend",
        description="Seconds in which a foot is drawn to where it will stand, and let go again. "
        "Shorter changes less of the steps, but feet may jump",
        default=BLEND,
        min=0.0,
        max=2.0,
        subtype="TIME_ABSOLUTE",
    )


class SurfaceInput:
    """What feet stand on."""

    surface: bpy.props.EnumProperty(name="Surface", description="What standing feet rest on", items=_SURFACES)


class DriftInputs:
    """Properties of removing drift."""

    heights: bpy.props.BoolProperty(
        name="Heights Too",
        description="Bring standing people slowly level with the surface; otherwise only their places are corrected",
        default=True,
    )


class FillInputs:
    """Properties of filling gaps."""

    filling: bpy.props.EnumProperty(name="Filling", description="What people do while they are hidden", items=_FILLINGS)
    confidence: bpy.props.FloatProperty(
        name="Unsure Below",
        description="Frames that the solver is less sure of count as hidden too; 0 for those only in which nobody saw "
        "the person",
        default=0.0,
        min=0.0,
        max=1.0,
        subtype="FACTOR",
    )


class KeyInputs:
    """Properties of key reduction."""

    distance: bpy.props.FloatProperty(
        name="Joints Within",
        description="No joint leaves its place by more, in any frame. More leaves fewer keys",
        default=0.001,
        min=0.00001,
        max=0.1,
        precision=4,
        step=0.1,
        subtype="DISTANCE",
    )
    angle: bpy.props.FloatProperty(
        name="Bones Within",
        description="No bone turns away by more, in any frame. More leaves fewer keys",
        default=math.radians(0.1),
        min=math.radians(0.001),
        max=math.radians(10.0),
        precision=3,
        subtype="ANGLE",
    )


class CleanSettings(
    ResultInput, SmoothInputs, BlendInput, SurfaceInput, DriftInputs, FillInputs, KeyInputs, bpy.types.PropertyGroup
):
    """The sidebar's Clean section."""
