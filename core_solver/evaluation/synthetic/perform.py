"""From a script to joint rotations: pelvis over the feet, legs by inverse kinematics, trunk and arms by gestures."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d

from core_solver.body.skeleton import joint_index
from core_solver.evaluation.synthetic.legs import bend_legs, highest_pelvis, longest_reach
from core_solver.evaluation.synthetic.path import GESTURES, GRAVITY, RootPath, Script, root_path
from core_solver.evaluation.synthetic.physique import SIDES, Physique
from core_solver.evaluation.synthetic.steps import FootMotion, move_feet, plan_steps
from core_solver.evaluation.synthetic.world import Terrain
from core_solver.geometry import matrix_from_rotvec

Array = NDArray[np.float64]

# Rest axes of the body (x left, y up, z front) in a world (z up) in which it faces along x.
_FACING_X = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_AHEAD = 0.042  # of the stature: the pelvis before the ankles
_SITTING_BACK = 0.25
_STANDING = 0.985  # of the longest reach: nobody stands with locked knees


@dataclass(frozen=True)
class Performance:
    """A person's motion, world frame, metres.

    Attributes:
        rotations: (T, 24, 3, 3) relative to the parent; the root's from the rest pose to the world.
        pelvis: (T, 3) place of the root joint.
    """

    rotations: Array
    pelvis: Array


def perform(script: Script, person: Physique, terrain: Terrain, times: Array, rng: np.random.Generator) -> Performance:
    """Act a script.

    Args:
        script: what to do.
        person: who.
        terrain: where.
        times: (T,) seconds.
        rng: for small habits.
    """
    path = root_path(script, float(times[-1]))
    first, steps = plan_steps(path, person, terrain)
    feet = move_feet(first, steps, person, times)
    rate = 1 / float(np.median(np.diff(times))) if len(times) > 1 else 30.0
    swing = _stride(feet, path, times, rate)
    upright = _pelvis_rotation(path, times, swing)
    pelvis = _pelvis(path, feet, person, upright, times, rate)
    rotations = np.broadcast_to(np.eye(3), (len(times), 24, 3, 3)).copy()
    rotations[:, 0] = upright
    bend_legs(rotations, pelvis, feet.ankle, feet.rotation, feet.toe_bend, person)
    _pose_trunk(rotations, path, times, swing, rng)
    _pose_arms(rotations, path, times, swing, rng)
    return Performance(rotations, pelvis)


def _stride(feet: FootMotion, path: RootPath, times: Array, rate: float) -> Array:
    """(T,) metres by which the left foot is ahead of the right one, smooth."""
    heading = path.at(path.heading, times)
    front = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    ahead = np.einsum("tc,tc->t", feet.ankle[:, 0, :2] - feet.ankle[:, 1, :2], front)
    return gaussian_filter1d(ahead, 0.05 * rate, mode="nearest")


def _pelvis_rotation(path: RootPath, times: Array, swing: Array) -> Array:
    heading = path.at(path.heading, times)
    dance = path.at(path.gestures, times)[:, GESTURES.index("dance")]
    # The hip goes forwards with its leg: the left one ahead turns the pelvis to the right.
    yaw = heading - 0.12 * swing + dance * 0.25 * np.sin(2 * np.pi * 0.9 * times)
    roll = dance * 0.10 * np.sin(2 * np.pi * 0.9 * times + 1)
    turn = matrix_from_rotvec(np.stack([0 * yaw, 0 * yaw, yaw], axis=1))
    return turn @ _FACING_X @ matrix_from_rotvec(np.stack([0 * yaw, 0 * yaw, roll], axis=1))


def _pelvis(path: RootPath, feet: FootMotion, person: Physique, upright: Array, times: Array, rate: float) -> Array:
    """(T, 3): follows the path, leans over the loaded foot, and is never farther from a foot than the leg is long."""
    sigma = 0.11 * rate
    loaded = np.einsum("tf,tfc->tc", feet.load - 0.5, feet.ankle[..., :2])
    heading = path.at(path.heading, times)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    shift = gaussian_filter1d(np.einsum("tc,tc->t", loaded, left), sigma, mode="nearest")
    dance = path.at(path.gestures, times)[:, GESTURES.index("dance")]
    shift = 0.45 * shift + dance * 0.05 * person.leg * np.sin(2 * np.pi * 0.9 * times)
    # Who stands has the centre of mass over the middle of the feet, which reach farther to the front than behind;
    # who crouches, whose trunk leans forwards, sits back.
    ahead = _AHEAD * person.height - _SITTING_BACK * person.leg * path.at(path.crouch, times)
    front = np.stack([np.cos(heading), np.sin(heading)], axis=1)
    place = path.at(path.position, times) + shift[:, None] * left + ahead[:, None] * front

    hips = np.stack([upright @ person.bone(f"{side}_hip", "pelvis") for side in SIDES], axis=1)
    reach = longest_reach(person)
    stand = person.ankle_height.mean() + _STANDING * reach.mean() - hips[..., 2].mean(axis=1)
    crouch = path.at(path.crouch, times) * person.leg
    bounce = dance * 0.03 * person.leg * (1 - np.cos(2 * np.pi * 1.8 * times))
    ground = gaussian_filter1d(feet.ground.mean(axis=1), sigma, mode="nearest")
    flight = _flight(path, times)
    height = highest_pelvis(
        place, ground + stand - crouch - bounce, feet.ankle - [0, 0, 1] * flight[:, None, None], upright, person, rate
    )
    return np.column_stack([place, height + flight])


def _flight(path: RootPath, times: Array) -> Array:
    """(T,) metres by which jumps lift the body."""
    height = np.zeros(len(times))
    for takeoff, landing in path.jumps:
        inside = (times > takeoff) & (times < landing)
        height[inside] = GRAVITY / 2 * ((times - takeoff) * (landing - times))[inside]
    return height


def _pose_trunk(rotations: Array, path: RootPath, times: Array, swing: Array, rng: np.random.Generator) -> None:
    gestures = path.at(path.gestures, times)
    speed = np.linalg.norm(path.velocity(times), axis=1)
    crouch = path.at(path.crouch, times)
    dance = gestures[:, GESTURES.index("dance")]
    idle = [wander(rng, times, 0.25) for _ in range(6)]
    # The trunk turns against the pelvis and leans a little forwards with speed and when crouching.
    lean = 0.02 * speed + 0.55 * crouch + 0.03 * idle[0]
    twist = 0.05 * swing + 0.05 * idle[1] - 0.10 * dance * np.sin(2 * np.pi * 0.9 * times)
    side = 0.03 * idle[2] - 0.06 * dance * np.sin(2 * np.pi * 0.9 * times + 1)
    for name in ("spine1", "spine2", "spine3"):
        rotations[:, joint_index(name)] = matrix_from_rotvec(np.stack([lean, twist, side], axis=1))
    look = np.stack([-0.8 * lean + 0.08 * idle[3], 0.20 * idle[4], 0.05 * idle[5]], axis=1)
    for name in ("neck", "head"):
        rotations[:, joint_index(name)] = matrix_from_rotvec(look)


@dataclass(frozen=True)
class _Arm:
    """How an arm is held, radians, (T,) each: lowered from the T-pose, swung forwards, twisted, folded at the elbow."""

    lower: Array
    swing: Array
    twist: Array
    fold: Array

    def blend(self, shares: Array, others: Sequence["_Arm"]) -> "_Arm":
        """This pose mixed with (T, G) shares of G others."""

        def mixed(own: Array, goals: Sequence[Array]) -> Array:
            return own + np.sum([share * (goal - own) for share, goal in zip(shares.T, goals, strict=True)], axis=0)

        return _Arm(
            mixed(self.lower, [other.lower for other in others]),
            mixed(self.swing, [other.swing for other in others]),
            mixed(self.twist, [other.twist for other in others]),
            mixed(self.fold, [other.fold for other in others]),
        )


def _pose_arms(rotations: Array, path: RootPath, times: Array, swing: Array, rng: np.random.Generator) -> None:
    gestures = path.at(path.gestures, times)
    leg_swing = swing / 0.9
    for side, (name, sign) in enumerate(zip(SIDES, (1.0, -1.0), strict=True)):
        arm = _arm(times, gestures, -sign * leg_swing, side, rng)
        turn = _about(0, -arm.swing) @ _about(2, -sign * arm.lower) @ _about(0, -arm.twist)
        rotations[:, joint_index(f"{name}_shoulder")] = turn
        rotations[:, joint_index(f"{name}_elbow")] = _about(1, -sign * arm.fold)
        droop = 0.15 * wander(rng, times, 0.5)
        rotations[:, joint_index(f"{name}_wrist")] = _about(2, sign * droop)


def _arm(times: Array, gestures: Array, swing: Array, side: int, rng: np.random.Generator) -> _Arm:
    wander_a, wander_b, wander_c = (wander(rng, times, 0.6) for _ in range(3))
    beat = 2 * np.pi * 0.9 * times
    hanging = _Arm(1.28 + 0.04 * wander_a, 0.9 * swing + 0.04 * wander_b, 0 * times, 0.35 + 0.4 * np.maximum(swing, 0))
    talking = _Arm(1.15 + 0.1 * wander_a, 0.35 + 0.25 * wander_b, 0 * times, 1.2 + 0.45 * wander_c)
    wave = 0.4 * np.sin(2 * np.pi * 1.8 * times)
    waving = hanging if side == 0 else _Arm(0.15 + 0 * times, 0 * times, 1.45 + 0 * times, 1.35 + wave)
    cheering = _Arm(-0.9 + 0.12 * np.sin(2 * beat), 0 * times, 0.6 + 0 * times, 0.6 + 0.3 * np.sin(2 * beat))
    dancing = _Arm(0.6 + 0.4 * np.sin(beat + 2 * side), 0.3 * np.cos(beat), 0.4 + 0 * times, 1.0 + 0.5 * np.cos(beat))
    return hanging.blend(gestures, (waving, talking, cheering, dancing))  # in the order of GESTURES


def wander(rng: np.random.Generator, times: Array, frequency: float) -> Array:
    """A smooth random signal (T,) of unit variance about 0, up to `frequency` hertz."""
    rates = frequency * rng.uniform(0.2, 1.0, size=3)
    phases = rng.uniform(0, 2 * np.pi, size=3)
    return np.sin(2 * np.pi * times[:, None] * rates + phases).sum(axis=1) * np.sqrt(2 / 3)


def _about(axis: int, angle: Array) -> Array:
    """(T, 3, 3) rotations about one of the rest axes."""
    return matrix_from_rotvec(angle[:, None] * np.eye(3)[axis])
