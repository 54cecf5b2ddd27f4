# SPDX-License-Identifier: GPL-3.0-or-later
"""A whole body that bends a little to reach several goals at once: damped Gauss-Newton, every frame by itself.

A pose is given (its style), and per frame a vector of small turns changes it: of hips, spine, clavicles, arms and
legs, and a shift of the hips. Each joint's turn is a rotation vector delta in the world's axes of the given pose, about
the joint's head; the turn of a bone in the new pose is D_b = D_parent exp(delta_b), its axes are D_b times the given
ones. The spine's bones share one turn. Knees and elbows are hinges. Feet keep their turn in the world.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec

from .bone_map import BoneMap
from .landmarks import Landmark, landmark
from .roles import SIDES
from .skeleton import Motion, Skeleton
from .small_systems import solve_positive

Array = NDArray[np.float64]

# What a turn costs, per square radian, against goals per square metre: a trunk that leans is seen before an arm is.
_STIFF = {"hips": 4.0, "spine": 2.0, "clavicle": 2.0, "upper_arm": 0.3, "forearm": 0.2, "thigh": 0.3, "shin": 0.2}
# What a shift of the hips costs, per square metre: sideways hardly any, for people stand where they stood.
_SHIFT = np.array([3e3, 3e3, 40.0])
FARTHEST_SHIFT = 0.009
"""Metres by which hips may leave their place over the ground: two people's distance then stays within 2 cm."""

_DEEPEST, _HIGHEST = 0.5, 0.05  # how far hips may sink and rise, in their height at rest

_HINGES = ("forearm", "shin")
_STRAIGHTEST, _MOST_BENT = 0.05, 2.5  # radians of bend that a hinge stays within, or where it is anyway
_HOLD = 1e9  # cost that keeps a change on its bound
_LARGEST_STEP = 0.4  # radians or metres per iteration


@dataclass(frozen=True)
class Joint:
    """One turn of the body.

    Attributes:
        bones: that share it equally, as indices.
        first: its place in the vector of changes.
        hinge: (T, 3) unit axis in the world of the given pose; None for a joint that turns about every axis.
        least, most: (T,) bounds of a hinge's turn, radians.
    """

    bones: tuple[int, ...]
    first: int
    hinge: Array | None = None
    least: Array | None = None
    most: Array | None = None

    @property
    def size(self) -> int:
        return 3 if self.hinge is None else 1

    def at(self, frames: NDArray[np.int64]) -> "Joint":
        """The joint in some of its frames."""
        if self.hinge is None or self.least is None or self.most is None:
            return self
        return replace(self, hinge=self.hinge[frames], least=self.least[frames], most=self.most[frames])


@dataclass(frozen=True)
class Body:
    """A skeleton in its given pose, ready to be bent.

    Attributes:
        skeleton: at rest.
        style: the given pose.
        hips: index of the bone that carries the body.
        seat: (T, 3) from its head to the middle between the hip joints in the given pose: what it turns about, so that
            a body that leans stays over its place.
        joints: what may turn, parents first.
        frozen: bones that keep their turn in the world.
        stiffness: (N,) cost of every change; the first three are the shift of the hips.
    """

    skeleton: Skeleton
    style: Motion
    hips: int
    seat: Array
    joints: tuple[Joint, ...]
    frozen: frozenset[int]
    stiffness: Array

    @property
    def size(self) -> int:
        """Number of changes in a frame."""
        return len(self.stiffness)

    def at(self, frames: NDArray[np.int64]) -> "Body":
        """The body in some of its frames."""
        joints = tuple(joint.at(frames) for joint in self.joints)
        return replace(self, style=self.style.at(frames), seat=self.seat[frames], joints=joints)


@dataclass(frozen=True)
class Goal:
    """A point of the body that shall come to a place.

    Attributes:
        points: landmarks whose weighted mean is the point.
        shares: (P, T) weights of the landmarks, summing to 1.
        target: (T, 3) world, metres.
        weight: (T,) per square metre.
        direction: (T, 3) unit vectors when only this direction matters; None for all three.
    """

    points: tuple[Landmark, ...]
    shares: Array
    target: Array
    weight: Array
    direction: Array | None = None

    def at(self, frames: NDArray[np.int64]) -> "Goal":
        """The goal in some of its frames."""
        direction = None if self.direction is None else self.direction[frames]
        return Goal(self.points, self.shares[:, frames], self.target[frames], self.weight[frames], direction)


