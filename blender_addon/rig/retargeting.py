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
from ..retarget.limb_ik import chain_of, pole_directions
from ..retarget.options import Options
from ..retarget.rest import BACK, stands
from ..retarget.roles import NEEDED, ROOT
from ..retarget.root_policy import root_of
from ..retarget.scene import Outcome, retarget_scene
from ..retarget.skeleton import Motion, Skeleton, carried_axes
from ..retarget.transfer import leg_length
from ..retarget.turning import turns_of
from ..scene_import.actions import Curves
from ..scene_import.armature import CONFIDENCE, CONTACTS, EVIDENCE, PRESENT_FROM, PRESENT_UNTIL
from ..scene_import.presence import PRESENT, hide_absent_body
from .controls import Controls, controls_of, switch_curves
from .copying import copy_rig, remove_rig
from .evidence import evidence_curves, read_evidence, says_contacts
from .ground import ground_under
from .reading import read_motion, read_skeleton
from .writing import check_writable, write_motion

Array = NDArray[np.float64]

# Legs of other length, metres, are hardly meant so.
_SHORTEST_LEG, _LONGEST_LEG = 0.15, 4.0
# Rigs that constraints have a say in are looked at in so many frames, and farther off than this is told; metres.
_LOOKS, _STRAYS = 5, 0.01


PLAYS = "plays_person"
"""Custom property of copies and of actions that retargeting makes: the name of the person."""


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
    controls = [controls_of(role.rig, role.rig_map, options.drive, role.person.data.bones.keys()) for role in roles]
    for role, handles in zip(roles, controls, strict=True):
        _check_keyable(role, handles)
    frames = frames_of([role.person for role in roles])
    notes: list[str] = []
    actors = [_actor(role, handles, frames, notes) for role, handles in zip(roles, controls, strict=True)]
    outcome = retarget_scene(actors, options, _ground(roles[0].person, actors), progress)
    rigs = _shown(roles, controls, actors, outcome.motions, frames)
    for rig, handles, actor, motion in zip(rigs, controls, actors, outcome.motions, strict=True):
        if handles.tried:
            notes += _strayed(rig, actor, motion, frames)
    return Retargeted(rigs, outcome, tuple(notes))


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
        if role.rig == role.person and not role.copied:
            raise UserError(f"'{role.rig.name}' is the person and the rig: choose another rig, or copies of it")
    several = [rig.name for rig, count in Counter(r.rig for r in roles if not r.copied).items() if count > 1]
    if several:
        raise UserError(f"'{several[0]}' cannot play several people: let it be copied, or give everybody a rig")


def _check_keyable(role: Role, controls: Controls) -> None:
    """Raise UserError unless the rig, or a copy of it, can be keyed: before the long reckoning."""
    if not role.copied:
        check_writable(role.rig, controls.keyed)
        return
    trial = copy_rig(role.rig, _copy_name(role), with_children=False)
    try:
        check_writable(trial, controls.keyed)
    finally:
        remove_rig(trial)


def _copy_name(role: Role) -> str:
    return f"{role.rig.name} {role.person.name}"


def _actor(role: Role, controls: Controls, frames: Array, notes: list[str]) -> Actor:
    person = read_skeleton(role.person)
    motion = read_motion(role.person, person, frames)
    evidence = read_evidence(role.person, frames)
    contacts = evidence.contacts
    # A take in which nobody ever stands tells nothing of contacts, as motions of other makers.
    if not (says_contacts(role.person) and contacts.any()):
        contacts = detect_contacts(person, role.person_map, motion)
        notes.append(f"'{role.person.name}' does not say when feet stand: taken from how low and slow they are")
    body, body_map = joined(controls.skeleton, role.rig_map)
    notes += _oddities(role.person.name, person, role.person_map) + _oddities(role.rig.name, body, body_map)
    return Actor(role.person.name, person, role.person_map, motion, contacts, body, body_map, evidence.present)


def _oddities(name: str, skeleton: Skeleton, bone_map: BoneMap) -> list[str]:
    """Notes on what makes a skeleton unlike a body."""
    notes = []
    if not stands(skeleton, bone_map):
        notes.append(f"'{name}' does not rest standing: limbs may point elsewhere; make a T-pose its rest pose first")
    leg = leg_length(skeleton, bone_map)
    if not _SHORTEST_LEG < leg < _LONGEST_LEG:
        notes.append(f"the legs of '{name}' are {leg:.2f} m long: its file may be in other units, scale the armature")
    return notes


def _ground(person: bpy.types.Object, actors: Sequence[Actor]) -> Ground:
    return ground_under(person, np.concatenate([standing_soles(actor) for actor in actors]))


