# SPDX-License-Identifier: GPL-3.0-or-later
"""One character of a scene that is to be retargeted."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .bone_map import BoneMap
from .skeleton import Motion, Skeleton

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Actor:
    """Who moves, and the rig that shall move so.

    Attributes:
        name: for messages and tables.
        source: skeleton of the person.
        source_map: its roles.
        motion: of the source; all actors of a scene share their times.
        contacts: (T, 2) probability that the left and the right foot stand on something.
        target: skeleton of the rig.
        target_map: its roles.
        present: (T,) whether the person is there: before coming and after leaving somebody stands still, through whom
            others may walk. None for somebody who is always there.
    """

    name: str
    source: Skeleton
    source_map: BoneMap
    motion: Motion
    contacts: Array
    target: Skeleton
    target_map: BoneMap
    present: NDArray[np.bool_] | None = None

    @property
    def there(self) -> NDArray[np.bool_]:
        """(T,) `present`, of everybody."""
        return np.ones(len(self.motion.times), bool) if self.present is None else self.present

    def at(self, frames: NDArray[np.int64]) -> "Actor":
        """The actor in some of the frames."""
        motion, contacts = self.motion.at(frames), self.contacts[frames]
        return replace(self, motion=motion, contacts=contacts, present=self.there[frames])
