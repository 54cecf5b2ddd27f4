"""Solid scenery that people stand on: a sloping ground with boxes on it, seen by a camera above it.

World frame: z up against gravity, origin on the ground below the camera, y the way the camera looks, metres.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

SKY_DEPTH = 60.0  # metres: what lies farther is shown as if it stood here


@dataclass(frozen=True)
class Block:
    """An upright box that reaches from far below the ground up to its flat top.

    Attributes:
        centre: (x, y) of the footprint, metres.
        size: (2,) full lengths of the footprint along its own axes, metres.
        yaw: radians from the world's x axis to the footprint's first axis.
        top: height of the top, metres.
    """

    centre: tuple[float, float]
    size: tuple[float, float]
    yaw: float
    top: float

    def local(self, xy: ArrayLike) -> Array:
        """(..., 2) world places in the axes of the footprint."""
        cosine, sine = np.cos(self.yaw), np.sin(self.yaw)
        return (np.asarray(xy, float) - self.centre) @ np.array([[cosine, -sine], [sine, cosine]])

    def distance(self, xy: ArrayLike) -> Array:
        """Distance (...) of (..., 2) places from the footprint, 0 inside it."""
        outside = np.maximum(np.abs(self.local(xy)) - np.array(self.size) / 2, 0)
        return np.linalg.norm(outside, axis=-1)


@dataclass(frozen=True)
class Terrain:
    """What people stand on: a plane through the world's origin, and blocks.

    Attributes:
        gradient: (2,) rise of the plane per metre along x and y.
        blocks: boxes, steps and walls.
    """

    gradient: tuple[float, float] = (0.0, 0.0)
    blocks: tuple[Block, ...] = ()

    def height(self, xy: ArrayLike) -> Array:
        """Height (...) of the surface at (..., 2) places, metres."""
        xy = np.asarray(xy, np.float64)
        height: Array = xy @ np.array(self.gradient, np.float64)
        for block in self.blocks:
            height = np.where(block.distance(xy) == 0, np.maximum(height, block.top), height)
        return height

    def normal(self, xy: ArrayLike) -> Array:
        """Unit normal (..., 3) of the surface at (..., 2) places."""
        xy = np.asarray(xy, float)
        plane = np.array([-self.gradient[0], -self.gradient[1], 1.0])
        normal = np.broadcast_to(plane / np.linalg.norm(plane), (*xy.shape[:-1], 3)).copy()
        normal[self.height(xy) > xy @ np.array(self.gradient)] = (0.0, 0.0, 1.0)
        return normal

    def depth(self, origin: ArrayLike, rays: ArrayLike) -> Array:
        """Length (...) of rays (..., 3) from `origin` (3,) to the first surface, in units of the ray; inf without."""
        origin, rays = np.asarray(origin, float), np.asarray(rays, np.float64)
        plane = np.array([-self.gradient[0], -self.gradient[1], 1.0], np.float64)
        fall = -(rays @ plane)
        with np.errstate(divide="ignore"):
            nearest = np.where(fall > 0, (origin @ plane) / fall, np.inf)
        for block in self.blocks:
            nearest = np.minimum(nearest, _ray_block(block, origin, rays))
        return nearest


def _ray_block(block: Block, origin: Array, rays: Array) -> Array:
    """Slab method: the ray is inside the block while it is inside of all three pairs of planes."""
    start = np.append(block.local(origin[:2]), origin[2])
    direction = np.concatenate([block.local(rays[..., :2] + block.centre), rays[..., 2:]], axis=-1)
    half = np.array(block.size) / 2
    low, high = np.append(-half, -1e3), np.append(half, block.top)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = (low - start) / direction, (high - start) / direction
    enter = np.nanmax(np.minimum(first, second), axis=-1)
    leave = np.nanmin(np.maximum(first, second), axis=-1)
    return np.where((enter <= leave) & (enter > 0), enter, np.inf)


@dataclass(frozen=True)
class View:
    """Where the camera stands: camera point = rotation @ (world point - position).

    Attributes:
        rotation: (3, 3) from the world's axes to the camera's.
        position: (3,) metres.
    """

    rotation: Array
    position: Array

    @property
    def up(self) -> Array:
        """(3,) against gravity, camera frame."""
        return self.rotation[:, 2]

    def to_camera(self, points: ArrayLike) -> Array:
        """World points (..., 3) in the camera's frame."""
        return (np.asarray(points, float) - self.position) @ self.rotation.T

    def to_world(self, points: ArrayLike) -> Array:
        """Camera points (..., 3) in the world's frame."""
        return np.asarray(points, float) @ self.rotation + self.position


def look(position: ArrayLike, target: ArrayLike, roll: float) -> View:
    """A camera that looks from one world point to another.

    Args:
        position: (3,) metres.
        target: (3,) metres, not straight above or below.
        roll: radians about the viewing axis.
    """
    position = np.asarray(position, float)
    forward = np.asarray(target, float) - position
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right = right / np.linalg.norm(right)
    down = np.cross(forward, right)
    cosine, sine = np.cos(roll), np.sin(roll)
    return View(np.stack([cosine * right + sine * down, cosine * down - sine * right, forward]), position)


@dataclass(frozen=True)
class SeenTerrain:
    """The terrain in the camera's frame: truth's `Scenery`.

    Attributes:
        terrain: in the world's frame.
        view: of the camera.
    """

    terrain: Terrain
    view: View

    def height_above(self, points: Array) -> Array:
        """Height (...) of (..., 3) camera points above the surface below them, along the vertical."""
        world = self.view.to_world(points)
        return world[..., 2] - self.terrain.height(world[..., :2])

    def depth(self, rays: Array) -> Array:
        """Depth (...) along camera rays (..., 3) with z = 1, metres, at most `SKY_DEPTH`."""
        return np.minimum(self.terrain.depth(self.view.position, rays @ self.view.rotation), SKY_DEPTH)
