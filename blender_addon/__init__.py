# SPDX-License-Identifier: GPL-3.0-or-later
"""Scene-Aware Mocap in Blender: brings a take in as people, camera, footage and scene. Registration only."""

import bpy

from . import translations
from .batching.registration import register_command, unregister_command
from .operators.bone_map import DetectBones, LoadBoneMap, LoadVrmMap, MendBoneMap, SaveBoneMap
from .operators.clean import BakeMotion, FillGaps, LockFeet, ReduceKeys, RemoveDrift, SmoothMotion, SnapFeet
from .operators.export import Export
from .operators.identities import MergePeople, SplitPerson, SwapPeople
from .operators.import_take import ImportTake, TakeDrop, draw_import_entry
from .operators.retarget import CastEntry, Retarget
from .operators.sample import LoadSampleRig, LoadSampleTake
from .operators.solve_video import CancelSolve, SolveVideo
from .panels.bone_map import BoneMapPanel, BoneMapPresetsMenu
from .panels.clean import CleanPanel
from .panels.export_section import ExportPanel
from .panels.import_section import ImportPanel
from .panels.retarget import RetargetPanel
from .panels.samples import SamplesPanel
from .panels.solve import SolvePanel
from .preferences import CheckSolver, MocapPreferences
from .settings.bone_map import BoneMapSettings, ProblemEntry, RigMap, RoleEntry
from .settings.clean import CleanSettings
from .settings.export import CheckRow, ExportSettings
from .settings.retarget import MeasureRow, RetargetSettings
from .settings.solve import SolveSettings
from .solving import watch

# In the order in which Blender shall know them: property groups before what points to them, parents before children.
_CLASSES = (
    MocapPreferences,
    CheckSolver,
    SolveSettings,
    SolveVideo,
    CancelSolve,
    SolvePanel,
    ImportTake,
    TakeDrop,
    LoadSampleTake,
    LoadSampleRig,
    ImportPanel,
    SamplesPanel,
    CleanSettings,
    SmoothMotion,
    LockFeet,
    SnapFeet,
    RemoveDrift,
    FillGaps,
    ReduceKeys,
    BakeMotion,
    SwapPeople,
    MergePeople,
    SplitPerson,
    CleanPanel,
    MeasureRow,
    RetargetSettings,
    CastEntry,
    Retarget,
    RetargetPanel,
    RoleEntry,
    ProblemEntry,
    RigMap,
    BoneMapSettings,
    DetectBones,
    LoadBoneMap,
    LoadVrmMap,
    MendBoneMap,
    SaveBoneMap,
    BoneMapPresetsMenu,
    BoneMapPanel,
    CheckRow,
    ExportSettings,
    Export,
    ExportPanel,
)
# Settings of the sidebar's sections: the type they hang on, the name there, and the property group.
_SETTINGS: tuple[tuple[type, str, type], ...] = (
    (bpy.types.Scene, "mocap_solve", SolveSettings),
    (bpy.types.Scene, "mocap_clean", CleanSettings),
    (bpy.types.Scene, "mocap_retarget", RetargetSettings),
    (bpy.types.Scene, "mocap_bone_map", BoneMapSettings),
    (bpy.types.Scene, "mocap_export", ExportSettings),
)


def register() -> None:
    for cls in _CLASSES:
        bpy.utils.register_class(cls)
    for owner, name, group in _SETTINGS:
        setattr(owner, name, bpy.props.PointerProperty(type=group))
    bpy.types.TOPBAR_MT_file_import.append(draw_import_entry)
    register_command()
    translations.register()


def unregister() -> None:
    watch.stop()
    translations.unregister()
    unregister_command()
    bpy.types.TOPBAR_MT_file_import.remove(draw_import_entry)
    for owner, name, _ in reversed(_SETTINGS):
        delattr(owner, name)
    for cls in reversed(_CLASSES):
        bpy.utils.unregister_class(cls)
