# SPDX-License-Identifier: GPL-3.0-or-later
"""Standing feet rest on the scene's surface, on stairs and slopes too, and nobody sinks into it."""

import numpy as np
from numpy.typing import NDArray

from ..retarget.ground import Ground
from ..retarget.skeleton import Motion
from .feet import Leg, Stance, ankles, legs_of, placed, reached, shifted, sole_points
from .foot_lock import BLEND, carried, contact_spans
from .performance import Performance
from .signals import raised

Array = NDArray[np.float64]

_SAME = 0.08  # metres: a sole rests on what is level with most of it, not on the next stair below its heel
_SOFTLY = 0.1  # seconds in which a foot rises over what it would sink into
_BODY = ("hips", "left_shin", "right_shin")  # joints that must not be below the surface: kneeling and sitting people
_UP = np.array([0.0, 0.0, 1.0])


def snap_to_ground(performance: Performance, ground: Ground, blend: float = BLEND) -> Motion:
    """Put feet that stand onto the surface under them; the body follows slowly.

    Args:
        performance: with contacts.
        ground: of its scene.
        blend: seconds in which a foot is drawn to the surface, and let go.

    Raises:
        UserError: the legs' bones are not known.
    """
    legs = legs_of(performance.skeleton, performance.bone_map)
    motion, rate = performance.motion, performance.rate
    offsets, weights = zip(
        *(
            _rest(motion, leg, contact_spans(contacts, rate), ground, blend * rate)
            for leg, contacts in zip(legs, performance.evidence.contacts.T, strict=True)
        ),
        strict=True,
    )
    stance = Stance(np.stack(offsets, axis=1), np.stack(weights, axis=1))
    clear = _stepped_over(placed(motion, legs, stance, rate), legs, stance.weights, ground, rate)
    return _surfaced(clear, performance, legs, ground)


def _rest(motion: Motion, leg: Leg, held: list[tuple[int, int]], ground: Ground, blend: float) -> tuple[Array, Array]:
    """(T, 3) ways upwards and (T,) weights that bring one foot to the surface in the spans in which it stands."""
    points = sole_points(leg, motion)
    lifts = np.zeros((len(points), 3))
    # Where the foot stands is one place, though the motion trembles: its surface must not change in between.
    places = np.array([np.median(points[start:end], axis=0) for start, end in held]).reshape(-1, *points.shape[1:])
    surfaces = ground.height(places[..., :2], places[..., 2])
    for (start, end), surface in zip(held, surfaces, strict=True):
        bearing = np.abs(surface - np.median(surface)) < _SAME
        lifts[start:end, 2] = (surface[bearing] - points[start:end, bearing, 2]).max(axis=1)
    return carried(lifts, held, blend)


def _stepped_over(motion: Motion, legs: tuple[Leg, Leg], weights: Array, ground: Ground, rate: float) -> Motion:
    """Lift swinging feet out of the surface; those that stand are on it already."""
    depths = np.stack([_depth(sole_points(leg, motion), ground) for leg in legs], axis=1)
    smooth = np.stack([_softened(depth, rate) for depth in depths.T], axis=1)
    rise = np.maximum(depths, (1.0 - weights) * smooth)
    return reached(motion, legs, ankles(motion, legs) + rise[..., None] * _UP)


def _surfaced(motion: Motion, performance: Performance, legs: tuple[Leg, Leg], ground: Ground) -> Motion:
    """Lift a body whose knees or hips are below the surface; its feet stay."""
    names = [performance.bone_map.bone(role) for role in _BODY]
    joints = motion.heads[:, [performance.skeleton.index(name) for name in names if name]]
    rise = _softened(_depth(joints, ground), performance.rate)
    if not rise.any():
        return motion
    return reached(shifted(motion, rise[:, None] * _UP), legs, ankles(motion, legs))


def _depth(points: Array, ground: Ground) -> Array:
    """(T,) how far the deepest of (T, P, 3) points is below the surface near it; 0 where none is."""
    return np.maximum(ground.height(points[..., :2], points[..., 2]) - points[..., 2], 0.0).max(axis=1)


def _softened(depth: Array, rate: float) -> Array:
    return raised(depth, max(int(np.ceil(_SOFTLY * rate)), 1))
