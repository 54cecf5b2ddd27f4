# SPDX-License-Identifier: GPL-3.0-or-later
"""Message catalogues for Blender's own translation: `LANGUAGE.json` beside this file, English to that language.

Blender translates labels, names and tooltips by itself where they are drawn; what the code composes goes through
`bpy.app.translations.pgettext_*`.
"""

import json
from pathlib import Path

import bpy

_NAME = __package__ or ""
# Buttons look their labels up as operators', everything else without a context; the English words are the same.
_CONTEXTS = ("*", "Operator")


def catalogues() -> dict[str, dict[str, str]]:
    """The messages of every language, English to translation, by the language's code."""
    files = sorted(Path(__file__).parent.glob("*.json"))
    return {file.stem: json.loads(file.read_text(encoding="utf-8")) for file in files}


def register() -> None:
    """Make the catalogues known to Blender."""
    messages = {
        language: {(context, english): own for english, own in catalogue.items() for context in _CONTEXTS}
        for language, catalogue in catalogues().items()
    }
    bpy.app.translations.register(_NAME, messages)


def unregister() -> None:
    """Take them back."""
    bpy.app.translations.unregister(_NAME)
