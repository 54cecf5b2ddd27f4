# SPDX-License-Identifier: GPL-3.0-or-later
"""Find the parts of a humanoid by its shape alone, whatever its bones are called.

Legs and arms are pairs of branches that mirror each other by their lengths, so that the rest pose need not be
symmetric. The legs hang down from the hips; the arms leave the spine above them; where the spine goes on beyond the
arms there are neck and head. Within a limb three joints are chosen that divide it as a thigh, a shin and a foot do.
The body may lie, lean and face any way: up is from hips to shoulders, toes point to the front, knees bend to the front
and elbows to the back.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray

from core_solver.errors import UserError

from .bone_map import BoneMap
from .roles import NEEDED, ROOT, SIDES, SPINE
from .skeleton import Skeleton
from .topology import Tree, Twins

Array = NDArray[np.float64]


class NotHumanoidError(UserError):
    """A rig without the limbs of a human being."""


@dataclass(frozen=True)
class _Proportions:
    """What a limb's joints are judged by.

    Attributes:
        rest: length beyond the third joint as a fraction of the two segments' lengths.
        too_long: how much more of it counts against the choice; less counts less, for fingers and toes may be missing.
        apart: distance of both limbs' first joints, in the same terms; closer ones are within the trunk.
    """

    rest: float
    too_long: float
    apart: float


# A choice of limbs that costs so much less than all others is beyond doubt.
_CLEAR_LEAD = 0.5

_LEG = _Proportions(rest=0.18, too_long=1.4, apart=0.12)
_ARM = _Proportions(rest=0.34, too_long=2.0, apart=0.3)


@dataclass(frozen=True)
class _Limb:
    """Three joints of a chain: hip, knee, ankle or shoulder, elbow, wrist.

    Attributes:
        chain: bones from the trunk outwards.
        first, second: bones of the two segments.
        third: the foot or hand; -1 when the chain ends before it.
        cost: 0 for the proportions of a human limb, more for others.
    """

    chain: tuple[int, ...]
    first: int
    second: int
    third: int
    cost: float

    @property
    def before(self) -> tuple[int, ...]:
        """Bones between the trunk and the first joint."""
        return self.chain[: self.chain.index(self.first)]


@dataclass(frozen=True)
class _Body:
    """A choice of limbs.

    Attributes:
        legs, arms: a pair each; sides not yet told apart, but the first of both are on one side.
        hips: the bone that carries legs and arms.
        chest: the bone from which the arms branch.
        up_chain: bones from above the chest to the top.
        up: (3,) unit vector from the hip joints to the shoulders.
        cost: of the whole choice.
        lead: how much more the next best choice costs.
    """

    legs: tuple[_Limb, _Limb]
    arms: tuple[_Limb, _Limb]
    hips: int
    chest: int
    up_chain: tuple[int, ...]
    up: Array
    cost: float
    lead: float = 0.0


def find_by_structure(skeleton: Skeleton) -> BoneMap:
    """Roles by topology, lengths and positions.

    Raises:
        NotHumanoidError: there are no two legs, no two arms or no head, or there are four legs.
    """
    tree = Tree(skeleton)
    body = _best_body(tree)
    front = _front(tree, body)
    left = 0 if _across(tree, body) @ np.cross(body.up, front.direction) > 0 else 1
    neck, head, head_trust = _neck_and_head(tree, body)
    pairs: list[tuple[str, int]] = []
    trusts: dict[str, float] = {}
    line = tree.line(body.hips)
    if len(line) > 1:
        pairs.append((ROOT, line[-1]))
    pairs.append(("hips", body.hips))
    pairs += [(SPINE, bone) for bone in _spine(tree, body)]
    pairs += [("neck", neck)] if neck is not None else []
    pairs.append(("head", head))
    trusts |= {"neck": head_trust, "head": head_trust}
    for side in SIDES:
        number = left if side == "left" else 1 - left
        for role, bone, trust in _limb_roles(tree, body, number, front.direction):
            pairs.append((f"{side}_{role}", bone))
            trusts[f"{side}_{role}"] = trust * front.trust * (0.5 + 0.5 * min(body.lead / _CLEAR_LEAD, 1.0))
    return _bone_map(skeleton, pairs, trusts)


def _bone_map(skeleton: Skeleton, pairs: Sequence[tuple[str, int]], trusts: dict[str, float]) -> BoneMap:
    missing = sorted(set(NEEDED) - {role for role, _ in pairs})
    if missing:
        parts = ", ".join(role.replace("_", " ") for role in missing)
        raise NotHumanoidError(f"no bones that could be the {parts}: choose the bones by hand in the bone map")
    confidence = round(float(np.mean([trusts.get(role, 1.0) for role in NEEDED])), 3)
    doubts = {role: round(trust, 3) for role, trust in trusts.items() if trust < confidence - 0.05}
    bones = tuple((role, skeleton.names[bone]) for role, bone in pairs)
    return BoneMap(bones, "structure", confidence, {r: t for r, t in doubts.items() if r in dict(pairs)})


# --- which branches are legs and arms -------------------------------------------------------------------------------


def _best_body(tree: Tree) -> _Body:
    limbs = tree.twins()
    if not limbs:
        raise NotHumanoidError("this rig has no two chains of bones that could be legs: choose a humanoid's armature")
    bodies = [body for legs in limbs for arms in limbs if legs is not arms for body in _bodies(tree, legs, arms)]
    if bodies:
        best, *others = sorted(bodies, key=lambda body: body.cost)
        return replace(best, lead=others[0].cost - best.cost if others else _CLEAR_LEAD)
    if sum(_stands(tree, twins) for twins in limbs) > 1:
        raise NotHumanoidError(
            "this rig stands on more than two legs: only rigs with two legs and two arms can be retargeted"
        )
    raise NotHumanoidError(
        "this rig has no two legs below and two arms and a head above a spine: choose a humanoid's armature"
    )


def _reach(tree: Tree, twins: Twins) -> float:
    return min(float(tree.reaches[chain[0]]) for chain in twins.chains)


def _stands(tree: Tree, twins: Twins) -> bool:
    """Whether both branches lead down to the rig's lowest joints."""
    heights = tree.skeleton.heads[:, 2]
    ground, top = heights.min(), heights.max()
    ends = [min(heights[list(chain)]) for chain in twins.chains]
    starts = [heights[chain[0]] for chain in twins.chains]
    low = ground + 0.15 * (top - ground)
    return max(ends) < low and min(starts) > ground + 0.25 * (top - ground)


