"""What really happened in a clip: the exact truth a synthetic scene comes with."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from core_solver.body.model import BodyModel
from core_solver.camera import Camera
from core_solver.tracking.tracks import Modalities

Array = NDArray[np.float64]


class Scenery(Protocol):
    """The solid, static part of a scene, camera frame, metres."""

    def height_above(self, points: Array) -> Array:
        """Height (...) of (..., 3) points above the surface below them, along the vertical; negative inside it."""
        ...


@dataclass(frozen=True)
class Truth:
    """N people over T frames, camera frame, metres.

    Attributes:
        joints: (N, T, 24, 3).
        soles: (N, T, 2, S, 3) the vertices `optimise.posing.sole_rows` chooses under the left and the right foot.
        present: (N, T) the person is in the picture and not wholly hidden.
        contacts: (N, T, 2) the foot rests on the scene.
        heights: (N,) statures.
        up: (3,) against gravity.
        scenery: what people stand on.
    """

    joints: Array
    soles: Array
    present: NDArray[np.bool_]
    contacts: NDArray[np.bool_]
    heights: Array
    up: Array
    scenery: Scenery


@dataclass(frozen=True)
class SyntheticScene:
    """A clip as a solver sees it, and its truth. `modalities.tracks[n]` is truth's person n.

    Attributes:
        name: unique within its suite and seed.
        body: body model of truth and solver.
        camera: true intrinsics.
        modalities: corrupted like those of real networks.
        truth: what it should find.
    """

    name: str
    body: BodyModel
    camera: Camera
    modalities: Modalities
    truth: Truth
