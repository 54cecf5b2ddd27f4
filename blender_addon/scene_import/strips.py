# SPDX-License-Identifier: GPL-3.0-or-later
"""Actions as strips of the NLA editor."""

import bpy


def push_down(owner: bpy.types.ID, start: int) -> None:
    """Move an owner's active action to a strip on a new track of its own; the motion stays the same.

    Args:
        owner: has an action.
        start: scene frame of the action's first key.
    """
    animation = owner.animation_data
    action = animation.action
    slot = getattr(animation, "action_slot", None)
    track = animation.nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, start, action)
    if slot is not None:
        strip.action_slot = slot
    animation.action = None
