# SPDX-License-Identifier: GPL-3.0-or-later
"""What stands around in a scene, walls and tables: how far from it a hand is."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_WIDTH = 0.04  # metres: the scene is thinned to one point, the mean, per cell of a grid
REACH = 0.08
"""Metres up to which distances are told: two cells."""
_BITS = 20


@dataclass(frozen=True)
class Things:
    """A scene's points, thinned and sorted by the cells of a grid.

    Attributes:
        keys: (N,) of the cells, ascending.
        points: (N, 3) mean of the points in each cell, world, metres.
    """

    keys: NDArray[np.int64]
    points: Array

    @classmethod
    def from_points(cls, points: Array) -> "Things":
        """Thin (P, 3) finite points within some kilometres of the origin."""
        keys = _key(_cells(points))
        order = np.argsort(keys)
        found, starts, counts = np.unique(keys[order], return_index=True, return_counts=True)
        return cls(found, np.add.reduceat(points[order], starts) / counts[:, None])

    def distance(self, places: ArrayLike) -> Array:
        """(...) metres from (..., 3) places to the nearest point; inf beyond `REACH`."""
        places = np.asarray(places, float)
        flat = places.reshape(-1, 3)
        cells = _cells(flat)
        nearest = np.full(len(flat), np.inf)
        rings = range(-2, 3)
        for step in product(rings, rings, rings):
            keys = _key(cells + step)
            found = np.minimum(np.searchsorted(self.keys, keys), len(self.keys) - 1)
            away = np.linalg.norm(self.points[found] - flat, axis=1)
            nearest = np.where(self.keys[found] == keys, np.minimum(nearest, away), nearest)
        return np.where(nearest <= REACH, nearest, np.inf).reshape(places.shape[:-1])


def _cells(points: Array) -> NDArray[np.int64]:
    return np.floor(points / _WIDTH).astype(np.int64)


def _key(cells: NDArray[np.int64]) -> NDArray[np.int64]:
    x, y, z = np.moveaxis(cells + (1 << (_BITS - 1)), -1, 0)
    return (x << 2 * _BITS) | (y << _BITS) | z
