"""Drawing people: who they are and what they do before a camera, without walking through each other."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.evaluation.synthetic.path import Move, Script, root_path
from core_solver.evaluation.synthetic.physique import Physique, draw_physique
from core_solver.evaluation.synthetic.recording import Recording
from core_solver.evaluation.synthetic.replay import Replay
from core_solver.evaluation.synthetic.scenery import Shot, low_blocks
from core_solver.evaluation.synthetic.stage import Role
from core_solver.evaluation.synthetic.world import Terrain

Array = NDArray[np.float64]

ACTS = (
    "walk", "walk", "cross", "cross", "enter", "enter", "leave", "leave", "stand", "wave", "talk", "dance", "jump",
    "crouch", "cheer",
)  # fmt: skip
"""Who walks is more often seen than who stands."""
_MEAN_STATURES_M = (1.59, 1.71)
_APART_M = 0.55
_FREE_M = 0.35  # from blocks
_TRIES = 300
_CAPTURED = 0.6  # of the people where there are recordings


@dataclass(frozen=True)
class Setting:
    """What is known before people come.

    Attributes:
        shot: the camera.
        terrain: the scenery.
        seconds: length of the clip.
        recordings: captured motion that may be used on level ground.
    """

    shot: Shot
    terrain: Terrain
    seconds: float
    recordings: tuple[Recording, ...] = ()


def draw_height(rng: np.random.Generator, child: bool) -> float:
    """A stature in metres: children 0.95 to 1.45, women and men as in the whole world (NCD-RisC 2016)."""
    if child:
        return float(rng.uniform(0.95, 1.45))
    return float(np.clip(rng.normal(rng.choice(_MEAN_STATURES_M), 0.07), 1.5, 1.95))


def draw_roles(
    rng: np.random.Generator, body: BodyModel, setting: Setting, children: Sequence[bool], acts: Sequence[str]
) -> tuple[Role, ...]:
    """People who keep clear of each other and of blocks.

    Args:
        rng: random numbers.
        body: body model.
        setting: camera, scenery and length.
        children: for each person.
        acts: for each person, from ACTS; where there are steps or a low box, the first one climbs or stands there.
    """
    roles: list[Role] = []
    taken: list[Array] = []
    for number, (child, act) in enumerate(zip(children, acts, strict=True)):
        person = draw_physique(rng, body, draw_height(rng, child))
        draw, avoids_blocks = _way_to_draw(rng, setting, person, act, is_first=number == 0)
        drawn = _clearest(draw, person, act, setting, taken, avoids_blocks)
        roles.append(Role(person, drawn))
        taken.append(_track(drawn, person, setting.seconds))
    return tuple(roles)


def _way_to_draw(
    rng: np.random.Generator, setting: Setting, person: Physique, act: str, is_first: bool
) -> tuple[Callable[[], Script | Replay], bool]:
    """How to draw somebody's motion, and whether it has to keep clear of blocks."""
    if is_first and low_blocks(setting.terrain):
        return lambda: _raised_script(rng, setting.terrain, person), False
    if setting.recordings and not any(setting.terrain.gradient) and rng.random() < _CAPTURED:
        return lambda: _draw_replay(rng, setting), True
    return lambda: draw_script(rng, setting, person, act), True


def _clearest(
    draw: Callable[[], Script | Replay], person: Physique, act: str, setting: Setting, taken: list[Array],
    avoids_blocks: bool,
) -> Script | Replay:  # fmt: skip
    """The first motion that keeps clear of everything, or of many the one that came nearest to that."""
    best = draw()
    clearest = 0.0
    for _ in range(_TRIES):
        motion = draw()
        track = _track(motion, person, setting.seconds)
        distances = [np.linalg.norm(track - other, axis=1).min() / _APART_M for other in taken]
        if avoids_blocks:
            distances += [block.distance(track).min() / _FREE_M for block in setting.terrain.blocks]
        clear = min([1.0, _shown(setting.shot, track, act), *map(float, distances)])
        if clear > clearest:
            best, clearest = motion, clear
        if clearest >= 1:
            break
    return best


def _track(motion: Script | Replay, person: Physique, seconds: float) -> Array:
    """(K, 2) places over the ground, ten a second."""
    times = np.arange(0, seconds + 0.1, 0.1)
    if isinstance(motion, Replay):
        return motion.track(person, times)
    path = root_path(motion, seconds)
    return path.at(path.position, times)


def _shown(shot: Shot, track: Array, act: str) -> float:
    """1 if as much of the path is in the picture as its act wants, less the less it is."""
    inside = (np.abs(np.arctan2(track[:, 0], track[:, 1])) < 0.85 * shot.half_angle) & (track[:, 1] > 0.85 * shot.near)
    wanted = 0.45 if act in {"enter", "leave"} else 0.9
    return min(float(inside.mean()) / wanted, 1.0)