def body_of(skeleton: Skeleton, bone_map: BoneMap, style: Motion) -> Body:
    """Make a skeleton ready.

    Args:
        skeleton: at rest.
        bone_map: of a humanoid.
        style: (T) the pose to keep as far as goals allow.
    """
    joints: list[Joint] = []
    costs: list[Array] = [_SHIFT]

    def add(bones: tuple[int, ...], kind: str, hinge: tuple[Array, Array, Array] | None = None) -> None:
        joint = Joint(bones, sum(len(c) for c in costs), *(hinge or (None, None, None)))
        joints.append(joint)
        costs.append(np.full(joint.size, _STIFF[kind]))

    def bone(role: str) -> int | None:
        name = bone_map.bone(role)
        return None if name is None else skeleton.index(name)

    hips = skeleton.index(bone_map.needed("hips"))
    add((hips,), "hips")
    if bone_map.spine:
        add(tuple(skeleton.index(name) for name in bone_map.spine), "spine")
    for side in SIDES:
        for kind in ("clavicle", "upper_arm", "forearm", "thigh", "shin"):
            index = bone(f"{side}_{kind}")
            if index is None:
                continue
            add((index,), kind, _hinge(skeleton, bone_map, style, side, kind) if kind in _HINGES else None)
    names = (bone_map.bone(f"{side}_foot") for side in SIDES)
    feet = frozenset(skeleton.index(name) for name in names if name)
    thighs = [skeleton.index(bone_map.needed(f"{side}_thigh")) for side in SIDES]
    seat = style.heads[:, thighs].mean(axis=1) - style.heads[:, hips]
    return Body(skeleton, style, hips, seat, tuple(joints), feet, np.concatenate(costs))


def bend(body: Body, changes: Array, bones: Sequence[int] | None = None) -> Motion:
    """The pose with changes.

    Args:
        body: with T frames.
        changes: (T, N).
        bones: which are needed, parents first; all others are left as given.
    """
    return _bent(body, changes, range(len(body.skeleton.names)) if bones is None else bones)[0]


def improve(body: Body, changes: Array, prior: Array, goals: Sequence[Goal]) -> Array:
    """One step of Gauss-Newton towards goals.

    Minimises the sum of weight * |point - target|^2 and of stiffness * (changes - prior)^2.

    Args:
        body: with T frames.
        changes: (T, N) the present ones.
        prior: (T, N) where changes rest when there is no goal.
        goals: with T frames.

    Returns:
        (T, N) better changes, within the joints' bounds.
    """
    needed = _ancestors(body.skeleton, [point.bone for goal in goals for point in goal.points])
    motion, turns = _bent(body, changes, needed)
    levers = _Levers(body, changes, motion, turns)
    hessian = np.zeros((len(changes), body.size, body.size)) + np.diag(body.stiffness)
    gradient = body.stiffness * (changes - prior)
    for goal in goals:
        jacobian, miss = levers.of(goal)
        weighed = goal.weight[:, None, None] * jacobian
        hessian += np.swapaxes(weighed, 1, 2) @ jacobian
        gradient += np.einsum("tcn,tc->tn", weighed, miss)
    step = _solve_within(hessian, gradient, *(bound - changes for bound in _bounds(body, len(changes))))
    return changes + np.clip(step, -_LARGEST_STEP, _LARGEST_STEP)


