# SPDX-License-Identifier: GPL-3.0-or-later
"""People at other moments than the take's frames. numpy only."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from core_solver.geometry import matrix_from_rotvec, rotvec_from_matrix
from core_solver.take import Person

Array = NDArray[np.float64]


def resample(person: Person, moments: Array) -> Person:
    """The same person, seen at other moments.

    Rotations take the shortest way from one frame to the next (slerp), places and shares the straight one; evidence is
    that of the nearest frame. Moments on a frame give that frame unchanged.

    Args:
        person: T frames.
        moments: (N,) frames counted from 0, not whole between two frames, within [0, T - 1].

    Returns:
        The person with N frames.
    """
    before = np.floor(moments).astype(int)
    after = np.minimum(before + 1, len(person.theta) - 1)
    share = moments - before

    def between(values: NDArray[np.float32]) -> NDArray[np.float32]:
        weight = share.reshape(-1, *[1] * (values.ndim - 1)).astype(np.float32)
        return values[before] + weight * (values[after] - values[before])

    return replace(
        person,
        theta=_slerp(person.theta[before], person.theta[after], share),
        gamma=between(person.gamma),
        valid=person.valid[np.floor(moments + 0.5).astype(int)],
        confidence=between(person.confidence),
        contacts=between(person.contacts),
    )


def _slerp(start: NDArray[np.float32], end: NDArray[np.float32], share: Array) -> NDArray[np.float32]:
    """(N, J, 3) rotation vectors between two, `share` of the way from the first."""
    first = matrix_from_rotvec(start)
    turn = rotvec_from_matrix(np.swapaxes(first, -1, -2) @ matrix_from_rotvec(end))
    way = rotvec_from_matrix(first @ matrix_from_rotvec(share[:, None, None] * turn))
    return np.where(share[:, None, None] == 0, start, way.astype(np.float32))
