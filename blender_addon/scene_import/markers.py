# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers on the timeline where a person was hidden from the camera and the motion was filled in."""

import bpy
import numpy as np
from numpy.typing import NDArray

from .clock import Clock
from .presence import presence


def mark_hidden(scene: bpy.types.Scene, name: str, valid: NDArray[np.bool_], clock: Clock, shortest: int) -> None:
    """Put "<name> hidden" where a person vanishes and "<name> seen" where the person is back.

    Args:
        scene: receives the markers.
        name: of the person.
        valid: (N,) whether a scene frame has evidence.
        clock: the scene frames.
        shortest: spans of fewer frames get no markers.
    """
    for first, end in hidden_spans(valid):
        if end - first >= shortest:
            scene.timeline_markers.new(f"{name} hidden", frame=clock.start + first)
            scene.timeline_markers.new(f"{name} seen", frame=clock.start + end)


def hidden_spans(valid: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """First frames and ends (exclusive) of the spans without evidence while the person is there."""
    hidden = presence(valid) & ~np.asarray(valid, bool) & bool(np.any(valid))
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hidden, [False]]).astype(np.int8)))
    return [(int(first), int(end)) for first, end in edges.reshape(-1, 2)]