def _bodies(tree: Tree, legs: Twins, arms: Twins) -> Iterator[_Body]:
    """The body with these limbs, unless they cannot be its legs and arms."""
    if legs.parent < 0 or arms.parent < 0:
        return
    hips = tree.common(legs.parent, arms.parent)
    leg_pair, arm_pair = _limbs(tree, legs, _LEG), _limbs(tree, arms, _ARM)
    if hips < 0 or leg_pair is None or arm_pair is None:
        return
    heads = tree.skeleton.heads
    trunk = _middle(heads, arm_pair) - _middle(heads, leg_pair)
    up = trunk / max(float(np.linalg.norm(trunk)), 1e-9)
    drop = min(float((heads[leg.first] - heads[leg.chain[-1]]) @ up) / tree.reaches[leg.first] for leg in leg_pair)
    up_chain = _up_chain(tree, hips, arms, legs, (up, _level(_across_pair(heads, arm_pair), up)))
    if drop < 0.4 or not up_chain:
        return
    if _across_pair(heads, leg_pair) @ _across_pair(heads, arm_pair) < 0:
        arm_pair = (arm_pair[1], arm_pair[0])
    cost = leg_pair[0].cost + arm_pair[0].cost + 2 * (1 - drop) + _oddity(tree, legs, arms, trunk)
    yield _Body(leg_pair, arm_pair, hips, arms.parent, up_chain, up, cost)


