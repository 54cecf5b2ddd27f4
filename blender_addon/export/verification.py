# SPDX-License-Identifier: GPL-3.0-or-later
"""Read a written file back as an engine would, and compare it with the user's scene."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..rig.reading import read_motion, read_skeleton
from .performance import Performance, Timing
from .profiles import Profile
from .staging import bones_in_file, main_root, root_path
from .temporary import temporary_scene

Array = NDArray[np.float64]

TOLERANCE_M = 1e-3
"""How far a joint may be off in a file, metres."""
_SCALE_TOLERANCE = 1e-3
_MOST_FRAMES = 12
_IMPORT_RATE = 30


@dataclass(frozen=True)
class Check:
    """What a file holds of one character, beside what it should.

    Attributes:
        character: name of the user's armature.
        file: name of the file.
        bones: number of bones in the file.
        bones_wanted: number it should have.
        scale: size in the file over size in the scene, both in metres.
        root_error_m: farthest that the uppermost moving bone is off its path, metres.
        joint_error_m: farthest that any joint is off at the frames looked at, metres.
        action: name of the motion in the file.
        problems: plain sentences; empty when all is well.
    """

    character: str
    file: str
    bones: int
    bones_wanted: int
    scale: float
    root_error_m: float
    joint_error_m: float
    action: str
    problems: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether the file holds what it should."""
        return not self.problems


def verify(
    context: bpy.types.Context,
    path: Path,
    nodes: Sequence[str],
    performances: Sequence[Performance],
    timing: Timing,
    profile: Profile,
) -> tuple[Check, ...]:
    """Import a file into a temporary scene and compare all its characters; nothing of it stays.

    Args:
        context: the user's.
        path: the file.
        nodes: names of the armatures in the file, one for each performance.
        performances: what should be in it.
        timing: the file's frames.
        profile: by which it was written.
    """
    with temporary_scene(context, path.stem) as scene:
        scene.render.fps, scene.render.fps_base = _IMPORT_RATE, 1.0
        _import(path)
        armatures = {obj.name: obj for obj in scene.objects if obj.type == "ARMATURE"}
        for armature in armatures.values():
            _disconnect(context, armature)
        places = np.unique(np.linspace(0, len(timing.frames) - 1, _MOST_FRAMES).round().astype(int))
        return _without_strangers(
            tuple(
                _check(path.name, armatures.get(node), performance, _frames(timing, places, scene), places, profile)
                for node, performance in zip(nodes, performances, strict=True)
            ),
            [armatures[node] for node in nodes if node in armatures],
        )


def _import(path: Path) -> None:
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path), bone_heuristic="TEMPERANCE")
    else:
        # By default the importer moves everything by a frame.
        bpy.ops.import_scene.fbx(filepath=str(path), anim_offset=0.0)


def _disconnect(context: bpy.types.Context, armature: bpy.types.Object) -> None:
    """Let bones leave their parents as the file says: the FBX importer ties those that touch at rest together."""
    context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in armature.data.edit_bones:
        bone.use_connect = False
    bpy.ops.object.mode_set(mode="OBJECT")


def _frames(timing: Timing, places: NDArray[np.int_], scene: bpy.types.Scene) -> Array:
    """Scene frames after the import at which the file's frames lie: both importers count whole frames a second."""
    return timing.frames[places] / float(timing.rate) * scene.render.fps


def _check(
    file: str,
    armature: bpy.types.Object | None,
    performance: Performance,
    frames: Array,
    places: NDArray[np.int_],
    profile: Profile,
) -> Check:
    wanted = bones_in_file(performance, profile)
    nothing = Check(performance.name, file, 0, wanted.count, 0.0, np.inf, np.inf, "", ("is not in the file",))
    if armature is None:
        return nothing
    try:
        skeleton = read_skeleton(armature)
    except UserError as error:
        return replace(nothing, problems=(str(error),))
    missing = [name for name in (*wanted.names, wanted.root) if name and name not in skeleton.names]
    if missing:
        return replace(nothing, bones=len(skeleton.names), problems=(f"lacks the bone {missing[0]}",))
    order = [skeleton.index(name) for name in wanted.names]
    motion = read_motion(armature, skeleton, frames)
    errors = np.linalg.norm(motion.heads[:, order] - performance.motion.heads[places], axis=-1)
    root_errors = errors[:, main_root(performance.skeleton)]
    if wanted.root:
        path = root_path(performance, profile)[places]
        root_errors = np.linalg.norm(motion.heads[:, skeleton.index(wanted.root)] - path, axis=-1)
    action = armature.animation_data.action if armature.animation_data else None
    check = Check(
        character=performance.name,
        file=file,
        bones=len(skeleton.names),
        bones_wanted=wanted.count,
        scale=_size(skeleton.heads[order]) / max(_size(performance.skeleton.heads), 1e-9),
        root_error_m=float(root_errors.max()),
        joint_error_m=float(errors.max()),
        action=action.name if action else "",
        problems=(),
    )
    return replace(check, problems=_problems(check))


def _problems(check: Check) -> tuple[str, ...]:
    found = []
    if check.bones != check.bones_wanted:
        found.append(f"has {check.bones} bones instead of {check.bones_wanted}")
    if abs(check.scale - 1) > _SCALE_TOLERANCE:
        found.append(f"is {check.scale:.4g} times as large")
    if check.root_error_m > TOLERANCE_M:
        found.append(f"has its root {1000 * check.root_error_m:.3g} mm off its path")
    if check.joint_error_m > TOLERANCE_M:
        found.append(f"has joints {1000 * check.joint_error_m:.3g} mm off")
    if not check.action:
        found.append("has no motion")
    return tuple(found)


def _without_strangers(checks: tuple[Check, ...], armatures: Sequence[bpy.types.Object]) -> tuple[Check, ...]:
    """Say where two characters share one motion, as exporters like to write it."""
    motions = [_motion_id(armature) for armature in armatures]
    if len(set(motions)) == len(motions):
        return checks
    return tuple(replace(check, problems=(*check.problems, "shares its motion with another")) for check in checks)


def _motion_id(armature: bpy.types.Object) -> tuple[str, int]:
    animation = armature.animation_data
    if animation is None or animation.action is None:
        return armature.name, -1
    return animation.action.name, getattr(animation, "action_slot_handle", 0)


def _size(heads: Array) -> float:
    """Root mean square distance of joints from their middle, metres."""
    return float(np.sqrt(np.mean(np.sum((heads - heads.mean(axis=0)) ** 2, axis=-1))))
