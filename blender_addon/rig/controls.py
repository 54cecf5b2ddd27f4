# SPDX-License-Identifier: GPL-3.0-or-later
"""What is keyed on a rig, and what carries it.

On rigs that are moved by controls, as Rigify makes them, Blender's constraints alone know what carries what. So it is
tried out, on a copy: each control is moved once, and what moves along with it hangs on it. Switches that choose between
kinds of controls are keyed with the motion.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec

from ..retarget.bone_map import BoneMap
from ..retarget.joining import only, rehung
from ..retarget.options import Drive
from ..retarget.roles import SIDES
from ..retarget.skeleton import Skeleton
from ..scene_import.actions import Curves
from .copying import copy_rig, remove_rig
from .reading import read_skeleton

Array = NDArray[np.float64]

# Custom properties of controls by drive. With these every control follows the one above it as bones follow parents.
_SWITCHES: dict[Drive, dict[str, float]] = {
    "fk": {"IK_FK": 1.0, "FK_limb_follow": 0.0, "neck_follow": 1.0, "head_follow": 1.0},
    "ik": {"IK_FK": 0.0, "IK_Stretch": 0.0, "pole_vector": 1.0, "neck_follow": 1.0, "head_follow": 1.0},
}
_POLES = {"thigh": "thigh_ik_target.{s}", "upper_arm": "upper_arm_ik_target.{s}"}
# Bent by the rig itself to where hands, feet and poles are.
_FOLLOWERS = ("upper_arm", "forearm", "thigh", "shin")
# How a control is moved to see what goes along: turned by 0.4 radians about a skew axis, and shifted.
_ENDS = {"forearm": "hand", "foot": "toe"}
_TRIAL = np.eye(4)
_TRIAL[:3, :3] = matrix_from_rotvec(0.4 * np.array([1.0, 2.0, 3.0]) / np.sqrt(14.0))
_TRIAL[:3, 3] = 0.11, 0.07, 0.05
_SAME = 1e-3  # in sizes of the rig, and as difference of axes: what moves with a control moves as a whole


@dataclass(frozen=True)
class Switch:
    """A property of a pose bone, its own or a custom one, and the value that is keyed."""

    bone: str
    name: str
    value: float
    custom: bool = True


@dataclass(frozen=True)
class Pole:
    """A control that a knee or an elbow points to, and the upper bone's role."""

    bone: str
    role: str


@dataclass(frozen=True)
class Controls:
    """A rig as it is keyed.

    Attributes:
        skeleton: bones that matter, each hanging on the one that carries it.
        keyed: names of those that get keys.
        switches: to be keyed too.
        poles: of arms and legs that are driven by IK.
        tried: constraints rule the rig, what carries what was tried out.
    """

    skeleton: Skeleton
    keyed: tuple[str, ...]
    switches: tuple[Switch, ...] = ()
    poles: tuple[Pole, ...] = ()
    tried: bool = False


def controls_of(rig: bpy.types.Object, bone_map: BoneMap, drive: Drive, also: Collection[str] = ()) -> Controls:
    """What is keyed on a rig to move the bones of a map; the rig itself is not touched.

    Args:
        rig: an armature object.
        bone_map: its roles.
        drive: which controls are keyed where there are several kinds.
        also: further bones that are keyed if the rig has them, unless constraints rule it.
    """
    skeleton = read_skeleton(rig)
    # The pose of bones without a role moves those below them: they are keyed too, at rest.
    wanted = {skeleton.index(name) for _, name in bone_map.bones}
    wanted |= {bone for bone, name in enumerate(skeleton.names) if name in also}
    for bone in range(len(skeleton.names) - 1, -1, -1):
        if bone in wanted and skeleton.parents[bone] >= 0:
            wanted.add(skeleton.parents[bone])
    keyed = tuple(skeleton.names[bone] for bone in sorted(wanted))
    if any(_is_ruled(rig.pose.bones[name]) for name in keyed):
        return _try_out(rig, bone_map, drive)
    return Controls(only(skeleton, (*keyed, *_beyond_ends(skeleton, bone_map))), keyed)


def _beyond_ends(skeleton: Skeleton, bone_map: BoneMap) -> list[str]:
    """What hangs on forearms without a hand and on feet without toes: it says where they lead to."""
    pairs = [(f"{side}_{limb}", f"{side}_{following}") for side in SIDES for limb, following in _ENDS.items()]
    last = [bone_map.bone(limb) for limb, following in pairs if bone_map.bone(following) is None]
    return [
        name
        for name, parent in zip(skeleton.names, skeleton.parents, strict=True)
        if parent >= 0 and skeleton.names[parent] in last
    ]


