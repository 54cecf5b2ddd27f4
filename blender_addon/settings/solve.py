# SPDX-License-Identifier: GPL-3.0-or-later
"""What a solve needs to know: the same for the sidebar's section and for the operator."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from pathlib import Path
from typing import Any

import bpy

from core_solver.errors import UserError

from ..solving.request import SolveRequest

_PRESETS = (
    ("fast", "Fast", "For nearly everything"),
    ("exact", "Exact", "Every pixel counts from the beginning, with more iterations: takes about twice as long"),
    ("paper", "As Published", "The method as it was published, for comparison: takes about ten times as long"),
)
_TURNS = (
    ("0", "As It Is", "The video stands upright"),
    ("90", "90 Degrees", "Turn it clockwise by a quarter"),
    ("180", "180 Degrees", "Turn it upside down"),
    ("270", "270 Degrees", "Turn it anticlockwise by a quarter"),
)
_DEVICES = (
    ("auto", "Automatic", "An NVIDIA card if the solver's Python can use one"),
    ("cpu", "Processor", "The processor alone"),
    ("cuda", "NVIDIA Card", "An NVIDIA card, or an error"),
)


class SolveInputs:
    """Properties that the section and the operator share."""

    video: bpy.props.StringProperty(
        name="Video", description="Footage of one camera that does not move", subtype="FILE_PATH"
    )
    output: bpy.props.StringProperty(
        name="Take",
        description="Where the result goes (.npz); empty for the video's name beside it. "
        "A take that is there already is replaced when the new one is complete",
        subtype="FILE_PATH",
    )
    preset: bpy.props.EnumProperty(name="Preset", description="How to solve", items=_PRESETS)
    camera: bpy.props.StringProperty(
        name="Calibration",
        description="Camera file: our JSON, 3x3 text, OpenCV YAML or QTM. The best thing you can give",
        subtype="FILE_PATH",
    )
    camera_name: bpy.props.StringProperty(
        name="Camera", description="Which camera of the calibration, when the file holds several"
    )
    fov_degrees: bpy.props.FloatProperty(
        name="Field of View",
        description="Degrees along the longer side of the picture; 0 when unknown: "
        "it is then estimated, and all distances scale with the error",
        min=0.0,
        max=150.0,
        precision=1,
    )
    people: bpy.props.IntProperty(
        name="People", description="Keep so many, those seen best, and leave bystanders out; 0 keeps everybody", min=0
    )
    start_s: bpy.props.FloatProperty(name="Start", description="First second of the video to solve", min=0.0)
    end_s: bpy.props.FloatProperty(
        name="End", description="Second of the video to stop at; 0 for the whole video", min=0.0
    )
    every: bpy.props.IntProperty(
        name="Every Nth Frame", description="Leave frames out: faster, and quick motion is lost", min=1, default=1
    )
    depth: bpy.props.StringProperty(
        name="Depth Network",
        description="Disparity network (.onnx), or a folder with one in several sizes. "
        "Without one the scene is a plane through people's feet",
        subtype="FILE_PATH",
    )
    rotate: bpy.props.EnumProperty(
        name="Rotate",
        description="For a video that lies on its side: turns the picture before it is solved",
        items=_TURNS,
    )
    device: bpy.props.EnumProperty(name="Device", description="What computes", items=_DEVICES)
    resume: bpy.props.BoolProperty(
        name="Resume",
        description="Go on from what an earlier solve of this video has kept beside the take; "
        "quick when only solving choices have changed",
    )
    import_result: bpy.props.BoolProperty(
        name="Import When Done", description="Bring the take into this scene at the end", default=True
    )


class SolveSettings(SolveInputs, bpy.types.PropertyGroup):
    """The sidebar's Solve section."""


def request_of(inputs: Any) -> SolveRequest:
    """The request that settings or an operator describe.

    Raises:
        UserError: it cannot be carried out; says why.
    """
    if not inputs.video:
        raise UserError("no video is chosen: choose one")
    request = SolveRequest(
        video=Path(_absolute(inputs.video)),
        output=Path(_absolute(inputs.output)) if inputs.output else None,
        preset=inputs.preset,
        camera=_absolute(inputs.camera),
        camera_name=inputs.camera_name,
        fov_degrees=inputs.fov_degrees,
        people=inputs.people,
        start_s=inputs.start_s,
        end_s=inputs.end_s,
        every=inputs.every,
        depth=_absolute(inputs.depth),
        rotate=int(inputs.rotate),
        device=inputs.device,
        resume=inputs.resume,
        offline=not bpy.app.online_access,
    )
    request.check()
    return request


def copy_inputs(source: Any, target: Any) -> None:
    """Carry the section's choices over to the operator's properties."""
    for name in SolveInputs.__annotations__:
        setattr(target, name, getattr(source, name))


def _absolute(path: str) -> str:
    """The path without Blender's `//`, which stands for the folder of the .blend file."""
    return bpy.path.abspath(path)
