# SPDX-License-Identifier: GPL-3.0-or-later
"""The ground under people's feet, out of a scene's points: floors, slopes, stairs and boxes, but no walls. numpy only.

Points are gathered into columns, and in each column into surfaces: points that follow each other closely in height. A
surface carries a foot when it is thin (a wall's are tall), not steep and has free space above it. Each such surface
becomes a small plane fitted to its neighbourhood, and the ground at a place is the blend of the planes around it. The
same is done in coarser and coarser columns for places where fewer points were seen.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .things import REACH, Things

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Widths of the columns, metres, each tried where the finer ones hold nothing: the last spans holes of over a metre.
_WIDTHS = (0.05, 0.1, 0.2, 0.4, 0.8)
STEP = 0.35
"""How far, metres, the ground may lie above or below where it is expected: two stairs, a chair's seat is too high."""
_STOREY = 2.2
"""Without an expected height only surfaces up to here are grounds: above is the ceiling."""

# A cloud must be nearer to the soles than the plane by so many metres: on level floors the two differ by noise alone.
_DOUBT = 0.02
_AGREES = 0.1  # metres: a cloud farther from the soles than this is wrong there
_RISE = 0.2  # metres, of a stair: cloud farther above or below those who stand nearby is not what they stand on
_PLACE = 0.4  # metres: so wide are the places whose soles tell together
_FARTHEST = 1000.0  # metres from the world's origin: what is farther off is no place to stand
_GAP = 0.06  # metres of empty height between two surfaces of one column
_THIN = 0.04  # metres: spread in height of a level surface's points, their noise included
_STEEPEST = 1.0  # a slope of 45 degrees
_CLEARANCE = 0.6  # metres that must be free above a surface for a leg to stand there
_CROWD = 0.5  # so many points above for each point of a surface bury it; stray ones do not
# Neighbours belong to one surface up to this difference in height, metres, and this slope: stairs rise by more.
_NEAR, _NEAR_SLOPE = 0.04, 0.5
_TRUSTED = 10  # points that make a column as good as any: dense places shall not outweigh the rest of a neighbourhood
_STIFFNESS = 0.5  # of planes against tilting where the neighbourhood is no wider than a column


@dataclass(frozen=True)
class _Surfaces:
    """Surfaces of all columns of one width, sorted by column and then by height.

    Attributes:
        width: of a column, metres.
        keys: (N,) column and height as one number.
        centres: (N, 3) mean of the points.
        counts: (N,) of points.
        spreads: (N,) standard deviation of the points' heights.
        slopes: (N, 2) of the height along x and y.
    """

    width: float
    keys: Indices
    centres: Array
    counts: Array
    spreads: Array
    slopes: Array

    def pick(self, chosen: NDArray[np.bool_]) -> "_Surfaces":
        """Some of the surfaces."""
        return _Surfaces(
            self.width,
            self.keys[chosen],
            self.centres[chosen],
            self.counts[chosen],
            self.spreads[chosen],
            self.slopes[chosen],
        )

    def columns(self, xy: Array) -> Indices:
        """(..., 2) the column over each place."""
        return np.floor(xy / self.width).astype(np.int64)

    def nearest(self, columns: Indices, heights: Array) -> Indices:
        """(...) the surface of a column that is nearest to a height; -1 in empty columns.

        Args:
            columns: (..., 2).
            heights: (...) metres.
        """
        if not len(self.keys):
            return np.full(heights.shape, -1)
        wanted = _key(columns, heights)
        after = np.searchsorted(self.keys, wanted)
        best = np.full(heights.shape, -1)
        closest = np.full(heights.shape, np.inf)
        for candidate in (after - 1, after):
            place = np.clip(candidate, 0, len(self.keys) - 1)
            away = np.abs(self.centres[place, 2] - heights)
            better = (self.keys[place] >> _HEIGHT_BITS == wanted >> _HEIGHT_BITS) & (away < closest)
            best, closest = np.where(better, place, best), np.where(better, away, closest)
        return best


_HEIGHT_BITS, _COLUMN_BITS = 22, 20


def _key(columns: Indices, heights: Array) -> Indices:
    """One number per column and height: sorted by them it is sorted by column and, inside, by millimetres."""
    millimetres = np.clip((heights + 2 * _FARTHEST) * 1000, 0, (1 << _HEIGHT_BITS) - 1).astype(np.int64)
    middle = 1 << (_COLUMN_BITS - 1)
    x, y = np.moveaxis(np.clip(columns + middle, 0, 2 * middle - 1), -1, 0)
    return (((x << _COLUMN_BITS) | y) << _HEIGHT_BITS) | millimetres


