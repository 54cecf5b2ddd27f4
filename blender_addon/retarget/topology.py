# SPDX-License-Identifier: GPL-3.0-or-later
"""A skeleton as a tree of joints: chains, and branches that are each other's mirror image."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .skeleton import Skeleton

Array = NDArray[np.float64]

# Two branches are twins when their lengths differ by less than this; characters are rarely built more exactly.
_ALIKE = 0.1
# Twins shorter than this fraction of the longest are faces, fingers and toes, no limbs.
_SHORT = 0.2
# Fingers and toes are shorter than this fraction of their limb.
_LONG_FINGERS = 0.3
_SAME_PLACE = 1e-3


@dataclass(frozen=True)
class Twins:
    """Two branches of one bone that mirror each other: limbs.

    Attributes:
        parent: the bone they branch from; -1 when both are roots.
        chains: of each, the bones of its longest path from the parent outwards.
    """

    parent: int
    chains: tuple[tuple[int, ...], tuple[int, ...]]


@dataclass(frozen=True)
class Tree:
    """The joints of a skeleton, by index.

    Attributes:
        skeleton: whose.
    """

    skeleton: Skeleton

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """Of each bone."""
        below: list[list[int]] = [[] for _ in self.skeleton.names]
        for bone, parent in enumerate(self.skeleton.parents):
            if parent >= 0:
                below[parent].append(bone)
        return tuple(map(tuple, below))

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """Bones without a parent."""
        return tuple(bone for bone, parent in enumerate(self.skeleton.parents) if parent < 0)

    @cached_property
    def reaches(self) -> Array:
        """(B,) metres along the longest path from a bone's head to another head below it: tails are often guesses."""
        reach = np.zeros(len(self.skeleton.names))
        for bone, parent in reversed(list(enumerate(self.skeleton.parents))):
            if parent >= 0:
                reach[parent] = max(reach[parent], self.distance(parent, bone) + reach[bone])
        return reach

    @cached_property
    def farthest(self) -> tuple[int, ...]:
        """Of each bone, the child on its longest path downwards; -1 for the last ones."""
        return tuple(
            max(below, key=lambda child, above=bone: self.distance(above, child) + self.reaches[child], default=-1)
            for bone, below in enumerate(self.children)
        )

    @cached_property
    def ends(self) -> Array:
        """(B, 3) where the longest path from a bone downwards ends."""
        ends = self.skeleton.heads.copy()
        for bone in reversed(range(len(ends))):
            if self.farthest[bone] >= 0:
                ends[bone] = ends[self.farthest[bone]]
        return ends

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Of each bone, how many hang on it, itself included."""
        counts = [1] * len(self.skeleton.names)
        for bone in reversed(range(len(counts))):
            if self.skeleton.parents[bone] >= 0:
                counts[self.skeleton.parents[bone]] += counts[bone]
        return tuple(counts)

    @cached_property
    def size(self) -> float:
        """Metres, the largest extent of the heads."""
        return float(np.ptp(self.skeleton.heads, axis=0).max())

    def distance(self, a: int, b: int) -> float:
        """Metres between two heads."""
        return float(np.linalg.norm(self.skeleton.heads[a] - self.skeleton.heads[b]))

    def coincide(self, a: int, b: int) -> bool:
        """Whether two bones begin in one place."""
        return self.distance(a, b) < _SAME_PLACE * self.size

    def line(self, bone: int) -> tuple[int, ...]:
        """A bone and all above it, up to its root."""
        line = [bone]
        while self.skeleton.parents[line[-1]] >= 0:
            line.append(self.skeleton.parents[line[-1]])
        return tuple(line)

    def below(self, bone: int) -> Iterator[int]:
        """A bone and all below it."""
        yield bone
        for child in self.children[bone]:
            yield from self.below(child)

    def is_below(self, bone: int, above: int) -> bool:
        """Whether a bone hangs on another, or is it."""
        return above in self.line(bone)

    def common(self, a: int, b: int) -> int:
        """The lowest bone that carries both; -1 if none does."""
        line = self.line(b)
        return next((bone for bone in self.line(a) if bone in line), -1)

    def chain(self, bone: int) -> tuple[int, ...]:
        """The longest path downwards, with one bone for each place: that from which several leave, or the last."""
        path = [bone]
        while self.farthest[path[-1]] >= 0:
            path.append(self.farthest[path[-1]])
        groups = [[bone]]
        for above, below_it in pairwise(path):
            if not self.coincide(above, below_it):
                groups.append([])
            groups[-1].append(below_it)
        return tuple(next((b for b in group if len(self.children[b]) > 1), group[-1]) for group in groups)

    def twins(self) -> list[Twins]:
        """All limbs, the longest first: twins that hold no twins but fingers and toes, and are none themselves."""
        siblings = [(-1, self.roots), *enumerate(self.children)]
        pairs = [(parent, *pair) for parent, bones in siblings for pair in self._pairs(bones)]
        wholes = [pair for pair in pairs if not any(self._is_in(p, pair) and self._is_long(p, pair) for p in pairs)]
        limbs = [pair for pair in wholes if not any(self._is_in(pair, whole) for whole in wholes)]
        limbs.sort(key=lambda pair: -self.reaches[pair[1]])
        return [
            Twins(parent, (self.chain(a), self.chain(b)))
            for parent, a, b in limbs
            if self.reaches[a] > _SHORT * self.reaches[limbs[0][1]]
        ]

    def _is_in(self, twins: tuple[int, int, int], whole: tuple[int, int, int]) -> bool:
        """Whether two branches leave one of two others."""
        return twins[0] >= 0 and any(self.is_below(twins[0], other) for other in whole[1:])

    def _is_long(self, twins: tuple[int, int, int], whole: tuple[int, int, int]) -> bool:
        """Whether branches are too long for fingers of others."""
        return self.reaches[twins[1]] > _LONG_FINGERS * self.reaches[whole[1]]

    def _pairs(self, bones: Sequence[int]) -> Iterator[tuple[int, int]]:
        """Siblings of which each is most like the other and that lead to different places."""
        alike = {bone: self._most_alike(bone, bones) for bone in bones if self.reaches[bone] > 0}
        for bone, other in alike.items():
            if other is not None and bone < other and alike.get(other) == bone:
                yield bone, other

    def _most_alike(self, bone: int, bones: Sequence[int]) -> int | None:
        reach = self.reaches[bone]
        best, least = None, np.inf
        for other in bones:
            apart = float(np.linalg.norm(self.ends[other] - self.ends[bone]))
            difference = abs(self.reaches[other] - reach) / reach
            if other != bone and apart > _ALIKE * reach and difference < _ALIKE:
                unlike = difference + abs(self.counts[other] - self.counts[bone]) / self.counts[bone]
                if unlike < least:
                    best, least = other, unlike
        return best