def _oddity(tree: Tree, legs: Twins, arms: Twins, trunk: Array) -> float:
    """How much two pairs of branches look like skirts, capes, wings or hair instead of legs and arms."""
    heads = tree.skeleton.heads
    length = float(np.linalg.norm(trunk))
    leg, arm = _reach(tree, legs), _reach(tree, arms)
    # Legs end near the lowest joints, arms begin well above them, and neither is much shorter than the other.
    heights = heads @ (trunk / length)
    gap = max(float(heights[chain[-1]]) for chain in legs.chains) - float(heights.min())
    cost = 3 * min(gap / leg, 0.5) + 6 * max(0.35 - length / leg, 0) + 4 * max(0.5 - min(leg, arm) / max(leg, arm), 0)
    # Arms spread at least a little: what the two sides have in common cancels out.
    ways = [heads[chain[-1]] - heads[chain[0]] for chain in arms.chains]
    spread = float(np.linalg.norm(ways[0] - ways[1])) / (2 * arm)
    return cost + 6 * max(0.25 - spread, 0)


def _middle(heads: Array, pair: Sequence[_Limb]) -> Array:
    return np.mean([heads[limb.first] for limb in pair], axis=0)


def _across_pair(heads: Array, pair: Sequence[_Limb]) -> Array:
    return heads[pair[0].second] - heads[pair[1].second]


def _across(tree: Tree, body: _Body) -> Array:
    """(3,) unit vector from the second side to the first, at right angles to up."""
    heads = tree.skeleton.heads
    return _level(_across_pair(heads, body.legs) + _across_pair(heads, body.arms), body.up)


def _level(way: Array, up: Array) -> Array:
    """(3,) the unit vector nearest to a direction that is at right angles to up."""
    level = way - (way @ up) * up
    return level / max(float(np.linalg.norm(level)), 1e-9)


# --- the joints of a limb -------------------------------------------------------------------------------------------


def _limbs(tree: Tree, twins: Twins, wanted: _Proportions) -> tuple[_Limb, _Limb] | None:
    """The same three joints on both sides, those that divide the chains best; two if there are no more."""
    one, other = twins.chains
    count = min(len(one), len(other))
    if count < 2:
        return None
    if count == 2:
        return _Limb(one, one[0], one[1], -1, 1.0), _Limb(other, other[0], other[1], -1, 1.0)
    choices = combinations(range(count), 3)
    costs = {j: sum(_cost(tree, chain, j, wanted) for chain in twins.chains) / 2 for j in choices}
    for joints in costs:
        costs[joints] += _nearness(tree, twins, joints, wanted)
    best = min(costs, key=costs.__getitem__)
    i, j, k = best
    return _Limb(one, one[i], one[j], one[k], costs[best]), _Limb(other, other[i], other[j], other[k], costs[best])


def _cost(tree: Tree, chain: tuple[int, ...], joints: tuple[int, int, int], wanted: _Proportions) -> float:
    """How unlike a human limb one is with these joints."""
    points = tree.skeleton.heads[list(chain)]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    i, j, k = joints
    upper, lower = np.linalg.norm(points[j] - points[i]), np.linalg.norm(points[k] - points[j])
    length = upper + lower
    # Both segments are about equally long, though not in every cartoon; and straight: what bends within is a joint.
    uneven = abs(np.log(upper / lower))
    cost = uneven + 3 * min(uneven, 0.35)
    cost += 3 * (steps[i:j].sum() / upper - 1 + steps[j:k].sum() / lower - 1)
    # Bones that divide a segment, as those for twisting do, are the exception.
    cost += 0.35 * (k - i - 2)
    # Little comes before the first joint, and a hand or foot after the third.
    cost += 2 * max(steps[:i].sum() / length - 0.4, 0)
    rest = max(steps[k:].sum() / length, 0.05)
    longer = np.log(rest / wanted.rest)
    cost += wanted.too_long * max(longer, 0) + 0.4 * max(-longer, 0)
    # Fingers begin at the hand, not before.
    return float(cost + sum(_is_fan(tree, chain[joint]) for joint in range(i, k)))


