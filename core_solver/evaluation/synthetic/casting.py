"""Drawing scenes: cameras, scenery, people and what they do, all from one random generator."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.camera import Camera, camera_from_fov
from core_solver.evaluation.synthetic.path import Move, Script, root_path
from core_solver.evaluation.synthetic.physique import Physique, draw_physique
from core_solver.evaluation.synthetic.stage import Role
from core_solver.evaluation.synthetic.world import Block, Terrain, View, look

Array = NDArray[np.float64]

TERRAINS = ("flat", "slope", "stairs", "boxes", "walls")
ACTS = ("walk", "cross", "enter", "leave", "stand", "wave", "talk", "dance", "jump", "crouch", "cheer")
_PICTURES = ((1280, 720), (1920, 1080), (1080, 1920), (960, 720), (720, 960))
_APART_M = 0.55
_FREE_M = 0.35  # from blocks
_TRIES = 400


@dataclass(frozen=True)
class Shot:
    """A camera in the world.

    Attributes:
        camera: intrinsics.
        view: where it stands.
        near: metres over the ground to the nearest place where people act.
        far: to the farthest.
    """

    camera: Camera
    view: View
    near: float
    far: float

    def azimuth(self) -> float:
        """Half the angle that the picture covers sideways, radians."""
        return float(np.arctan(self.camera.width / (2 * self.camera.fx)))


def draw_shot(rng: np.random.Generator) -> Shot:
    """A camera 0.8 to 4 m high, tilted towards a place where people fit into the picture, rolled by a few degrees."""
    width, height = _PICTURES[rng.integers(len(_PICTURES))]
    camera = camera_from_fov(width, height, float(rng.uniform(38, 80)), "truth")
    upright = height / camera.fy  # height of the picture at distance 1
    near = float(np.clip(1.7 / upright, 2.5, 6.0))
    far = float(min(rng.uniform(1.6, 2.6) * near + 0.5, 12.0))
    position = np.array([0.0, 0.0, rng.uniform(0.8, 4.0)])
    target = np.array([0.0, 0.45 * near + 0.55 * far, rng.uniform(0.7, 1.1)])
    return Shot(camera, look(position, target, float(rng.normal(scale=np.radians(2.5)))), near, far)


def draw_terrain(rng: np.random.Generator, kind: str, shot: Shot) -> Terrain:
    """Scenery of a kind from TERRAINS; the camera stands above its ground."""
    middle = 0.5 * (shot.near + shot.far)
    walls = _back_walls(rng, shot) if rng.random() < 0.5 or kind == "walls" else ()
    if kind == "slope":
        steepness, direction = np.tan(np.radians(rng.uniform(3, 9))), rng.uniform(0, 2 * np.pi)
        return Terrain((float(steepness * np.cos(direction)), float(steepness * np.sin(direction))), walls)
    if kind == "stairs":
        return Terrain(blocks=(*stairs(rng, middle), *walls))
    if kind == "boxes":
        return Terrain(blocks=(*_boxes(rng, shot), *walls))
    if kind == "walls":
        width = float(rng.uniform(0.8, 1.6))
        side = float(rng.uniform(-0.5, 0.5) * shot.near)
        low = Block((side, shot.near + 0.3), (width, 0.2), float(rng.uniform(-0.3, 0.3)), float(rng.uniform(0.4, 0.9)))
        return Terrain(blocks=(low, *walls))
    return Terrain(blocks=walls)


def _back_walls(rng: np.random.Generator, shot: Shot) -> tuple[Block, ...]:
    distance = shot.far + float(rng.uniform(0.8, 4.0))
    return (Block((0.0, distance + 1.0), (60.0, 1.0), float(rng.uniform(-0.25, 0.25)), 4.0),)


def stairs(rng: np.random.Generator, distance: float) -> tuple[Block, ...]:
    """A flight of steps that ends on a platform."""
    count = int(rng.integers(3, 6))
    rise, tread, width = float(rng.uniform(0.12, 0.17)), float(rng.uniform(0.32, 0.40)), float(rng.uniform(1.8, 2.6))
    yaw = float(rng.choice([0.0, np.pi, 0.5 * np.pi]) + rng.uniform(-0.4, 0.4))
    axis = np.array([np.cos(yaw), np.sin(yaw)])
    foot = np.array([0.0, distance]) - axis * (count * tread / 2 + 0.4)
    blocks = []
    for number in range(count):
        deep = tread if number < count - 1 else 2.2
        centre = foot + axis * (number * tread + deep / 2)
        blocks.append(Block((float(centre[0]), float(centre[1])), (deep, width), yaw, rise * (number + 1)))
    return tuple(blocks)


def _boxes(rng: np.random.Generator, shot: Shot) -> tuple[Block, ...]:
    blocks = []
    for _ in range(int(rng.integers(2, 4))):
        distance = rng.uniform(shot.near, shot.far)
        side = rng.uniform(-0.6, 0.6) * distance * np.tan(shot.azimuth())
        size = rng.uniform(0.9, 1.5, size=2)
        yaw, top = rng.uniform(0, np.pi), rng.uniform(0.15, 0.55)
        blocks.append(Block((float(side), float(distance)), (float(size[0]), float(size[1])), float(yaw), float(top)))
    return tuple(blocks)


def draw_height(rng: np.random.Generator, child: bool) -> float:
    """A stature in metres."""
    if child:
        return float(rng.uniform(0.95, 1.45))
    return float(np.clip(rng.normal(1.72, 0.09), 1.5, 1.95))


def draw_roles(
    rng: np.random.Generator, body: BodyModel, shot: Shot, terrain: Terrain, seconds: float, children: tuple[bool, ...],
    acts: tuple[str, ...],
) -> tuple[Role, ...]:  # fmt: skip
    """People who do not walk through each other or through blocks.

    Args:
        rng: random numbers.
        body: body model.
        shot: the camera.
        terrain: the scenery.
        seconds: length of the clip.
        children: for each person.
        acts: for each person, from ACTS; on stairs or a box the first one climbs or stands there.
    """
    roles: list[Role] = []
    taken: list[Array] = []
    for number, (child, act) in enumerate(zip(children, acts, strict=True)):
        person = draw_physique(rng, body, draw_height(rng, child))
        raised = number == 0 and any(block.top < 0.9 for block in terrain.blocks)
        script, track = _free_script(rng, shot, terrain, seconds, person, act, taken, raised)
        roles.append(Role(person, script))
        taken.append(track)
    return tuple(roles)


def _free_script(
    rng: np.random.Generator, shot: Shot, terrain: Terrain, seconds: float, person: Physique, act: str,
    taken: list[Array], raised: bool,
) -> tuple[Script, Array]:  # fmt: skip
    """The first drawn script that keeps clear of everything, or the one that came nearest to that."""
    times = np.arange(0, seconds + 0.1, 0.1)
    best: tuple[float, Script, Array] | None = None
    for _ in range(_TRIES):
        script = _raised_script(rng, terrain, person) if raised else draw_script(rng, shot, person, act, seconds)
        path = root_path(script, seconds)
        track = path.at(path.position, times)
        clear = min([1.0, *(np.linalg.norm(track - other, axis=1).min() / _APART_M for other in taken)])
        if not raised:
            clear = min([clear, *(float(block.distance(track).min()) / _FREE_M for block in terrain.blocks)])
        clear = min(clear, _shown(shot, track, act))
        if best is None or clear > best[0]:
            best = (clear, script, track)
        if clear >= 1:
            break
    assert best is not None  # noqa: S101 - _TRIES is positive
    return best[1], best[2]


def _shown(shot: Shot, track: Array, act: str) -> float:
    """1 if the path is where the act wants it, less the less of it is in the picture."""
    inside = (np.abs(np.arctan2(track[:, 0], track[:, 1])) < 0.85 * shot.azimuth()) & (track[:, 1] > 0.85 * shot.near)
    wanted = 0.45 if act in {"enter", "leave"} else 0.9
    return min(float(inside.mean()) / wanted, 1.0)


def _raised_script(rng: np.random.Generator, terrain: Terrain, person: Physique) -> Script:
    """Up a flight of steps, or standing on the first low block."""
    steps = [block for block in terrain.blocks if block.top < 0.9]
    first = steps[0]
    climbs = len(steps) > 1 and all(block.yaw == first.yaw for block in steps)
    if not climbs:
        x, y = first.centre
        heading = float(np.arctan2(-y, -x) + rng.uniform(-0.8, 0.8))
        return Script((x, y), heading, (Move(1.0), Move(1.5, gesture=str(rng.choice(["talk", "wave", "dance"])))))
    axis = np.array([np.cos(first.yaw), np.sin(first.yaw)])
    speed = float(rng.uniform(0.65, 0.85)) * person.leg / 0.85
    start = np.array(first.centre) - axis * (first.size[0] / 2 + rng.uniform(0.4, 0.7))
    return Script((float(start[0]), float(start[1])), first.yaw, (Move(4.0, speed),))


def draw_script(rng: np.random.Generator, shot: Shot, person: Physique, act: str, seconds: float) -> Script:
    """A script for one of ACTS, somewhere in the picture."""
    distance = float(rng.uniform(shot.near, shot.far))
    half = distance * np.tan(shot.azimuth())
    side = float(rng.choice([-1.0, 1.0]))
    pace = person.leg / 0.85
    speed = float(rng.uniform(0.7, 1.35)) * pace
    if act in {"cross", "enter", "leave"}:
        # To the other side of the picture, from outside it or beyond it if so asked.
        x = {"cross": 0.8 * half, "enter": half + 0.5, "leave": half - 0.75 * speed * seconds}[act] * side
        heading = (np.pi if side > 0 else 0.0) + (np.pi if act == "leave" else 0.0)
        return Script((x, distance), heading + float(rng.uniform(-0.3, 0.3)), (Move(seconds, speed),))
    place = (float(rng.uniform(-0.75, 0.75)) * half, distance)
    facing = float(np.arctan2(-place[1], -place[0]) + rng.uniform(-1.2, 1.2))
    if act == "walk":
        heading = float(rng.uniform(0, 2 * np.pi))
        turn = float(rng.uniform(-1.4, 1.4))
        return Script(
            place, heading, (Move(0.4 * seconds, speed), Move(0.3 * seconds, 0.6 * speed, turn), Move(0.3 * seconds))
        )
    if act == "jump":
        air = float(rng.uniform(0.28, 0.42))
        return Script(
            place, facing, (Move(0.8), Move(1.1, jumps=air, speed=float(rng.choice([0.0, 0.3]))), Move(0.9, jumps=air))
        )
    if act == "crouch":
        return Script(place, facing, (Move(0.6), Move(1.4, crouch=float(rng.uniform(0.3, 0.5)))))
    if act == "stand":
        return Script(place, facing, (Move(seconds),))
    return Script(
        place, facing, (Move(0.4), Move(0.5 * seconds, gesture=act), Move(0.4, turn=float(rng.uniform(-0.8, 0.8))))
    )
