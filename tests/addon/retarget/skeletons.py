"""Synthetic people and rigs: humanoids of several builds, rest poses and bone rolls, and someone who walks."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from core_solver.geometry import Similarity, align_vectors, matrix_from_rotvec

Place = tuple[float, float, float]

# Joints of an adult who stands upright facing -y with arms stretched to the sides; soles on z = 0, metres.
_TRUNK: dict[str, Place] = {
    "hips": (0.0, 0.0, 0.95), "spine1": (0.0, 0.0, 1.06), "spine2": (0.0, 0.01, 1.18), "spine3": (0.0, 0.0, 1.28),
    "neck": (0.0, 0.02, 1.47), "head": (0.0, 0.0, 1.58),
}  # fmt: skip
_LEFT: dict[str, Place] = {
    "thigh": (0.09, 0.0, 0.9), "shin": (0.1, -0.01, 0.49), "foot": (0.09, 0.02, 0.08), "toe": (0.1, -0.11, 0.02),
    "clavicle": (0.05, 0.02, 1.42), "upper_arm": (0.17, 0.02, 1.42), "forearm": (0.44, 0.02, 1.42),
    "hand": (0.69, 0.02, 1.42),
}  # fmt: skip
_AFTER = {
    "hips": "spine1", "spine1": "spine2", "spine2": "spine3", "spine3": "neck", "neck": "head", "thigh": "shin",
    "shin": "foot", "foot": "toe", "clavicle": "upper_arm", "upper_arm": "forearm", "forearm": "hand",
}  # fmt: skip
_LAST: dict[str, Place] = {"head": (0.0, 0.0, 0.18), "toe": (0.0, -0.06, 0.0), "hand": (0.09, 0.0, 0.0)}
_UP = {"spine1": "hips", "spine2": "spine1", "spine3": "spine2", "neck": "spine3", "head": "neck"}
_UP_LEFT = {
    "thigh": "hips", "shin": "thigh", "foot": "shin", "toe": "foot", "clavicle": "spine3", "upper_arm": "clavicle",
    "forearm": "upper_arm", "hand": "forearm",
}  # fmt: skip
FPS = 30.0


@dataclass(frozen=True)
class Build:
    """What a rig is like; the default is the adult above."""

    size: float = 1.0
    arms_down: float = 0.0
    """Radians by which the arms hang."""
    elbows_bent: float = 0.0
    """Radians by which the forearms point forward at rest."""
    facing: float = 0.0
    """Radians about the vertical; 0 faces -y."""
    without: tuple[str, ...] = ()
    """Joints left out, by the names above."""
    spine: int = 3
    rolls: int | None = None
    """Seed of arbitrary rolls; None for z to the front."""
    roots: tuple[str, ...] = ()
    """Bones on the ground; the first one carries the hips."""
    extras: bool = False
    """A bone that twists in each upper arm and a second bone in the neck that has no role."""
    to_world: Similarity = field(default_factory=lambda: Similarity(np.eye(3), np.zeros(3)))
    place: Place = (0.0, 0.0, 0.0)


MIXAMO = Build(size=0.97, to_world=Similarity(np.array([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]]), np.zeros(3), 0.01))
A_POSE = Build(size=1.08, arms_down=0.8, facing=np.pi, rolls=4, place=(3.0, -2.0, 0.0))
UNREAL = Build(
    arms_down=0.7, elbows_bent=0.4, spine=5, roots=("root", "ik_foot_root", "ik_hand_root"), extras=True, rolls=9
)  # fmt: skip
SHORT = Build(size=0.7, without=("toe", "clavicle", "neck"), spine=1, roots=("Root",))
TALL = Build(size=1.4, arms_down=0.5, rolls=2, roots=("root",))
RIGS = {"mixamo": MIXAMO, "a pose": A_POSE, "unreal": UNREAL, "short": SHORT, "tall": TALL}


@dataclass(frozen=True)
class Rig:
    """A skeleton and its roles."""

    skeleton: Any
    bone_map: Any


def make_rig(addon: Any, build: Build) -> Rig:
    """A humanoid rig; its bones are called after their roles, sides and spine numbers included."""
    heads, tails, parents, roles = _joints(build)
    names = _parents_first(parents)
    turn = matrix_from_rotvec([0.0, 0.0, build.facing])
    head = build.size * np.array([heads[name] for name in names]) @ turn.T + build.place
    tail = build.size * np.array([tails[name] for name in names]) @ turn.T + build.place
    world = build.to_world
    skeleton = addon("retarget.skeleton").Skeleton(
        names=tuple(names),
        parents=tuple(names.index(above) if (above := parents[name]) else -1 for name in names),
        heads=head,
        axes=_axes(tail - head, turn, build.rolls),
        lengths=np.linalg.norm(tail - head, axis=1),
        to_world=Similarity(world.rotation, world.translation + build.place, world.scale),
        turns_with_parent=np.ones(len(names), bool),
    )
    bones = tuple((role, name) for name in names for role in [roles.get(name)] if role)
    return Rig(skeleton, addon("retarget.bone_map").BoneMap(bones))


def make_person(addon: Any, size: float = 1.0) -> Rig:
    """Somebody of a take: the default build."""
    return make_rig(addon, Build(size=size))


def gestures(addon: Any, rig: Rig, frames: int = 40, seed: int = 0) -> Any:
    """All bones that have a role turn this way and that, far from the ground."""
    rng = np.random.default_rng(seed)
    skeleton = rig.skeleton
    time = np.arange(frames) / FPS
    phase, axis = rng.uniform(0, 6.28, len(skeleton.names)), rng.normal(size=(len(skeleton.names), 3))
    axis[[rig.bone_map.role_of(name) in (None, "root") for name in skeleton.names]] = 0.0
    turns = matrix_from_rotvec(0.35 * np.sin(3 * time[:, None] + phase)[..., None] * axis)
    locations = np.zeros((frames, len(skeleton.names), 3))
    hips = skeleton.index("hips")
    locations[:, hips] = (np.array([0.3, 1.0, 1.0]) + 0.1 * np.sin(time)[:, None]) / skeleton.to_world.scale
    return addon("retarget.skeleton").pose(skeleton, time, turns, locations)


def walk(
    addon: Any, rig: Rig, frames: int = 90, step: float = 0.55, heading: float = 0.6, start: Place = (0.5, 0.2, 0.0)
) -> tuple[Any, np.ndarray]:
    """Somebody who walks on z = 0: feet stand perfectly still while the other swings, arms swing, the trunk turns.

    Returns:
        The motion, and (T, 2) contacts.
    """
    skeleton = rig.skeleton
    size = float(skeleton.heads[skeleton.index("hips"), 2]) / 0.95
    time = np.arange(frames) / FPS
    phase = time / 0.6  # steps done
    turn = matrix_from_rotvec([0.0, 0.0, heading])
    ahead, aside = turn @ [0.0, -1.0, 0.0], turn @ [1.0, 0.0, 0.0]
    turns = np.tile(turn, (frames, len(skeleton.names), 1, 1))
    hips = np.outer(phase * step * size, ahead) + start + [0.0, 0.0, 0.87 * size]
    hips[:, 2] += 0.02 * size * np.cos(2 * np.pi * phase)
    swing = 0.5 * np.sin(np.pi * phase)
    contacts = np.zeros((frames, 2))
    for role, number in (("spine1", 0.1), ("spine2", 0.2), ("spine3", 0.3), ("neck", 0.2), ("head", 0.1)):
        _turn_below(skeleton, turns, role, number * swing, np.array([0.0, 0.0, 1.0]))
    for foot, side in enumerate(("left", "right")):
        sign = 1 - 2 * foot
        for limb, amount in (("upper_arm", 1.0), ("forearm", 0.6)):
            _turn_below(skeleton, turns, f"{side}_{limb}", sign * (0.3 + 0.4 * swing), aside * amount + 0.2 * ahead)
        _turn_below(skeleton, turns, f"{side}_upper_arm", sign * 1.1 * np.ones(frames), ahead)
        done = phase + foot
        stage, number = done % 2, done // 2
        moved = np.where(stage < 1, 0.0, stage - 1)
        eased = moved * moved * (3 - 2 * moved)
        place = (2 * (number + eased) - foot + 0.5) * step * size
        contacts[:, foot] = stage < 1
        ankle = np.outer(place, ahead) + sign * 0.09 * size * aside + start + [0.0, 0.0, 0.08 * size]
        ankle[:, 2] += 0.12 * size * np.sin(np.pi * moved) ** 2
        _bend_leg(skeleton, turns, side, hips, ankle, ahead)
    heads_at_hips = np.zeros((frames, len(skeleton.names), 3))
    index = skeleton.index("hips")
    heads_at_hips[:, index] = hips - skeleton.heads[index]
    return addon("retarget.skeleton").place(skeleton, time, turns @ skeleton.axes, heads_at_hips), contacts


def _bend_leg(skeleton: Any, turns: np.ndarray, side: str, hips: np.ndarray, ankle: np.ndarray, ahead: Any) -> None:
    """Turn thigh and shin so that the ankle is where it shall be; the foot stays level."""
    thigh, shin, foot = (skeleton.index(f"{side}_{limb}") for limb in ("thigh", "shin", "foot"))
    start = hips + (skeleton.heads[thigh] - skeleton.heads[skeleton.index("hips")]) @ turns[0, 0].T
    upper, lower = skeleton.heads[shin] - skeleton.heads[thigh], skeleton.heads[foot] - skeleton.heads[shin]
    a, b, way = np.linalg.norm(upper), np.linalg.norm(lower), ankle - start
    distance = np.linalg.norm(way, axis=1, keepdims=True)
    assert distance.max() < a + b
    along = (a * a - b * b + distance**2) / (2 * distance)
    line = way / distance
    front = ahead - np.sum(ahead * line, axis=1, keepdims=True) * line
    front /= np.linalg.norm(front, axis=1, keepdims=True)
    knee = start + along * line + np.sqrt(a * a - along**2) * front
    base = turns[:, thigh].copy()
    turns[:, thigh] = align_vectors(base @ upper, knee - start) @ base
    turns[:, shin] = align_vectors(base @ lower, ankle - knee) @ base


def _turn_below(skeleton: Any, turns: np.ndarray, bone: str, angle: np.ndarray, axis: np.ndarray) -> None:
    rotation = matrix_from_rotvec(angle[:, None] * axis)
    below = np.flatnonzero(skeleton.below(skeleton.index(bone)))
    turns[:, below] = rotation[:, None] @ turns[:, below]


def _joints(build: Build) -> tuple[dict[str, Any], dict[str, Any], dict[str, str | None], dict[str, str]]:
    heads: dict[str, Any] = {name: np.array(place) for name, place in _TRUNK.items()}
    parents: dict[str, str | None] = {"hips": None, **_UP}
    after, roles = dict(_AFTER), {"hips": "hips", "neck": "neck", "head": "head"}
    tails = {name: heads[_AFTER.get(name, name)] + _LAST.get(name, (0, 0, 0)) for name in heads}
    for sign, side in ((1, "left"), (-1, "right")):
        places = _arm_posed(build)
        mirror = np.array([sign, 1, 1])
        for limb, place in places.items():
            name = f"{side}_{limb}"
            end = places[after[limb]] if limb in after else place + _last(places, limb)
            heads[name], tails[name], roles[name] = mirror * place, mirror * end, name
            above = _UP_LEFT[limb]
            parents[name] = above if above in _TRUNK else f"{side}_{above}"
    _set_spine(build, heads, tails, parents, roles)
    if build.extras:
        _add_extras(heads, tails, parents)
    for number, root in enumerate(build.roots):
        heads[root], tails[root] = np.zeros(3), np.array([0.0, -0.2, 0.0])
        parents[root] = None
        if not number:
            parents["hips"], roles[root] = root, "root"
    for left_out in build.without:
        for name in [n for n in heads if n.removeprefix("left_").removeprefix("right_") == left_out]:
            for child in [c for c, parent in parents.items() if parent == name]:
                parents[child] = parents[name]
            for table in (heads, tails, parents, roles):
                table.pop(name, None)
    return heads, tails, parents, roles


def _last(places: dict[str, Any], limb: str) -> np.ndarray:
    """From a last bone's head to its tail: hands go on from the forearm."""
    if limb != "hand":
        return np.array(_LAST[limb])
    along = places["hand"] - places["forearm"]
    return _LAST["hand"][0] * along / np.linalg.norm(along)


