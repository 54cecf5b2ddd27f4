# SPDX-License-Identifier: GPL-3.0-or-later
"""Smoothing without lag: the fast part of all rotations and of the path goes, feet that stand stay."""

from ..retarget.rotation_modes import QUATERNION, matrices_from_channels
from ..retarget.skeleton import Motion, channels_of, pose
from .feet import legs_of, placed
from .foot_lock import standing
from .performance import Performance
from .signals import low_pass


def smooth(performance: Performance, cutoff: float, *, keep_contacts: bool = True) -> Motion:
    """Take out what is faster than a cut-off.

    Rotations are averaged as unit quaternions, which is the mean rotation to the second order of what is averaged.

    Args:
        performance: a person's.
        cutoff: Hz, where half the power is gone: 6 keeps a fast walk crisp, 2 leaves slow gestures only.
        keep_contacts: bend the legs so that standing feet stay where they stood.
    """
    skeleton, motion = performance.skeleton, performance.motion
    channels = channels_of(skeleton, motion)
    # Lengths other than one do not matter: quaternions are directions.
    quaternions = low_pass(channels.quaternions, performance.rate, cutoff)
    locations = low_pass(channels.locations, performance.rate, cutoff)
    smoothed = pose(skeleton, motion.times, matrices_from_channels(quaternions, QUATERNION), locations)
    return _replanted(performance, smoothed) if keep_contacts else smoothed


def _replanted(performance: Performance, smoothed: Motion) -> Motion:
    legs = legs_of(performance.skeleton, performance.bone_map)
    stance, _ = standing(performance, smoothed, legs)
    return placed(smoothed, legs, stance, performance.rate)