@dataclass(frozen=True)
class _Votes:
    """Places where people stood, and what their soles say of the cloud and of the plane there.

    Attributes:
        places: as surfaces of columns.
        off_cloud, off_plane: (N,) how far the soles of a place are from either, metres.
    """

    places: _Surfaces
    off_cloud: Array
    off_plane: Array

    @classmethod
    def of(cls, soles: Array, off_cloud: Array) -> "_Votes":
        """Gather (N, 3) soles into places."""
        keys = _key(np.floor(soles[:, :2] / _PLACE).astype(np.int64), np.round(soles[:, 2] / STEP) * STEP)
        _, member, counts = np.unique(keys, return_inverse=True, return_counts=True)

        def mean(values: Array) -> Array:
            return np.bincount(member, values) / counts

        centres = np.stack([mean(axis) for axis in soles.T], axis=1)
        keys = _key(np.floor(centres[:, :2] / _PLACE).astype(np.int64), centres[:, 2])
        order = np.argsort(keys)
        some = np.zeros(len(order))
        places = _Surfaces(
            _PLACE, keys[order], centres[order], counts[order].astype(float), some, np.zeros((len(order), 2))
        )
        off_plane = np.minimum(np.abs(soles[:, 2]), 2 * STEP)
        return cls(places, mean(np.minimum(off_cloud, 2 * STEP))[order], mean(off_plane)[order])

    def chosen(self, xy: Array, expected: Array, cloud: Array, plane: float) -> Array:
        """(Q,) of the cloud's and the plane's heights those that count; the expected ones where none does.

        Far from places where people stood all of these are asked.
        """
        told = np.stack([np.ones(len(self.off_cloud)), self.off_cloud, self.off_plane, self.places.centres[:, 2]])
        totals = np.zeros((len(told), len(xy)))
        for found, neighbour in _neighbours(self.places, xy, expected, 1):
            way = self.places.centres[neighbour] - np.column_stack([xy, expected])
            totals += found * np.exp(-np.sum(way**2, axis=1) / _PLACE**2) * told[:, neighbour]
        alone = totals[0] < 1e-6
        weight, off_cloud, off_plane, level = np.where(alone, np.median(told, axis=1)[:, None], totals)
        off_cloud, off_plane, level = off_cloud / weight, off_plane / weight, np.where(alone, cloud, level / weight)
        fits = (off_cloud < _AGREES) & (off_cloud < off_plane - _DOUBT) & (np.abs(cloud - level) < _RISE)
        return np.where(fits, cloud, np.where(off_plane > STEP, expected, plane))


