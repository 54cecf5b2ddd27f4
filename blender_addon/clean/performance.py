# SPDX-License-Identifier: GPL-3.0-or-later
"""One person's motion together with what is known about it: what every cleaning operation reads."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..retarget.bone_map import BoneMap
from ..retarget.skeleton import Motion, Skeleton

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True)
class Performance:
    """A person who moves.

    Attributes:
        name: for messages and new actions.
        skeleton: at rest.
        bone_map: roles of its bones.
        motion: of all bones, at even times.
        evidence: what the solver knows of each frame.
    """

    name: str
    skeleton: Skeleton
    bone_map: BoneMap
    motion: Motion
    evidence: "Evidence"

    @property
    def rate(self) -> float:
        """Frames per second."""
        times = self.motion.times
        return (len(times) - 1) / float(times[-1] - times[0]) if len(times) > 1 else 1.0


@dataclass(frozen=True)
class Evidence:
    """What is known of each frame.

    Attributes:
        contacts: (T, 2) probability that the left and the right foot stand on something.
        seen: (T,) whether the person was seen; elsewhere the motion was filled in.
        present: (T,) whether the person is there at all.
        confidence: (T,) 0..1, how sure the pose is.
    """

    contacts: Array
    seen: Flags
    present: Flags
    confidence: Array