def _shown(
    roles: Sequence[Role],
    controls: Sequence[Controls],
    actors: Sequence[Actor],
    motions: Sequence[Motion],
    frames: Array,
) -> tuple[bpy.types.Object, ...]:
    """Key the rigs; on an error take everything back."""
    rigs, copies = [], []
    actions = set(bpy.data.actions)
    playing = {role.rig: _playing(role.rig) for role in roles if not role.copied}
    try:
        for role, handles, actor, motion in zip(roles, controls, actors, motions, strict=True):
            rig = role.rig
            if role.copied:
                rig = copy_rig(role.rig, _copy_name(role))
                copies.append(rig)
                rig[PLAYS] = role.person.name
            known = _pass_on(role.person, rig, frames) if role.copied else []
            _key(rig, f"{role.person.name} on {role.rig.name}", handles, actor, motion, frames, known)
            rig.animation_data.action[PLAYS] = role.person.name
            rigs.append(rig)
    except BaseException:
        for copy in copies:
            remove_rig(copy)
        for rig, former in playing.items():
            _play(rig, *former)
        for action in set(bpy.data.actions) - actions:
            bpy.data.actions.remove(action)
        raise
    return tuple(rigs)


def _playing(rig: Any) -> tuple[Any, Any]:
    """A rig's action and its slot in it, which Blender before 4.4 does not have."""
    animation = rig.animation_data
    return (animation.action, getattr(animation, "action_slot", None)) if animation else (None, None)


def _play(rig: Any, action: Any, slot: Any) -> None:
    if rig.animation_data is not None:
        rig.animation_data.action = action
        if slot is not None:
            rig.animation_data.action_slot = slot


def _pass_on(person: Any, copy: Any, frames: Array) -> list[Curves]:
    """Let a copy know what its person knows: when feet stand, when the body is there; and hide it while it is not."""
    for name in (EVIDENCE, PRESENT, PRESENT_FROM, PRESENT_UNTIL, *CONTACTS, CONFIDENCE):
        if name in person:
            copy[name] = person[name]
    evidence = read_evidence(person, frames)
    if not evidence.present.all():
        for skin in copy.children_recursive:
            hide_absent_body(skin, copy)
    return evidence_curves(copy, evidence)


def _key(
    rig: bpy.types.Object,
    name: str,
    controls: Controls,
    actor: Actor,
    motion: Motion,
    frames: Array,
    known: Sequence[Curves],
) -> None:
    skeleton = controls.skeleton
    shown = reordered(motion, actor.target, skeleton)
    _place_poles(controls, actor, motion, shown)
    root = root_of(skeleton, actor.target_map)
    moved = [actor.target_map.needed("hips"), *([skeleton.names[root]] if root is not None else [])]
    others = [*switch_curves(rig, controls.switches, frames), *known]
    write_motion(rig, skeleton, shown, name, controls.keyed, frames, moved, others)


def _place_poles(controls: Controls, actor: Actor, motion: Motion, shown: Motion) -> None:
    """Put poles where knees and elbows point, as far from these as the upper bone is long."""
    turns = turns_of(actor.target, actor.target_map, motion)
    for pole in controls.poles:
        side, _, upper = pole.role.partition("_")
        limbs = ("upper_arm", "forearm", "hand") if upper == "upper_arm" else ("thigh", "shin", "foot")
        chain = chain_of(actor.target, actor.target_map, side, limbs)
        if chain is None:
            continue
        limb = chain.limb(motion)
        bends_to = turns[:, chain.upper, :, BACK] * (1 if upper == "upper_arm" else -1)
        length = np.linalg.norm(limb.middle - limb.start, axis=-1, keepdims=True)
        bone = controls.skeleton.index(pole.bone)
        shown.heads[:, bone] = limb.middle + length * pole_directions(limb, bends_to)
        shown.rotations[:, bone] = carried_axes(controls.skeleton, shown.rotations, bone)


def _strayed(rig: bpy.types.Object, actor: Actor, motion: Motion, frames: Array) -> list[str]:
    """A note when constraints hold a rig elsewhere than its keys would have it, in a few frames."""
    some = np.unique(np.linspace(0, len(frames) - 1, _LOOKS).astype(int))
    skeleton = read_skeleton(rig)
    seen = read_motion(rig, skeleton, frames[some])
    names = [name for role, name in actor.target_map.bones if role != ROOT]
    ours = seen.heads[:, [skeleton.index(name) for name in names]]
    away = np.linalg.norm(ours - motion.heads[some][:, [actor.target.index(name) for name in names]], axis=-1).max(0)
    if away.max() < _STRAYS:
        return []
    worst = names[int(np.argmax(away))]
    return [f"constraints of '{rig.name}' hold '{worst}' up to {100 * away.max():.0f} cm from where it should be"]


def _spoken(parts: Sequence[str]) -> str:
    words = [f"the {part.replace('_', ' ')}" for part in parts[:3]]
    return ", ".join(words) + (f" and {len(parts) - 3} more" if len(parts) > 3 else "")
