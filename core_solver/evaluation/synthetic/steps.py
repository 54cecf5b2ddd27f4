"""Footsteps that follow a path: planted feet rest exactly, flat on the terrain; the others swing over it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.evaluation.synthetic.path import GRAVITY, RootPath
from core_solver.evaluation.synthetic.physique import SIDES, Physique
from core_solver.evaluation.synthetic.world import Terrain

Array = NDArray[np.float64]

_DOUBLE_SUPPORT = 0.22  # share of a step's time in which both feet stand
_AHEAD = 0.38  # of the way that passes over a standing foot, this share lies before it
_SPACING = 0.055  # of the stature: a foot's distance from the middle line
_MISPLACED = 0.09  # metres (of an adult) at which a foot is moved after the body
_HEEL_RISE = 0.75  # radians to which the heel rises at the highest speed
_CLEARANCE = 0.06


@dataclass(frozen=True)
class Foothold:
    """Where a foot stands.

    Attributes:
        point: (3,) of the surface below the ankle, world metres.
        heading: radians.
        normal: (3,) of the surface.
    """

    point: Array
    heading: float
    normal: Array

    @property
    def frame(self) -> Array:
        """(3, 3) rotation from the body's rest axes (left, up, front) to the world: flat on the surface."""
        front = np.array([np.cos(self.heading), np.sin(self.heading), 0.0])
        left = np.cross(self.normal, front)
        left /= np.linalg.norm(left)
        return np.stack([left, self.normal, np.cross(left, self.normal)], axis=1)


@dataclass(frozen=True)
class Step:
    """A foot leaves one place for another.

    Attributes:
        side: 0 left, 1 right.
        lift: seconds at which the toes leave the ground.
        land: seconds at which the foot stands again.
        start: where it stood.
        end: where it will stand.
        heel_rise: radians by which the heel has risen when the toes leave.
        jump_height: metres, 0 for a step.
    """

    side: int
    lift: float
    land: float
    start: Foothold
    end: Foothold
    heel_rise: float
    jump_height: float = 0.0


@dataclass(frozen=True)
class FootMotion:
    """Both feet over T frames, world frame, metres.

    Attributes:
        ankle: (T, 2, 3).
        rotation: (T, 2, 3, 3) of the foot behind the ball, from the rest pose.
        toe_bend: (T, 2) radians by which the toes are bent up against the foot.
        load: (T, 2) share of the weight on each foot.
        ground: (T, 2) height of the surface where the foot stands or of the line between its two places.
    """

    ankle: Array
    rotation: Array
    toe_bend: Array
    load: Array
    ground: Array


def plan_steps(path: RootPath, person: Physique, terrain: Terrain) -> tuple[tuple[Foothold, Foothold], list[Step]]:
    """First footholds, and the steps that keep the feet below the body."""
    leg = person.leg / 0.85
    start, stop = path.times[0] + 0.1, path.times[-1] - 0.8
    feet = [_foothold(path, person, terrain, side, start, 0.0) for side in (0, 1)]
    first = (feet[0], feet[1])
    steps: list[Step] = []
    time, last, jumps = start, 1, list(path.jumps)
    while time < stop:
        speed = float(np.linalg.norm(path.velocity(time)))
        pace = np.interp(speed / leg, (0.3, 1.6), (0.62, 0.46)) * np.sqrt(leg)
        if jumps and time + pace > jumps[0][0]:
            time = _jump(path, person, terrain, feet, steps, jumps.pop(0))
            continue
        land = time + pace * (1 - _DOUBLE_SUPPORT)
        lead = _AHEAD * pace * (1 + _DOUBLE_SUPPORT)
        wanted = [_foothold(path, person, terrain, side, land, lead) for side in (0, 1)]
        misplaced = [_misplacement(foot, want) / leg for foot, want in zip(feet, wanted, strict=True)]
        side = 1 - last if misplaced[1 - last] > _MISPLACED else int(np.argmax(misplaced))
        if misplaced[side] <= _MISPLACED:
            time += 1 / 30
            continue
        forward = (wanted[side].point - feet[side].point) @ feet[side].frame[:, 2]
        climb = abs(wanted[side].point[2] - feet[side].point[2])
        rise = _HEEL_RISE * float(np.clip(forward / (1.2 * leg) + climb / (0.4 * leg), 0, 1))
        steps.append(Step(side, time, land, feet[side], wanted[side], rise))
        feet[side], last, time = wanted[side], side, time + pace
    return first, steps


def _jump(
    path: RootPath, person: Physique, terrain: Terrain, feet: list[Foothold], steps: list[Step],
    jump: tuple[float, float],
) -> float:  # fmt: skip
    takeoff, landing = jump
    height = GRAVITY * (landing - takeoff) ** 2 / 8
    for side in (0, 1):
        end = _foothold(path, person, terrain, side, landing, 0.1)
        steps.append(Step(side, takeoff, landing, feet[side], end, 0.3, height))
        feet[side] = end
    return landing + 0.25


def _foothold(path: RootPath, person: Physique, terrain: Terrain, side: int, time: float, lead: float) -> Foothold:
    heading = float(path.at(path.heading, time))
    across = (1 - 2 * side) * _SPACING * person.height * np.array([-np.sin(heading), np.cos(heading)])
    place = path.at(path.position, time) + lead * path.velocity(time) + across
    return _on_terrain(place, heading, person, terrain, side)


