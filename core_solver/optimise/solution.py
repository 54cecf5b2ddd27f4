"""What a solve gives."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import GroundFrame

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Solution:
    """All people and the depth range, camera frame, metres.

    Attributes:
        theta: (N, T, 24, 3) radians.
        gamma: (N, T, 3) translation, scale included.
        betas: (N, 10).
        scales: (N,).
        confidence: (N, T, 24).
        contacts: (N, T, 2).
        inverse_far: (T,) 1 / z_far.
        inverse_gap: (T,) 1 / z_near - 1 / z_far.
        ground: gravity and ground.
    """

    theta: Array
    gamma: Array
    betas: Array
    scales: Array
    confidence: Array
    contacts: Array
    inverse_far: Array
    inverse_gap: Array
    ground: GroundFrame
