# SPDX-License-Identifier: GPL-3.0-or-later
"""Bring people of a Blender scene onto rigs: read everybody, reckon, key each rig anew."""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from ..retarget.actor import Actor
from ..retarget.bone_map import BoneMap
from ..retarget.contacts import detect_contacts
from ..retarget.feet import standing_soles
from ..retarget.ground import Ground
from ..retarget.joining import joined, reordered
from ..retarget.options import Options
from ..retarget.roles import NEEDED
from ..retarget.root_policy import root_of
from ..retarget.scene import Outcome, retarget_scene
from ..retarget.skeleton import Motion, Skeleton
from ..scene_import.armature import CONTACTS
from .copying import copy_rig, remove_rig
from .curves import curves_of, sample
from .ground import ground_under
from .reading import read_motion, read_skeleton
from .writing import check_writable, write_motion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Role:
    """One person and the rig that shall move so.

    Attributes:
        person: armature object that moves.
        person_map: its roles.
        rig: armature object.
        rig_map: its roles.
        copied: move a copy of the rig instead, which shares its meshes.
    """

    person: bpy.types.Object
    person_map: BoneMap
    rig: bpy.types.Object
    rig_map: BoneMap
    copied: bool = False


@dataclass(frozen=True)
class Retargeted:
    """What has been made.

    Attributes:
        rigs: armature objects that move now, in the order of the roles.
        outcome: their motions and measures.
        notes: plain sentences for the user.
    """

    rigs: tuple[bpy.types.Object, ...]
    outcome: Outcome
    notes: tuple[str, ...]


def retarget(roles: Sequence[Role], options: Options, progress: Callable[[float], None]) -> Retargeted:
    """Give rigs the motion of people, all of a scene together.

    Args:
        roles: everybody; a rig that is not copied plays one person only.
        options: what the user chose.
        progress: is told the part done, 0..1; whatever it raises ends the work with nothing changed.

    Raises:
        UserError: it cannot be done; says why. Nothing has changed then.
    """
    _check(roles)
    frames = frames_of([role.person for role in roles])
    notes: list[str] = []
    actors = [_actor(role, frames, notes) for role in roles]
    for role in roles:
        notes += _overruled(role)
    outcome = retarget_scene(actors, options, _ground(roles[0].person, actors), progress)
    return Retargeted(_shown(roles, actors, outcome.motions, frames), outcome, tuple(notes))


def frames_of(people: Sequence[bpy.types.Object]) -> Array:
    """(T,) whole scene frames from where the first of them begins to move to where the last one ends.

    Raises:
        UserError: somebody does not move at all.
    """
    ranges = [_range(person) for person in people]
    first, last = min(start for start, _ in ranges), max(stop for _, stop in ranges)
    return np.arange(np.floor(first), np.ceil(last) + 1)


def _range(person: Any) -> tuple[float, float]:
    animation = person.animation_data
    if animation is not None and animation.action is not None:
        start, stop = animation.action.frame_range
        return float(start), float(stop)
    strips = [strip for track in animation.nla_tracks for strip in track.strips] if animation else []
    if not strips:
        raise UserError(f"'{person.name}' does not move: choose an armature with an action")
    return min(strip.frame_start for strip in strips), max(strip.frame_end for strip in strips)


def _check(roles: Sequence[Role]) -> None:
    if not roles:
        raise UserError("nobody to retarget: select the people's armatures")
    for role in roles:
        for obj, bone_map in ((role.person, role.person_map), (role.rig, role.rig_map)):
            missing = [part for part in NEEDED if bone_map.bone(part) is None]
            if missing:
                raise UserError(
                    f"'{obj.name}' has no bone for {_spoken(missing)}: choose it under Bone Map, or another armature"
                )
        if not role.copied:
            check_writable(role.rig, keyed_bones(read_skeleton(role.rig), role.rig_map))
            if role.rig == role.person:
                raise UserError(f"'{role.rig.name}' is the person and the rig: choose another rig, or copies of it")
    several = [rig.name for rig, count in Counter(r.rig for r in roles if not r.copied).items() if count > 1]
    if several:
        raise UserError(f"'{several[0]}' cannot play several people: let it be copied, or give everybody a rig")


def keyed_bones(skeleton: Skeleton, bone_map: BoneMap) -> list[str]:
    """Bones that get keys: those with a role and all above them, whose pose would move them."""
    wanted = {skeleton.index(name) for _, name in bone_map.bones if name in skeleton.names}
    for bone in range(len(skeleton.names) - 1, -1, -1):
        if bone in wanted and skeleton.parents[bone] >= 0:
            wanted.add(skeleton.parents[bone])
    return [skeleton.names[bone] for bone in sorted(wanted)]


def _actor(role: Role, frames: Array, notes: list[str]) -> Actor:
    person = read_skeleton(role.person)
    motion = read_motion(role.person, person, frames)
    contacts = _contacts(role.person, frames)
    if contacts is None:
        contacts = detect_contacts(person, role.person_map, motion)
        notes.append(f"'{role.person.name}' does not say when feet stand: taken from how low and slow they are")
    return Actor(
        role.person.name, person, role.person_map, motion, contacts, *joined(read_skeleton(role.rig), role.rig_map)
    )


def _contacts(person: Any, frames: Array) -> Array | None:
    """(T, 2) as the armature's custom properties say; None for motions from elsewhere."""
    if any(name not in person for name in CONTACTS):
        return None
    curves = curves_of(person.animation_data)
    paths = [(f'["{name}"]', 0) for name in CONTACTS]
    if any(path not in curves for path in paths):
        return None
    return np.stack([sample(curves[path], frames) for path in paths], axis=1)


def _ground(person: bpy.types.Object, actors: Sequence[Actor]) -> Ground:
    return ground_under(person, np.concatenate([standing_soles(actor) for actor in actors]))


def _overruled(role: Role) -> list[str]:
    """A note when constraints will have the last word on bones that get keys."""
    ruled = [
        name
        for _, name in role.rig_map.bones
        if any(c.enabled and c.influence > 0 for c in role.rig.pose.bones[name].constraints)
    ]
    if not ruled:
        return []
    return [f"constraints of '{role.rig.name}' may overrule the motion of {', '.join(ruled[:3])}"]


def _shown(
    roles: Sequence[Role], actors: Sequence[Actor], motions: Sequence[Motion], frames: Array
) -> tuple[bpy.types.Object, ...]:
    """Key the rigs; on an error take copies back."""
    rigs, copies = [], []
    try:
        for role, actor, motion in zip(roles, actors, motions, strict=True):
            rig = role.rig
            if role.copied:
                rig = copy_rig(role.rig, f"{role.rig.name} {role.person.name}")
                copies.append(rig)
            _key(rig, role, actor, motion, frames)
            rigs.append(rig)
    except UserError:
        for copy in copies:
            remove_rig(copy)
        raise
    return tuple(rigs)


def _key(rig: bpy.types.Object, role: Role, actor: Actor, motion: Motion, frames: Array) -> None:
    skeleton = read_skeleton(rig)
    bones = keyed_bones(skeleton, actor.target_map)
    root = root_of(skeleton, actor.target_map)
    moved = [actor.target_map.needed("hips"), *([skeleton.names[root]] if root is not None else [])]
    shown = reordered(motion, actor.target, skeleton)
    write_motion(rig, skeleton, shown, f"{role.person.name} on {role.rig.name}", bones, frames, moved)


def _spoken(parts: Sequence[str]) -> str:
    words = [f"the {part.replace('_', ' ')}" for part in parts[:3]]
    return ", ".join(words) + (f" and {len(parts) - 3} more" if len(parts) > 3 else "")