def _bent(body: Body, changes: Array, bones: Sequence[int]) -> tuple[Motion, dict[int, Array]]:
    """The pose, and by how much each bone below the hips turned: (T, 3, 3) world."""
    style = body.style
    heads, rotations = style.heads.copy(), style.rotations.copy()
    turning = {bone: joint for joint in body.joints for bone in joint.bones}
    turns: dict[int, Array] = {}
    for bone in bones:
        parent = body.skeleton.parents[bone]
        if bone != body.hips and parent not in turns:
            continue
        carried = np.eye(3)[None] if bone == body.hips else turns[parent]
        if bone in body.frozen:
            turn = np.eye(3)[None]
        elif bone in turning:
            turn = carried @ matrix_from_rotvec(_share(turning[bone], changes))
        else:
            turn = carried
        if bone == body.hips:
            heads[:, bone] = style.heads[:, bone] + changes[:, :3] + body.seat - _turned(turn, body.seat)
        else:
            heads[:, bone] = heads[:, parent] + _turned(carried, style.heads[:, bone] - style.heads[:, parent])
        turns[bone] = np.broadcast_to(turn, rotations[:, bone].shape)
        rotations[:, bone] = turn @ style.rotations[:, bone]
    return Motion(style.times, rotations, heads), turns


def _share(joint: Joint, changes: Array) -> Array:
    """(T, 3) rotation vector of each bone of a joint."""
    change = changes[:, joint.first : joint.first + joint.size]
    return (change if joint.hinge is None else change * joint.hinge) / len(joint.bones)


class _Levers:
    """How points of a pose move with the changes."""

    def __init__(self, body: Body, changes: Array, motion: Motion, turns: dict[int, Array]) -> None:
        self._body, self._motion = body, motion
        self._frames = len(changes)
        self._seat = body.style.heads[:, body.hips] + body.seat + changes[:, :3]
        self._axes: dict[int, tuple[Joint, Array]] = {}
        for joint in body.joints:
            rates = _left_jacobian(_share(joint, changes)) / len(joint.bones)
            for bone in joint.bones:
                if bone in turns:
                    parent = body.skeleton.parents[bone]
                    carried = turns[parent] @ rates if parent in turns else rates
                    columns = carried if joint.hinge is None else _turned(carried, joint.hinge)[..., None]
                    self._axes[bone] = (joint, columns)

    def of(self, goal: Goal) -> tuple[Array, Array]:
        """(T, C, N) derivatives of a goal's point by the changes and (T, C) how far it is off; C is 3 or 1."""
        jacobian = np.zeros((self._frames, 3, self._body.size))
        place = np.zeros((self._frames, 3))
        for point, share in zip(goal.points, goal.shares, strict=True):
            position = point.positions(self._motion)
            place += share[:, None] * position
            jacobian += share[:, None, None] * self._of_point(point, position)
        miss = place - goal.target
        if goal.direction is None:
            return jacobian, miss
        along = np.einsum("tcn,tc->tn", jacobian, goal.direction)[:, None]
        return along, np.sum(miss * goal.direction, axis=-1, keepdims=True)

    def _of_point(self, point: Landmark, position: Array) -> Array:
        skeleton, heads = self._body.skeleton, self._motion.heads
        jacobian = np.zeros((self._frames, 3, self._body.size))
        bone, lever = point.bone, position
        while bone >= 0:
            if bone in self._body.frozen:
                # What hangs on a bone that keeps its turn only follows its head.
                lever = heads[:, bone]
            elif bone in self._axes:
                joint, axes = self._axes[bone]
                pivot = self._seat if bone == self._body.hips else heads[:, bone]
                arm = (lever - pivot)[:, :, None]
                jacobian[:, :, joint.first : joint.first + joint.size] += np.cross(axes, arm, axis=1)
            if bone == self._body.hips:
                jacobian[:, :, :3] += np.eye(3)
                break
            bone = skeleton.parents[bone]
        return jacobian


def _bounds(body: Body, frames: int) -> tuple[Array, Array]:
    """(T, N), (T, N) the least and the largest changes."""
    most = np.full((frames, body.size), np.inf)
    most[:, :2] = FARTHEST_SHIFT / np.sqrt(2)
    least = -most
    standing = body.skeleton.heads[body.hips, 2] - body.skeleton.heads[:, 2].min()
    least[:, 2], most[:, 2] = -_DEEPEST * standing, _HIGHEST * standing
    for joint in body.joints:
        if joint.least is not None and joint.most is not None:
            least[:, joint.first], most[:, joint.first] = joint.least, joint.most
    return least, most


