# SPDX-License-Identifier: GPL-3.0-or-later
"""What the solver knows of each frame, as the custom properties of a person's armature say it."""

from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..clean.performance import Evidence
from ..scene_import.actions import Curves
from ..scene_import.armature import CONFIDENCE, CONTACTS, EVIDENCE, PRESENT_FROM, PRESENT_UNTIL
from ..scene_import.presence import PRESENT
from .curves import curves_of, sample

Array = NDArray[np.float64]

_GROUP = "Evidence"


def read_evidence(obj: bpy.types.Object, frames: Array) -> Evidence:
    """The evidence of scene frames; of armatures that say nothing: always there, seen and sure, never standing.

    Args:
        obj: an armature; its active action counts, else the strips of its NLA tracks.
        frames: (T,).
    """
    left, right = (_values(obj, name, frames, 0.0) for name in CONTACTS)
    return Evidence(
        contacts=np.stack([left, right], axis=1),
        seen=_values(obj, EVIDENCE, frames, 1.0) > 0.5,
        present=_values(obj, PRESENT, frames, 1.0) > 0.5,
        confidence=_values(obj, CONFIDENCE, frames, 1.0),
    )


def says_contacts(obj: bpy.types.Object) -> bool:
    """Whether an armature knows when its feet stand."""
    return all(name in obj for name in CONTACTS)


def never_there(obj: bpy.types.Object) -> bool:
    """Whether an armature plays somebody who turned out to be another one, and is hidden throughout."""
    return PRESENT_FROM in obj and obj[PRESENT_UNTIL] < obj[PRESENT_FROM]


def evidence_curves(obj: bpy.types.Object, evidence: Evidence) -> list[Curves]:
    """Curves that carry evidence along with a new action, for those properties that the armature has."""
    left, right = evidence.contacts.T
    curves = [
        _curve(EVIDENCE, evidence.seen, "CONSTANT"),
        _curve(PRESENT, evidence.present, "CONSTANT"),
        _curve(CONTACTS[0], left, "LINEAR"),
        _curve(CONTACTS[1], right, "LINEAR"),
        _curve(CONFIDENCE, evidence.confidence, "LINEAR"),
    ]
    return [curve for curve in curves if curve.path[2:-2] in obj]


def _curve(name: str, values: NDArray[Any], interpolation: str) -> Curves:
    return Curves(f'["{name}"]', np.asarray(values, float)[:, None], _GROUP, interpolation)


def _values(obj: Any, name: str, frames: Array, otherwise: float) -> Array:
    """(T,) a custom property over time: its curve, else its value, else a default."""
    for player, shift in _players(obj):
        curve = curves_of(player).get((f'["{name}"]', 0))
        if curve is not None:
            return sample(curve, frames - shift)
    return np.full(len(frames), float(obj.get(name, otherwise)))


def _players(obj: Any) -> list[tuple[Any, float]]:
    """What animates an object, most important first, and by how many frames it plays later than its keys say."""
    animation = obj.animation_data
    if animation is None:
        return []
    strips = [strip for track in reversed(animation.nla_tracks) if not track.mute for strip in track.strips]
    return [(animation, 0.0), *((strip, strip.frame_start - strip.action_frame_start) for strip in strips)]