def _arm_posed(build: Build) -> dict[str, np.ndarray]:
    places = {limb: np.array(place) for limb, place in _LEFT.items()}
    elbow = matrix_from_rotvec([0.0, 0.0, -build.elbows_bent])
    places["hand"] = places["forearm"] + elbow @ (places["hand"] - places["forearm"])
    down = matrix_from_rotvec([0.0, build.arms_down, 0.0])
    for limb in ("forearm", "hand"):
        places[limb] = places["upper_arm"] + down @ (places[limb] - places["upper_arm"])
    return places


def _set_spine(build: Build, heads: Any, tails: Any, parents: Any, roles: Any) -> None:
    """As many bones from the hips to the neck as the build has."""
    along = np.array([heads[name] for name in ("spine1", "spine2", "spine3")])
    for number in (1, 2, 3):
        for table in (heads, tails, parents):
            table.pop(f"spine{number}")
    share = np.linspace(0, 2, build.spine) if build.spine > 1 else np.array([1.0])
    names = [f"spine{number + 1}" for number in range(build.spine)]
    for name, at in zip(names, share, strict=True):
        heads[name] = np.array([np.interp(at, [0, 1, 2], along[:, axis]) for axis in range(3)])
        roles[name] = "spine"
    for name, following in zip(names, [*names[1:], "neck"], strict=True):
        tails[name] = heads[following]
    for name, above in zip(names, ["hips", *names], strict=False):
        parents[name] = above
    tails["hips"] = heads[names[0]]
    for name, parent in list(parents.items()):
        if parent == "spine3" and name not in names:
            parents[name] = names[-1]