def _nearness(tree: Tree, twins: Twins, joints: tuple[int, int, int], wanted: _Proportions) -> float:
    """0..3 how much too close together both limbs would begin."""
    one, other = twins.chains
    length = tree.distance(one[joints[0]], one[joints[1]]) + tree.distance(one[joints[1]], one[joints[2]])
    apart = tree.distance(one[joints[0]], other[joints[0]]) / length
    return 3 * max(1 - apart / wanted.apart, 0.0)


def _is_fan(tree: Tree, bone: int) -> bool:
    """Whether several chains leave a bone, as fingers leave a hand."""
    return sum(tree.reaches[child] > 0 for child in tree.children[bone]) > 1


# --- spine, neck and head -------------------------------------------------------------------------------------------


def _spine(tree: Tree, body: _Body) -> list[int]:
    """Bones above the hips up to that from which the arms branch."""
    line = tree.line(body.chest)
    return list(reversed(line[: line.index(body.hips)]))


def _up_chain(tree: Tree, hips: int, arms: Twins, legs: Twins, axes: tuple[Array, Array]) -> tuple[int, ...]:
    """From above the arms to the top: the branch of the chest, or of a bone below it, that rises highest in the middle.

    Args:
        tree: of the rig.
        hips: the lowest bone to look at.
        arms, legs: no part of the branch.
        axes: unit vectors upwards and across.
    """
    up, across = axes
    middle = np.mean([tree.skeleton.heads[chain[0]] for chain in arms.chains], axis=0)
    offsets = tree.skeleton.heads - middle
    rises = offsets @ up - np.abs(offsets @ across)
    limbs = {chain[0] for twins in (arms, legs) for chain in twins.chains}
    line = tree.line(arms.parent)
    for bone in line[: line.index(hips) + 1]:
        branches = [c for c in tree.children[bone] if c not in line and not limbs & set(tree.line(c))]
        heights = {c: max(float(rises[b]) for b in tree.below(c)) for c in branches}
        best = max(heights, key=heights.__getitem__, default=None)
        if best is not None and heights[best] > 0.02 * tree.size:
            return _risen(tree, best)
    return ()


def _risen(tree: Tree, bone: int) -> tuple[int, ...]:
    """A single line of bones upwards, up to one from which several branches leave, as a face's bones do."""
    path = [bone]
    while len(children := tree.children[path[-1]]) in {1, 2}:
        if len(children) == 2 and abs(tree.reaches[children[0]] - tree.reaches[children[1]]) < 0.01 * tree.size:
            break
        path.append(max(children, key=lambda c: tree.counts[c]))
    return tuple(path)


def _neck_and_head(tree: Tree, body: _Body) -> tuple[int | None, int, float]:
    """The lowest bone above the chest as the neck, the head, and how sure that is."""
    path = [body.up_chain[0], *(b for a, b in pairwise(body.up_chain) if not tree.coincide(a, b))]
    leg = float(tree.reaches[body.legs[0].first])
    steps = [tree.distance(a, b) for a, b in pairwise(path)]
    # A last bone far above the one before marks the top of the head.
    if len(path) > 2 and not tree.children[path[-1]] and steps[-1] > max(0.12 * leg, 1.4 * max(steps[:-1])):
        path = path[:-1]
    trust = 0.9 if len(path) > 1 else 0.6
    return (path[0] if len(path) > 1 else None), path[-1], trust


# --- sides ----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Front:
    """Where the body faces: a unit vector at right angles to up, and how sure that is."""

    direction: Array
    trust: float


def _front(tree: Tree, body: _Body) -> _Front:
    """What toes, knees, elbows and the face say, each by how far it stands out."""
    heads = tree.skeleton.heads
    across = _across(tree, body)
    ahead = np.cross(across, body.up)
    votes = [float(vote @ ahead) for vote in _signs_of_front(tree, body, heads)]
    total, weight = sum(votes), sum(map(abs, votes))
    trust = 0.5 + 0.5 * abs(total) / weight * min(abs(total) / 0.1, 1.0) if weight > 0 else 0.5
    return _Front(ahead if total >= 0 else -ahead, trust)


