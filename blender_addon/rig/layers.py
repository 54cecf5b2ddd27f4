# SPDX-License-Identifier: GPL-3.0-or-later
"""Cleaned motion beside what was there: a new action, or a new layer above the others; nothing is overwritten."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Literal

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..clean.performance import Performance
from ..retarget.bone_map import TAKE_MAP, BoneMap
from ..retarget.contacts import detect_contacts
from ..retarget.skeleton import Skeleton
from ..scene_import.strips import push_down
from .curves import curves_of
from .evidence import evidence_curves, read_evidence, says_contacts
from .maps import map_of
from .reading import read_motion, read_skeleton
from .writing import check_writable, write_motion

Array = NDArray[np.float64]
Result = Literal["ACTION", "LAYER"]


def read_performance(context: bpy.types.Context, obj: bpy.types.Object, frames: Array) -> Performance:
    """What an armature does, as it is played now.

    Args:
        context: of the scene.
        obj: the armature.
        frames: (T,) scene frames.
    """
    skeleton = read_skeleton(obj)
    bone_map = _bone_map(context, obj)
    strip = _ruling_strip(obj)
    if strip is None:
        motion = read_motion(obj, skeleton, frames)
    else:
        with _only(obj, strip):
            motion = read_motion(obj, skeleton, frames)
    return Performance(obj.name, skeleton, bone_map, motion, read_evidence(obj, frames))


def with_contacts(obj: bpy.types.Object, performance: Performance) -> Performance:
    """A performance that knows when its feet stand; for armatures that do not say, seen from how low and slow they are.

    Raises:
        UserError: the take says that no foot ever stands.
    """
    evidence = performance.evidence
    if not says_contacts(obj):
        contacts = detect_contacts(performance.skeleton, performance.bone_map, performance.motion)
    elif (evidence.contacts >= 0.5).any():
        return performance
    else:
        raise UserError(f"the take has no foot contacts for '{obj.name}': solve it again, or leave this person out")
    known = type(evidence)(contacts, evidence.seen, evidence.present, evidence.confidence)
    return Performance(performance.name, performance.skeleton, performance.bone_map, performance.motion, known)


def check_layerable(obj: bpy.types.Object) -> None:
    """Raise UserError unless an armature can be given a new action or layer."""
    check_writable(obj, [bone.name for bone in obj.pose.bones] if obj.type == "ARMATURE" else [])
    locked = [track.name for track in obj.animation_data.nla_tracks if track.lock] if obj.animation_data else []
    if locked:
        raise UserError(f"the NLA track '{locked[0]}' of '{obj.name}' is locked: unlock it in the NLA editor first")


def write_performance(
    obj: bpy.types.Object, performance: Performance, label: str, frames: Array, result: Result
) -> bpy.types.Action:
    """Show a changed performance.

    Args:
        obj: the armature, as `check_layerable` allows.
        performance: of it.
        label: what was done, for the new action's name.
        frames: (T,) scene frames.
        result: "ACTION" makes a new action the active one, tracks below fall silent; "LAYER" puts it on a new NLA
            track above all others.

    Returns:
        The new action.
    """
    put_away(obj, result)
    action = write_motion(
        obj,
        performance.skeleton,
        performance.motion,
        f"{obj.name} {label}",
        performance.skeleton.names,
        frames,
        _travelling(performance.skeleton),
        evidence_curves(obj, performance.evidence),
    )
    bring_up(obj, result)
    return action


def put_away(obj: bpy.types.Object, result: Result) -> None:
    """Put away what plays now, before a new action takes its place."""
    animation = obj.animation_data
    if animation is None or animation.action is None:
        return
    if result == "LAYER":
        push_down(obj, round(animation.action.frame_range[0]))
    else:
        animation.action.use_fake_user = True


def bring_up(obj: bpy.types.Object, result: Result) -> None:
    """Let a new active action play: alone, or as the topmost layer."""
    animation = obj.animation_data
    if result == "LAYER":
        push_down(obj, round(animation.action.frame_range[0]))
    else:
        for track in animation.nla_tracks:
            track.mute = True


def _travelling(skeleton: Skeleton) -> list[str]:
    return [name for name, parent in zip(skeleton.names, skeleton.parents, strict=True) if parent < 0]


def _bone_map(context: bpy.types.Context, obj: Any) -> BoneMap:
    if all(name in obj.data.bones for _, name in TAKE_MAP.bones):
        return TAKE_MAP
    return map_of(context, obj, "fk")


# --- layers of ours -------------------------------------------------------------------------------------------------


def _ruling_strip(obj: Any) -> Any:
    """The strip on the topmost playing track, if it alone says how all bones move."""
    animation = obj.animation_data
    if animation is None or animation.action is not None or animation.use_tweak_mode:
        return None
    playing = [track for track in animation.nla_tracks if not track.mute]
    if not playing or any(track.is_solo for track in playing) or len(playing[-1].strips) != 1:
        return None
    strip = playing[-1].strips[0]
    return strip if _plays_plainly(strip) and _keys_all(obj, strip) else None


def _plays_plainly(strip: Any) -> bool:
    return (
        not strip.mute
        and strip.blend_type == "REPLACE"
        and strip.extrapolation == "HOLD"
        and (strip.scale, strip.repeat) == (1.0, 1.0)
        and not (strip.use_animated_influence or strip.use_animated_time or strip.use_reverse)
        and (strip.blend_in, strip.blend_out) == (0.0, 0.0)
        and strip.frame_start == strip.action_frame_start
        and strip.frame_end == strip.action_frame_end
    )


def _keys_all(obj: Any, strip: Any) -> bool:
    paths = {path for path, _ in curves_of(strip)}
    starts = (bone.path_from_id() + ".rotation_" for bone in obj.pose.bones)
    return all(any(path.startswith(start) for path in paths) for start in starts)


@contextmanager
def _only(obj: Any, strip: Any) -> Iterator[None]:
    """Play one strip's action as the active one, and nothing else, for a moment: its curves can then be read."""
    animation = obj.animation_data
    muted = [track.mute for track in animation.nla_tracks]
    try:
        for track in animation.nla_tracks:
            track.mute = True
        animation.action = strip.action
        if hasattr(strip, "action_slot"):
            animation.action_slot = strip.action_slot
        yield
    finally:
        animation.action = None
        for track, mute in zip(animation.nla_tracks, muted, strict=True):
            track.mute = mute


def people_of(context: bpy.types.Context, names: Sequence[str]) -> list[bpy.types.Object]:
    """The people to be cleaned: those named, else those selected or whose bodies are, else all of the scene.

    Raises:
        UserError: a name is unknown, or there is nobody.
    """
    if names:
        unknown = [name for name in names if name not in context.scene.objects]
        if unknown:
            raise UserError(f"there is nobody called '{unknown[0]}' in this scene: check the name")
        return [context.scene.objects[name] for name in names]
    selected = [obj for obj in context.view_layer.objects if obj.select_get()]
    moving = [obj if obj.type == "ARMATURE" else obj.find_armature() for obj in selected]
    chosen = list(dict.fromkeys(obj for obj in moving if obj is not None))
    chosen = chosen or [obj for obj in context.scene.objects if obj.type == "ARMATURE" and "person_id" in obj]
    if not chosen:
        raise UserError("no armature to clean: import a take, or select the armatures to be cleaned")
    return chosen