def _try_out(rig: bpy.types.Object, bone_map: BoneMap, drive: Drive) -> Controls:
    switches = tuple(
        Switch(bone.name, name, value)
        for bone in rig.pose.bones
        for name, value in _SWITCHES[drive].items()
        if name in bone
    )
    poles = _poles(rig) if drive == "ik" and switches else ()
    followers = [bone_map.bone(f"{side}_{limb}") for side in SIDES for limb in _FOLLOWERS] if poles else []
    names = list(dict.fromkeys([*(name for _, name in bone_map.bones), *(pole.bone for pole in poles)]))
    copy = copy_rig(rig, f"{rig.name} trial", with_children=False)
    try:
        skeleton = _as_carried(copy, names, switches)
    finally:
        remove_rig(copy)
    # Else IK makes limbs a little longer or shorter where it need not.
    stiff = tuple(Switch(bone, "ik_stretch", 0.0, custom=False) for bone in followers if bone is not None)
    keyed = tuple(name for name in skeleton.names if name not in followers)
    return Controls(skeleton, keyed, (*switches, *stiff), poles, tried=True)


def switch_curves(rig: bpy.types.Object, switches: Sequence[Switch], frames: Array) -> list[Curves]:
    """The switches as curves for the action of a motion."""
    return [
        Curves(
            rig.pose.bones[switch.bone].path_from_id() + (f'["{switch.name}"]' if switch.custom else f".{switch.name}"),
            np.full((len(frames), 1), switch.value),
            switch.bone,
            "CONSTANT",
        )
        for switch in switches
    ]


def _is_ruled(bone: Any) -> bool:
    return any(not constraint.mute and constraint.influence > 0 for constraint in bone.constraints)


def _poles(rig: Any) -> tuple[Pole, ...]:
    found = [
        Pole(pattern.format(s=side[0].upper()), f"{side}_{limb}") for limb, pattern in _POLES.items() for side in SIDES
    ]
    return tuple(pole for pole in found if pole.bone in rig.pose.bones)


def _as_carried(copy: Any, names: Sequence[str], switches: Sequence[Switch]) -> Skeleton:
    """The bones named, at rest, each hanging on the one of them that carries it."""
    for switch in switches:
        bone = copy.pose.bones[switch.bone]
        bone[switch.name] = type(bone[switch.name])(switch.value)
    whole = read_skeleton(copy)
    rest = _matrices(copy, names)
    moved = np.empty((len(names), len(names), 4, 4))
    for number, name in enumerate(names):
        copy.pose.bones[name].matrix_basis = _TRIAL.T.tolist()
        moved[number] = _matrices(copy, names) @ np.linalg.inv(rest)
        copy.pose.bones[name].matrix_basis = np.eye(4).tolist()
    size = float(np.ptp(rest[:, :3, 3], axis=0).max())
    parents, turns = _carriers(moved, rest[:, :3, 3], size)
    return _skeleton(whole, names, rest, parents, turns)


def _matrices(copy: Any, names: Sequence[str]) -> Array:
    """(B, 4, 4) of pose bones in the armature's space, as evaluated now."""
    copy.update_tag()
    bpy.context.view_layer.update()
    bones = copy.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
    return np.array([bones[name].matrix for name in names], float)


def _carriers(moved: Array, heads: Array, size: float) -> tuple[list[int], list[bool]]:
    """Which bone carries each, -1 for none, and whether it turns it too.

    Args:
        moved: (B, B, 4, 4) how a bone (second) moves when one (first) is tried.
        heads: (B, 3) at rest.
        size: of the rig.
    """
    own = np.diagonal(moved, axis1=0, axis2=1).transpose(2, 0, 1)
    expected = np.einsum("bij,cj->bci", own[:, :3, :3], heads) + own[:, None, :3, 3]
    actual = np.einsum("bcij,cj->bci", moved[..., :3, :3], heads) + moved[..., :3, 3]
    carries = np.linalg.norm(actual - expected, axis=-1) < _SAME * size
    turns = carries & (np.abs(moved[..., :3, :3] - own[:, None, :3, :3]).max(axis=(-1, -2)) < _SAME)
    np.fill_diagonal(carries, val=False)
    np.fill_diagonal(turns, val=False)
    depth = carries.sum(axis=0)
    parents, turned = [], []
    for bone in range(len(heads)):
        above = np.flatnonzero(turns[:, bone])
        turned.append(bool(len(above)))
        above = above if len(above) else np.flatnonzero(carries[:, bone])
        parents.append(int(above[np.argmax(depth[above])]) if len(above) else -1)
    return parents, turned


def _skeleton(whole: Skeleton, names: Sequence[str], rest: Array, parents: list[int], turns: list[bool]) -> Skeleton:
    """The bones named as they lie with all controls at rest, where constraints may hold them elsewhere than made."""
    u, _, vt = np.linalg.svd(rest[:, :3, :3])
    skeleton = Skeleton(
        names=tuple(names),
        parents=tuple(parents),
        heads=whole.to_world.apply(rest[:, :3, 3]),
        axes=whole.to_world.rotation @ u @ vt,
        lengths=whole.lengths[[whole.index(name) for name in names]],
        to_world=whole.to_world,
        turns_with_parent=np.array(turns),
    )
    return rehung(skeleton, parents)