@dataclass(frozen=True)
class Ground:
    """Heights that feet can stand on.

    Attributes:
        levels: the surfaces seen, in finer columns first; empty for a plane.
        plane: height where nothing was seen, metres.
        things: all that was seen, walls and tables too; None for a plane.
        votes: where the surfaces count instead of the plane; None for everywhere.
    """

    levels: tuple[_Surfaces, ...]
    plane: float = 0.0
    things: Things | None = None
    votes: _Votes | None = None

    @classmethod
    def flat(cls, z: float = 0.0) -> "Ground":
        """A level plane."""
        return cls((), z)

    @classmethod
    def from_points(cls, points: ArrayLike) -> "Ground":
        """The ground of a scene that was seen as points.

        Args:
            points: (P, 3) world, metres; those that are not finite are left out.
        """
        points = np.asarray(points, float).reshape(-1, 3)
        points = points[(np.abs(points) < _FARTHEST).all(axis=1)]
        if not len(points):
            return cls.flat()
        levels = []
        seen = _gather(_WIDTHS[0], points, np.ones(len(points)), np.zeros(len(points)))
        for width in _WIDTHS:
            if width > seen.width:
                seen = _gather(width, seen.centres, seen.counts, seen.spreads)
            levels.append(_walkable(seen))
        return cls(tuple(levels), things=Things.from_points(points))

    def distance(self, places: ArrayLike) -> Array:
        """How far places are from whatever was seen of the scene, its ground included.

        Args:
            places: (..., 3) world, metres.

        Returns:
            (...) metres; inf where nothing is within `things.REACH`.
        """
        places = np.asarray(places, float)
        above = np.abs(places[..., 2] - self.height(places[..., :2], places[..., 2]))
        flat = np.where(above < REACH, above, np.inf)
        return flat if self.things is None else np.minimum(flat, self.things.distance(places))

    @classmethod
    def under(cls, points: ArrayLike, soles: ArrayLike) -> "Ground":
        """The ground of a scene where its people stand on it, elsewhere the plane z = 0.

        What a network saw as a floor may bulge by more than stairs are high. Where people stood tells, place by place:
        the cloud counts if it agrees with the soles there and is nearer to them than the plane is. Where the soles are
        far from both they are on something that nobody saw, and stay as high as they are.

        Args:
            points: (P, 3) as in `from_points`.
            soles: (N, 3) places of standing soles, of all people.
        """
        seen, soles = cls.from_points(points), np.asarray(soles, float).reshape(-1, 3)
        if not len(soles):
            return seen
        surface = seen.height(soles[:, :2], soles[:, 2])
        # Where the cloud is level with the plane soles on it cannot tell the two apart.
        telling = (np.abs(surface) > _DOUBT) | (np.abs(soles[:, 2]) > STEP)
        if not seen.levels or not telling.any():
            return cls.flat()
        votes = _Votes.of(soles[telling], np.abs(soles[:, 2] - surface)[telling])
        return replace(seen, votes=votes)

    def height(self, xy: ArrayLike, near_z: ArrayLike | None = None) -> Array:
        """The ground's height.

        Of several surfaces above each other the one nearest to `near_z` counts, no farther from it than `STEP`.

        Args:
            xy: (..., 2) places, metres.
            near_z: (...) where the ground is expected, such as the height of a sole; without it the surface nearest
                to z = 0 counts, up to a storey above or below.

        Returns:
            (...) metres; the plane's height where nothing was seen, `near_z` where nothing that was seen can be meant.
        """
        xy = np.asarray(xy, float)
        expected = np.zeros(xy.shape[:-1]) if near_z is None else np.broadcast_to(near_z, xy.shape[:-1]).astype(float)
        reach = _STOREY if near_z is None else STEP
        places, wanted = xy.reshape(-1, 2), expected.reshape(-1)
        heights = np.full(len(places), float(self.plane))
        open_ = np.arange(len(places))
        for level in self.levels:
            found, surface = _blend(level, places[open_], wanted[open_], reach)
            heights[open_[found]] = surface[found]
            open_ = open_[~found]
        if self.votes is not None:
            heights = self.votes.chosen(places, wanted, heights, self.plane)
        return heights.reshape(expected.shape)


def _gather(width: float, points: Array, counts: Array, spreads: Array) -> _Surfaces:
    """Surfaces out of points, or out of the surfaces of finer columns with their counts and spreads."""
    keys = _key(np.floor(points[:, :2] / width).astype(np.int64), points[:, 2])
    order = np.argsort(keys)
    keys, points, counts, spreads = keys[order], points[order], counts[order], spreads[order]
    same_column = keys[1:] >> _HEIGHT_BITS == keys[:-1] >> _HEIGHT_BITS
    # A coarse column of a slope holds the heights of its whole width.
    close = np.diff(points[:, 2]) < max(_GAP, width * _NEAR_SLOPE)
    starts = np.flatnonzero(np.concatenate([[True], ~(same_column & close)]))
    total = np.add.reduceat(counts, starts)
    centres = np.add.reduceat(points * counts[:, None], starts) / total[:, None]
    away = points[:, 2] - np.repeat(centres[:, 2], np.diff(np.append(starts, len(points))))
    variance = np.add.reduceat(counts * (spreads**2 + away**2), starts) / total
    # The key follows the mean height; surfaces of a column do not overlap, so the order stays.
    keys = _key(np.floor(centres[:, :2] / width).astype(np.int64), centres[:, 2])
    return _Surfaces(width, keys, centres, total, np.sqrt(variance), np.zeros((len(starts), 2)))


def _walkable(seen: _Surfaces) -> _Surfaces:
    """Those surfaces that carry a foot, as planes fitted to their neighbourhood."""
    # Inside a column a slope has its own spread: that of a uniform distribution over the rise.
    thin = seen.spreads**2 < _THIN**2 + (_STEEPEST * seen.width) ** 2 / 12
    kept = seen.pick(thin & ~_buried(seen))
    fitted = _fit_planes(kept)
    return fitted.pick(np.linalg.norm(fitted.slopes, axis=1) < _STEEPEST)


