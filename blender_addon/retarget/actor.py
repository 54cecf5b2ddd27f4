# SPDX-License-Identifier: GPL-3.0-or-later
"""One character of a scene that is to be retargeted."""

from dataclasses import dataclass

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
    """

    name: str
    source: Skeleton
    source_map: BoneMap
    motion: Motion
    contacts: Array
    target: Skeleton
    target_map: BoneMap