def _add_extras(heads: Any, tails: Any, parents: Any) -> None:
    for side in ("left", "right"):
        arm = f"{side}_upper_arm"
        heads[f"{side}_twist"] = (heads[arm] + tails[arm]) / 2
        tails[f"{side}_twist"] = tails[arm]
        parents[f"{side}_twist"] = arm
    heads["neck_02"] = (heads["neck"] + heads["head"]) / 2
    tails["neck_02"], parents["neck_02"], parents["head"] = heads["head"], "neck", "neck_02"


def _parents_first(parents: dict[str, str | None]) -> list[str]:
    ordered: list[str] = []
    while len(ordered) < len(parents):
        ordered += [n for n, parent in parents.items() if n not in ordered and (parent is None or parent in ordered)]
    return ordered


def _axes(along: np.ndarray, turn: np.ndarray, rolls: int | None) -> np.ndarray:
    """(B, 3, 3) y along the bone, z as near to the front (or up) as can be, then rolled."""
    y = along / np.linalg.norm(along, axis=1, keepdims=True)
    front = np.where(np.abs(y @ turn[:, 1])[:, None] > 0.9, [0.0, 0.0, 1.0], -turn[:, 1])
    z = front - np.sum(front * y, axis=1, keepdims=True) * y
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    axes = np.stack([np.cross(y, z), y, z], axis=-1)
    if rolls is None:
        return axes
    angle = np.random.default_rng(rolls).uniform(-3, 3, len(y))
    roll = matrix_from_rotvec(np.stack([0 * angle, angle, 0 * angle], axis=1))
    return axes @ roll
