"""Drawing places: a camera, and the solid scenery before it."""

from dataclasses import dataclass

import numpy as np

from core_solver.camera import Camera, camera_from_fov
from core_solver.evaluation.synthetic.world import Block, Terrain, View, look

TERRAINS = ("flat", "slope", "stairs", "boxes", "walls")
_PICTURES = ((1280, 720), (1920, 1080), (1080, 1920), (960, 720), (720, 960))
_LOW_M = 0.95  # nobody climbs on anything higher


@dataclass(frozen=True)
class Shot:
    """A camera in the world, and the part of the world it is meant to show.

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

    @property
    def half_angle(self) -> float:
        """Half the angle that the picture covers sideways, radians."""
        return float(np.arctan(self.camera.width / (2 * self.camera.fx)))


def draw_shot(rng: np.random.Generator) -> Shot:
    """A camera 0.8 to 4 m high, tilted towards a place where people fit into the picture, rolled by a few degrees."""
    width, height = _PICTURES[rng.integers(len(_PICTURES))]
    camera = camera_from_fov(width, height, float(rng.uniform(36, 80)), "truth")
    # An adult fills the picture at 1.7 times the focal length in heights of the picture.
    near = float(np.clip(rng.uniform(0.95, 1.5) * 1.7 * camera.fy / height, 2.5, 8.0))
    far = float(min(rng.uniform(1.5, 2.4) * near + 0.5, 12.0))
    position = np.array([0.0, 0.0, rng.uniform(0.8, 4.0)])
    target = np.array([0.0, 0.45 * near + 0.55 * far, rng.uniform(0.7, 1.1)])
    return Shot(camera, look(position, target, float(rng.normal(scale=np.radians(2.5)))), near, far)


def low_blocks(terrain: Terrain) -> tuple[Block, ...]:
    """Steps and boxes that people stand on."""
    return tuple(block for block in terrain.blocks if block.top < _LOW_M and min(block.size) > 0.3)


def draw_terrain(rng: np.random.Generator, kind: str, shot: Shot) -> Terrain:
    """Scenery of a kind from TERRAINS; the camera stands above its ground."""
    walls = _back_walls(rng, shot) if rng.random() < 0.5 or kind == "walls" else ()
    if kind == "slope":
        steepness, direction = np.tan(np.radians(rng.uniform(3, 9))), rng.uniform(0, 2 * np.pi)
        return Terrain((float(steepness * np.cos(direction)), float(steepness * np.sin(direction))), walls)
    if kind == "stairs":
        return Terrain(blocks=(*_stairs(rng, 0.5 * (shot.near + shot.far)), *walls))
    if kind == "boxes":
        return Terrain(blocks=(*_boxes(rng, shot), *walls))
    if kind == "walls":
        return Terrain(blocks=(_low_wall(rng, shot), *walls))
    return Terrain(blocks=walls)


def _back_walls(rng: np.random.Generator, shot: Shot) -> tuple[Block, ...]:
    distance = shot.far + float(rng.uniform(1.5, 4.0))
    return (Block((0.0, distance + 1.0), (60.0, 1.0), float(rng.uniform(-0.2, 0.2)), 4.0),)


def _low_wall(rng: np.random.Generator, shot: Shot) -> Block:
    """Something in the foreground behind which legs disappear."""
    side = float(rng.uniform(-0.4, 0.4)) * shot.near * float(np.tan(shot.half_angle))
    width, height = float(rng.uniform(0.8, 1.8)), float(rng.uniform(0.4, 0.9))
    return Block((side, 0.9 * shot.near), (width, 0.2), float(rng.uniform(-0.3, 0.3)), height)


def _stairs(rng: np.random.Generator, distance: float) -> tuple[Block, ...]:
    """A flight of steps that ends on a platform."""
    count = int(rng.integers(3, 6))
    rise, tread, width = float(rng.uniform(0.12, 0.17)), float(rng.uniform(0.34, 0.42)), float(rng.uniform(1.6, 2.4))
    yaw = float(rng.choice([0.0, np.pi, 0.5 * np.pi]) + rng.uniform(-0.4, 0.4))
    axis = np.array([np.cos(yaw), np.sin(yaw)])
    foot = np.array([0.0, distance]) - axis * (count * tread / 2 + 0.4)
    blocks = []
    for number in range(count):
        deep = tread if number < count - 1 else 1.8
        centre = foot + axis * (number * tread + deep / 2)
        blocks.append(Block((float(centre[0]), float(centre[1])), (deep, width), yaw, rise * (number + 1)))
    return tuple(blocks)


def _boxes(rng: np.random.Generator, shot: Shot) -> tuple[Block, ...]:
    blocks = []
    for _ in range(int(rng.integers(2, 4))):
        distance = rng.uniform(shot.near, shot.far)
        side = rng.uniform(-0.6, 0.6) * distance * np.tan(shot.half_angle)
        size = rng.uniform(0.8, 1.2, size=2)
        yaw, top = rng.uniform(0, np.pi), rng.uniform(0.15, 0.55)
        blocks.append(Block((float(side), float(distance)), (float(size[0]), float(size[1])), float(yaw), float(top)))
    return tuple(blocks)