def _draw_replay(rng: np.random.Generator, setting: Setting) -> Replay:
    recording = setting.recordings[rng.integers(len(setting.recordings))]
    begin = float(rng.uniform(0, max(recording.length - setting.seconds, 0.0)))
    place, _ = _draw_place(rng, setting.shot)
    return Replay(recording, begin, place, float(rng.uniform(0, 2 * np.pi)))


def _draw_place(rng: np.random.Generator, shot: Shot) -> tuple[tuple[float, float], float]:
    """A place in the picture, and half the picture's width there, metres."""
    distance = float(rng.uniform(shot.near, shot.far))
    half = distance * float(np.tan(shot.half_angle))
    return (float(rng.uniform(-0.75, 0.75)) * half, distance), half


def _raised_script(rng: np.random.Generator, terrain: Terrain, person: Physique) -> Script:
    """Up a flight of steps, or standing on the first low block."""
    blocks = low_blocks(terrain)
    first = blocks[0]
    climbs = len(blocks) > 1 and all(block.yaw == first.yaw for block in blocks)
    if not climbs:
        x, y = first.centre
        heading = float(np.arctan2(-y, -x) + rng.uniform(-0.8, 0.8))
        return Script((x, y), heading, (Move(1.0), Move(1.5, gesture=str(rng.choice(["talk", "wave", "dance"])))))
    axis = np.array([np.cos(first.yaw), np.sin(first.yaw)])
    speed = float(rng.uniform(0.5, 0.7)) * person.leg / 0.85
    start = np.array(first.centre) - axis * (first.size[0] / 2 + rng.uniform(0.4, 0.7))
    return Script((float(start[0]), float(start[1])), first.yaw, (Move(5.0, speed),))


def draw_script(rng: np.random.Generator, setting: Setting, person: Physique, act: str) -> Script:
    """A script for one of ACTS, somewhere in the picture."""
    seconds = setting.seconds
    place, half = _draw_place(rng, setting.shot)
    facing = float(np.arctan2(-place[1], -place[0]) + rng.uniform(-1.2, 1.2))
    speed = float(rng.uniform(0.7, 1.35)) * person.leg / 0.85
    if act in {"cross", "enter", "leave"}:
        return _across(rng, act, place[1], half, speed, seconds)
    if act == "walk":
        turn = float(rng.uniform(-1.4, 1.4))
        moves = (Move(0.4 * seconds, speed), Move(0.3 * seconds, 0.6 * speed, turn), Move(0.3 * seconds))
        return Script(place, float(rng.uniform(0, 2 * np.pi)), moves)
    if act == "jump":
        air, forwards = float(rng.uniform(0.28, 0.42)), float(rng.choice([0.0, 0.3]))
        return Script(place, facing, (Move(0.8), Move(1.1, forwards, jumps=air), Move(0.9, jumps=air)))
    if act == "crouch":
        return Script(place, facing, (Move(0.6), Move(1.4, crouch=float(rng.uniform(0.3, 0.5)))))
    if act == "stand":
        return Script(place, facing, (Move(seconds),))
    turn = float(rng.uniform(-0.8, 0.8))
    return Script(place, facing, (Move(0.4), Move(0.5 * seconds, gesture=act), Move(0.4, turn=turn)))


def _across(rng: np.random.Generator, act: str, distance: float, half: float, speed: float, seconds: float) -> Script:
    """From one side of the picture towards the other, from outside it or out of it if so asked."""
    side = float(rng.choice([-1.0, 1.0]))
    x = {"cross": 0.8 * half, "enter": half + 0.5, "leave": half - 0.75 * speed * seconds}[act] * side
    outwards = 0.0 if side > 0 else np.pi
    heading = outwards if act == "leave" else outwards + np.pi
    return Script((x, distance), heading + float(rng.uniform(-0.3, 0.3)), (Move(seconds, speed),))


def circling_roles(rng: np.random.Generator, body: BodyModel, people: int, seconds: float) -> tuple[Role, ...]:
    """People in rows of three who walk in circles of their own for as long as you like; every third is a child."""
    roles = []
    lasting = max(seconds, 1.0)
    for number in range(people):
        person = draw_physique(rng, body, draw_height(rng, child=number % 3 == 1))
        row, column = divmod(number, 3)
        start = (1.9 * (column - 1) + 0.9 * (row % 2), 5.0 + 1.7 * row)
        speed = 0.7 * person.leg / 0.85
        turn = float(rng.choice([-1.0, 1.0])) * speed / 0.55 * lasting
        roles.append(Role(person, Script(start, float(rng.uniform(0, 2 * np.pi)), (Move(lasting, speed, turn),))))
    return tuple(roles)
