# SPDX-License-Identifier: GPL-3.0-or-later
"""File > Import > Scene-Aware Mocap (.npz), and takes dropped onto the window."""

# Blender declares properties as annotations.
# pyright: reportInvalidTypeForm=false

from pathlib import Path
from typing import Any

import bpy
from bpy_extras.io_utils import ImportHelper

from core_solver.errors import UserError

from ..scene_import.clock import FIRST_FRAME
from ..scene_import.motion_files import read_motion_file
from ..scene_import.take_import import ImportOptions, chosen_people, import_take
from ..scene_import.world import Anchor, Origin

rpt_ = bpy.app.translations.pgettext_rpt


class ImportTake(bpy.types.Operator, ImportHelper):
    bl_idname = "import_scene.scene_aware_mocap"
    bl_label = "Import Scene-Aware Mocap (.npz)"
    bl_description = (
        "Bring in a take: every person in one metric scene, the camera over its footage, and the scene's points. "
        "Also reads one person's SMPL motion as AMASS stores it"
    )
    bl_options = {"REGISTER", "UNDO"}  # noqa: RUF012 - Blender reads this class attribute

    filename_ext = ".npz"
    filter_glob: bpy.props.StringProperty(default="*.npz", options={"HIDDEN"})
    # Where several files were chosen or dropped; `filepath` alone is enough for one.
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})

    people: bpy.props.StringProperty(
        name="People",
        description="Names or ids of the people to bring in, with commas between; empty for everybody",
    )
    body: bpy.props.BoolProperty(
        name="Bodies", description="Each person's skinned mesh; without it armatures alone come in", default=True
    )
    hide_absent: bpy.props.BoolProperty(
        name="Hide When Away",
        description="Hide people before they are first seen and after they are last seen. GLB and FBX hide nobody: "
        "there such a person stands still, and present_from_s and present_until_s tell a game when to show them",
        default=True,
    )
    cloud: bpy.props.BoolProperty(name="Scene Points", description="The static scene as coloured points", default=True)
    density: bpy.props.FloatProperty(
        name="Density",
        description="Share of the scene's points to bring in: fewer make the viewport faster",
        subtype="FACTOR",
        min=0.001,
        max=1.0,
        default=1.0,
    )
    camera: bpy.props.BoolProperty(
        name="Camera",
        description="The camera that matches the video; becomes the scene's camera and sets the picture's size",
        default=True,
    )
    behind: bpy.props.BoolProperty(
        name="Footage behind It", description="Show the video behind the camera's view", default=True
    )
    footage: bpy.props.StringProperty(
        name="Footage",
        description="The video or the folder it is in; empty to look beside the take",
        subtype="FILE_PATH",
    )
    anchor: bpy.props.EnumProperty(
        name="Origin",
        description="What lies at the origin of the world",
        items=(
            (Anchor.CAMERA.name, "Under the Camera", "The ground under the camera; all takes of a camera agree"),
            (Anchor.PERSON.name, "Under the First Person", "The ground under the first person, where first seen"),
        ),
    )
    turn: bpy.props.FloatProperty(
        name="Turn", description="Turns the take about the vertical through its origin", subtype="ANGLE"
    )
    offset: bpy.props.FloatVectorProperty(
        name="Offset",
        description="Moves the take after it was turned, so that two takes can be brought together",
        subtype="TRANSLATION",
        unit="LENGTH",
    )
    start_frame: bpy.props.IntProperty(
        name="Start Frame", description="The scene's frame that shows the take's first", default=FIRST_FRAME, min=0
    )
    rate: bpy.props.EnumProperty(
        name="Frame Rate",
        description="Which frame rate the scene has afterwards",
        items=(
            ("TAKE", "The Take's", "The scene gets the take's rate: every frame of the take is a frame of the scene"),
            ("SCENE", "The Scene's", "The scene keeps its rate, and the take is resampled to it at its true speed"),
        ),
    )
    motion: bpy.props.EnumProperty(
        name="Motion",
        description="How the motion lies in the scene",
        items=(
            ("ACTION", "Active Action", "Each person's motion is the armature's action"),
            ("STRIP", "NLA Strip", "Each person's motion is a strip of the NLA editor, to be moved and mixed there"),
        ),
    )
    markers: bpy.props.BoolProperty(
        name="Mark Hidden People",
        description="Markers on the timeline where a person was hidden from the camera and the motion is a guess",
        default=True,
    )
    shortest_hidden: bpy.props.IntProperty(
        name="From Frames", description="Shorter times hidden get no markers", default=5, min=1
    )

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        """A dropped file is known already: ask only for the options."""
        if self.directory and self.files:
            return context.window_manager.invoke_props_dialog(self)
        return ImportHelper.invoke(self, context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        options = self._options()
        try:
            paths = self._paths()
            takes = [read_motion_file(path) for path in paths]
            for take in takes:
                chosen_people(take, options.people)
        except UserError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for path, take in zip(paths, takes, strict=True):
            imported = import_take(context, take, path, options)
            for note in imported.notes:
                self.report({"WARNING"}, note)
            message = rpt_("Imported {} people of {}, frames {} to {}")
            clock = imported.clock
            self.report({"INFO"}, message.format(len(imported.armatures), path.name, clock.start, clock.end))
        return {"FINISHED"}

    def draw(self, _context: bpy.types.Context) -> None:
        layout = self.layout
        layout.use_property_split = True
        layout.use_property_decorate = False
        self._draw_group("People", ("people", "body", "hide_absent", "markers", "shortest_hidden"))
        self._draw_group("Scene", ("cloud", "density", "camera", "behind", "footage"))
        self._draw_group("Place", ("anchor", "turn", "offset"))
        self._draw_group("Time", ("start_frame", "rate", "motion"))

    def _draw_group(self, title: str, names: tuple[str, ...]) -> None:
        box = self.layout.box()
        box.label(text=title)
        for name in names:
            box.prop(self, name)

    def _paths(self) -> list[Path]:
        chosen = [Path(self.directory) / file.name for file in self.files if file.name]
        return chosen if self.directory and chosen else [Path(self.filepath)]

    def _options(self) -> ImportOptions:
        return ImportOptions(
            people=tuple(word for word in self.people.split(",") if word.strip()),
            body=self.body,
            hide_absent=self.hide_absent,
            cloud=self.cloud,
            density=self.density,
            camera=self.camera,
            behind=self.behind,
            footage=self.footage,
            origin=Origin(Anchor[self.anchor], self.turn, tuple(self.offset)),
            start=self.start_frame,
            keep_rate=self.rate == "SCENE",
            strips=self.motion == "STRIP",
            markers=self.markers,
            shortest_hidden=self.shortest_hidden,
        )


class TakeDrop(bpy.types.FileHandler):
    """Takes dropped onto a 3D view."""

    bl_idname = "IO_FH_scene_aware_mocap"
    bl_label = "Scene-Aware Mocap"
    bl_import_operator = ImportTake.bl_idname
    bl_file_extensions = ".npz"

    @classmethod
    def poll_drop(cls, context: bpy.types.Context) -> bool:
        return context.area is not None and context.area.type in {"VIEW_3D", "OUTLINER"}


def draw_import_entry(menu: Any, _context: bpy.types.Context) -> None:
    menu.layout.operator(ImportTake.bl_idname, text="Scene-Aware Mocap (.npz)")
