# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of objects as users and scripts write them into one field."""

import bpy


def listed_names(context: bpy.types.Context, text: str) -> list[str]:
    """The names in a list with commas; a text that is the whole name of an object of the scene is that one name."""
    if text.strip() in context.scene.objects:
        return [text.strip()]
    return [name for part in text.split(",") if (name := part.strip())]