def _on_terrain(place: Array, heading: float, person: Physique, terrain: Terrain, side: int) -> Foothold:
    """The nearest place along the foot's direction where the whole sole has one plane below it."""
    front = np.array([np.cos(heading), np.sin(heading)])
    along = np.linspace(-person.heel[side] - 0.015, person.toe[side] + 0.015, 7)
    left = np.array([-front[1], front[0]])
    for shift in sorted(np.linspace(-0.3, 0.3, 31), key=abs):
        spot = place + shift * front
        sole = spot + along[:, None] * front
        sole = np.concatenate([sole - 0.06 * left, sole + 0.06 * left])
        height, normal = terrain.height(spot), terrain.normal(spot)
        plane = height - (sole - spot) @ normal[:2] / normal[2]
        if np.abs(terrain.height(sole) - plane).max() < 1e-6:
            return Foothold(np.append(spot, height), heading, normal)
    return Foothold(np.append(place, terrain.height(place)), heading, terrain.normal(place))


def _misplacement(foot: Foothold, wanted: Foothold) -> float:
    turn = np.angle(np.exp(1j * (foot.heading - wanted.heading)))
    return float(np.linalg.norm((foot.point - wanted.point)[:2]) + 0.3 * abs(turn))


def move_feet(first: tuple[Foothold, Foothold], steps: list[Step], person: Physique, times: Array) -> FootMotion:
    """Both feet at (T,) times."""
    count = len(times)
    ankle, rotation = np.zeros((count, 2, 3)), np.zeros((count, 2, 3, 3))
    bend, lifted, ground = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 2))
    for side in (0, 1):
        own = [step for step in steps if step.side == side]
        foothold = first[side]
        rows = np.searchsorted([step.lift - _heel_off_seconds(step) for step in own], times, side="right") - 1
        for t, row in enumerate(rows):
            pose = _Pose(foothold.point, foothold.frame, 0.0, 0.0) if row < 0 else _pose_in_step(own[row], times[t])
            ankle[t, side], rotation[t, side] = _place(pose, person, side)
            bend[t, side], lifted[t, side], ground[t, side] = pose.pitch, pose.lifted, pose.point[2] - pose.raised
    load = 1 - lifted
    load = load / np.maximum(load.sum(axis=1, keepdims=True), 1e-9)
    load[lifted.min(axis=1) > 0.99] = 0.5
    return FootMotion(ankle, rotation, bend, load, ground)


@dataclass(frozen=True)
class _Pose:
    """A foot: the surface point below the ankle if it were flat, its flat frame, heel rise, whether it is lifted."""

    point: Array
    frame: Array
    pitch: float
    lifted: float
    raised: float = 0.0


def _heel_off_seconds(step: Step) -> float:
    return 0.35 * (step.land - step.lift) if step.heel_rise > 0 else 0.0


def _pose_in_step(step: Step, time: float) -> _Pose:
    if time <= step.lift:
        rising = _smooth(1 - (step.lift - time) / max(_heel_off_seconds(step), 1e-9))
        return _Pose(step.start.point, step.start.frame, step.heel_rise * rising, 0.0)
    u = (time - step.lift) / (step.land - step.lift)
    if u >= 1:
        return _Pose(step.end.point, step.end.frame, 0.0, 0.0)
    climb = step.end.point[2] - step.start.point[2]
    # Upwards the foot rises before it goes forwards, downwards it goes forwards before it sinks.
    s = _smooth(u if climb <= 0 else (u - 0.25) / 0.75)
    point = (1 - s) * step.start.point + s * step.end.point
    level = _smooth(2 * u) if climb > 0 else _smooth(1.7 * u - 0.7)
    raised = 16 * u**2 * (1 - u) ** 2 * (_CLEARANCE + 0.5 * abs(climb))
    if step.jump_height:
        raised = 4 * u * (1 - u) * step.jump_height
    point[2] = step.start.point[2] + level * climb + raised
    turn = float(np.angle(np.exp(1j * (step.end.heading - step.start.heading))))
    normal = (1 - s) * step.start.normal + s * step.end.normal
    frame = Foothold(point, step.start.heading + s * turn, normal / np.linalg.norm(normal)).frame
    return _Pose(point, frame, step.heel_rise * _smooth(1 - 1.4 * u), 1.0, raised)


def _place(pose: _Pose, person: Physique, side: int) -> tuple[Array, Array]:
    """Ankle and foot rotation: the heel rises about the ball, which stays where it is."""
    ball = person.bone(f"{SIDES[side]}_foot", f"{SIDES[side]}_ankle")
    cosine, sine = np.cos(pose.pitch), np.sin(pose.pitch)
    tilt = np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    rotation = pose.frame @ tilt
    ankle = pose.point + pose.frame @ (np.array([0, person.ankle_height[side], 0]) + ball) - rotation @ ball
    return ankle, rotation


def _smooth(u: float) -> float:
    """From 0 to 1 with the least jerk."""
    u = min(max(u, 0.0), 1.0)
    return u**3 * (10 - 15 * u + 6 * u**2)