def _buried(seen: _Surfaces) -> NDArray[np.bool_]:
    """(N,) whether a column goes on right above a surface, as those of walls and of people do."""
    columns = seen.columns(seen.centres[:, :2])
    below = np.concatenate([[0.0], np.cumsum(seen.counts)])
    top = np.searchsorted(seen.keys, _key(columns, seen.centres[:, 2] + _CLEARANCE), side="right")
    above = below[top] - below[1:]
    return above > _CROWD * seen.counts


def _fit_planes(surfaces: _Surfaces) -> _Surfaces:
    """Smooth heights and slopes by planes through the 5 x 5 columns around, as far as they belong together."""
    centres = surfaces.centres
    normal = np.zeros((len(centres), 3, 3))
    right = np.zeros((len(centres), 3))
    for found, neighbour in _neighbours(surfaces, centres[:, :2], centres[:, 2], 2):
        step = centres[neighbour] - centres
        apart = np.linalg.norm(step[:, :2], axis=1)
        same = found & (np.abs(step[:, 2]) < _NEAR + _NEAR_SLOPE * apart)
        weight = same * np.minimum(surfaces.counts[neighbour], _TRUSTED)
        terms = np.concatenate([np.ones((len(step), 1)), step[:, :2]], axis=1)
        normal += weight[:, None, None] * terms[:, :, None] * terms[:, None, :]
        right += (weight * step[:, 2])[:, None] * terms
    # A lone surface says nothing about its slope: it stays level.
    normal[:, (1, 2), (1, 2)] += _STIFFNESS * normal[:, :1, 0] * surfaces.width**2 / 12 + 1e-9
    plane = np.asarray(np.linalg.solve(normal, right[..., None])[..., 0], np.float64)
    smooth = centres + plane[:, :1] * [0.0, 0.0, 1.0]
    return _Surfaces(surfaces.width, surfaces.keys, smooth, surfaces.counts, surfaces.spreads, plane[:, 1:])


def _neighbours(
    surfaces: _Surfaces, xy: Array, heights: Array, rings: int
) -> Iterator[tuple[NDArray[np.bool_], Indices]]:
    """For each column of the rings around places: where there is a surface, and the one nearest to the height."""
    columns = surfaces.columns(xy)
    for x in range(-rings, rings + 1):
        for y in range(-rings, rings + 1):
            neighbour = surfaces.nearest(columns + np.array([x, y]), heights)
            yield neighbour >= 0, neighbour


def _blend(level: _Surfaces, xy: Array, wanted: Array, reach: float) -> tuple[NDArray[np.bool_], Array]:
    """Where a level knows the ground, and the blend of the planes there that continue the closest of them."""
    anchor = _closest(level, xy, wanted, reach)
    total, weighed = np.zeros(len(xy)), np.zeros(len(xy))
    for found, neighbour in _neighbours(level, xy, np.nan_to_num(anchor), 1):
        surface = _at(level, neighbour, xy)
        away = np.linalg.norm(level.centres[neighbour, :2] - xy, axis=1) / level.width
        weight = (found & (np.abs(surface - anchor) < _NEAR + _NEAR_SLOPE * level.width)) * np.exp(-(away**2))
        total += weight
        weighed += weight * surface
    return total > 0, weighed / np.maximum(total, 1e-300)


def _closest(level: _Surfaces, xy: Array, wanted: Array, reach: float) -> Array:
    """(Q,) height of the closest plane in the columns around places; NaN where there is none."""
    height = np.full(len(xy), np.nan)
    closest = np.full(len(xy), np.inf)
    for found, neighbour in _neighbours(level, xy, wanted, 1):
        here = found & (np.abs(level.centres[neighbour, 2] - wanted) < reach)
        away = np.where(here, np.linalg.norm(level.centres[neighbour, :2] - xy, axis=1), np.inf)
        height = np.where(away < closest, _at(level, neighbour, xy), height)
        closest = np.minimum(away, closest)
    return height


def _at(level: _Surfaces, surfaces: Indices, xy: Array) -> Array:
    """(Q,) heights of surfaces' planes over places."""
    centres = level.centres[surfaces]
    return centres[:, 2] + np.sum(level.slopes[surfaces] * (xy - centres[:, :2]), axis=1)