def _solve_within(hessian: Array, gradient: Array, least: Array, most: Array) -> Array:
    """(T, N) steps to the lowest point of quadratic costs; what would leave its bounds is held on them.

    The others then do what the held ones cannot.
    """
    step = -solve_positive(hessian, gradient)
    inside = np.clip(step, least, most)
    frames = np.flatnonzero((step != inside).any(axis=1))
    if len(frames):
        held = (step != inside)[frames]
        stiff = hessian[frames] + _HOLD * held[:, :, None] * np.eye(step.shape[1])
        pull = np.where(held, -_HOLD * inside[frames], gradient[frames])
        step[frames] = -solve_positive(stiff, pull)
    return np.clip(step, least, most)


def _hinge(skeleton: Skeleton, bone_map: BoneMap, style: Motion, side: str, kind: str) -> tuple[Array, Array, Array]:
    """Axis (T, 3) about which an elbow or knee bends, and by how much it may bend back and on from where it is."""
    upper, end = ("upper_arm", "hand") if kind == "forearm" else ("thigh", "foot")
    start, middle = (skeleton.index(bone_map.needed(f"{side}_{role}")) for role in (upper, kind))
    last = bone_map.bone(f"{side}_{end}")
    first_rest = _unit(skeleton.heads[middle] - skeleton.heads[start])
    # At rest: knees bend about the axis to the body's left, backwards; elbows about that across arm and facing.
    left = _unit(_left_of(skeleton, bone_map))
    facing = np.cross(left, [0.0, 0.0, 1.0])
    rest_axis = left if kind == "shin" else _unit(np.cross(first_rest, facing))
    carried = style.rotations[:, start] @ (skeleton.axes[start].T @ rest_axis)
    first = _unit(style.heads[:, middle] - style.heads[:, start])
    ahead = landmark(skeleton, middle, skeleton.end(middle))
    tip = style.heads[:, skeleton.index(last)] if last else ahead.positions(style)
    second = _unit(tip - style.heads[:, middle])
    # The plane it is bent in says more than the rest pose, once it is bent.
    carried = carried - np.sum(carried * first, axis=-1, keepdims=True) * first
    axis = _unit(np.cross(first, second) + 0.15 * _unit(carried))
    bent = np.arctan2(np.sum(np.cross(first, second) * axis, axis=-1), np.sum(first * second, axis=-1))
    return axis, np.minimum(_STRAIGHTEST - bent, 0.0), np.maximum(_MOST_BENT - bent, 0.0)


def _left_of(skeleton: Skeleton, bone_map: BoneMap) -> Array:
    """(3,) from the right hip to the left one, level."""
    left, right = (skeleton.heads[skeleton.index(bone_map.needed(f"{side}_thigh"))] for side in SIDES)
    across = left - right
    return across * [1.0, 1.0, 0.0]


def _ancestors(skeleton: Skeleton, bones: Sequence[int]) -> list[int]:
    """The bones and all above them, parents first."""
    found: set[int] = set()
    for start in bones:
        bone = start
        while bone >= 0 and bone not in found:
            found.add(bone)
            bone = skeleton.parents[bone]
    return sorted(found)


def _left_jacobian(rotvec: Array) -> Array:
    """(T, 3, 3) J with exp(v + dv) = exp(J dv) exp(v), to first order."""
    angle = np.linalg.norm(rotvec, axis=-1)[:, None, None]
    small = angle < 1e-4
    safe = np.where(small, 1.0, angle)
    cross = np.zeros((len(rotvec), 3, 3))
    x, y, z = rotvec.T
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= np.swapaxes(cross, 1, 2)
    a = np.where(small, 0.5, (1 - np.cos(safe)) / safe**2)
    b = np.where(small, 1.0 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + a * cross + b * cross @ cross


def _turned(rotations: Array, vectors: Array) -> Array:
    return np.einsum("tab,tb->ta", np.broadcast_to(rotations, (len(vectors), 3, 3)), vectors)


def _unit(vectors: Array) -> Array:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-12)