def _signs_of_front(tree: Tree, body: _Body, heads: Array) -> Iterator[Array]:
    """Vectors that point forward, in limb lengths."""
    for leg in body.legs:
        length = float(tree.reaches[leg.first])
        foot = leg.third if leg.third >= 0 else _loose_foot(tree, body, leg)
        if foot is None:
            continue
        yield 2 * (heads[tree.chain(foot)[-1]] - heads[foot]) / length
        yield _bend(heads[leg.first], heads[leg.second], heads[foot]) / length
    for arm in body.arms:
        if arm.third >= 0:
            yield -_bend(heads[arm.first], heads[arm.second], heads[arm.third]) / float(tree.reaches[arm.first])
    face = list(tree.below(body.up_chain[-1]))[1:]
    if len(face) > 1:
        yield (np.mean(heads[face], axis=0) - heads[body.up_chain[-1]]) / float(tree.reaches[body.legs[0].first])


def _bend(start: Array, middle: Array, end: Array) -> Array:
    """From the straight line between two joints to the one between them."""
    along = (end - start) / np.linalg.norm(end - start)
    offset = middle - start
    return offset - (offset @ along) * along


# --- roles of limbs -------------------------------------------------------------------------------------------------


def _limb_roles(tree: Tree, body: _Body, number: int, front: Array) -> Iterable[tuple[str, int, float]]:
    leg, arm = body.legs[number], body.arms[number]
    trust = float(np.exp(-leg.cost / 8))
    yield "thigh", leg.first, trust
    yield "shin", leg.second, trust
    foot = leg.third if leg.third >= 0 else _loose_foot(tree, body, leg)
    if foot is not None:
        yield "foot", foot, trust if leg.third >= 0 else 0.7 * trust
        toe = _toe(tree, foot, front)
        if toe is not None:
            yield "toe", toe, trust if tree.children[toe] else 0.8 * trust
    trust = float(np.exp(-arm.cost / 8))
    if arm.before:
        yield "clavicle", arm.before[0], trust
    yield "upper_arm", arm.first, trust
    yield "forearm", arm.second, trust
    if arm.third >= 0 and not _is_split(tree, arm):
        yield "hand", arm.third, trust


def _toe(tree: Tree, foot: int, front: Array) -> int | None:
    """The only bone of a foot that lies before it; single toes are no toe."""
    ahead = [c for c in tree.children[foot] if (tree.skeleton.heads[c] - tree.skeleton.heads[foot]) @ front > 0]
    return ahead[0] if len(ahead) == 1 else None


def _is_split(tree: Tree, arm: _Limb) -> bool:
    """Whether several fingers leave the forearm's end at one place, so that no single bone turns the hand."""
    siblings = [c for c in tree.children[tree.skeleton.parents[arm.third]] if c != arm.third]
    return any(tree.distance(arm.third, other) < 0.01 * tree.size and tree.reaches[other] > 0 for other in siblings)


def _loose_foot(tree: Tree, body: _Body, leg: _Limb) -> int | None:
    """A foot that does not hang on its shin but stands below the knee, as in rigs made for inverse kinematics."""
    heads = tree.skeleton.heads
    thigh = tree.distance(leg.first, leg.second)
    inside = {b for limb in (*body.legs, *body.arms) for b in tree.below(limb.chain[0])}
    offsets = heads - heads[leg.second]
    drops = -offsets @ body.up
    aside = np.linalg.norm(offsets + drops[:, None] * body.up, axis=1)
    near = (0.4 * thigh < drops) & (drops < 2.5 * thigh) & (aside < 0.6 * thigh)
    fits = [int(bone) for bone in np.flatnonzero(near) if bone not in inside]
    return min(fits, key=lambda bone: aside[bone], default=None)
