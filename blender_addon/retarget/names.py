# SPDX-License-Identifier: GPL-3.0-or-later
"""Bone names as people and programs write them: case, separators, sides and prefixes taken away."""

import re
from collections import Counter
from collections.abc import Sequence

# Capitals that stand together, words with or without a capital, numbers, and letters of other scripts.
_WORDS = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+|[^\x00-\x7f]+")
_SIDES: dict[str, str] = {"l": "left", "left": "left", "r": "right", "right": "right"}
# Share of a rig's bones that must have a word in common for it to say nothing.
_COMMON = 0.8


def canonical(name: str) -> str:
    """One spelling for "LeftUpLeg", "left_up_leg", "UpLeg.L", "upleg_l" and "L UpLeg"."""
    return _spell(_words(name))


def readings(names: Sequence[str]) -> tuple[dict[str, str], ...]:
    """Bones by canonical names, in all ways that make sense for a rig.

    Besides the names as they are: without the first words that nearly all bones share ("mixamorig", "CC_Base"), and
    without the running number that some converters append to every name.
    """
    words = [_words(name) for name in names]
    without_prefix = _without_common_prefix(words)
    variants = [words, without_prefix]
    variants += [[w[:-1] for w in variant] for variant in variants if _are_numbered(variant)]
    return tuple(_first_of_each(variant, names) for variant in variants)


def _words(name: str) -> list[str]:
    """Lower-case words without namespace; numbers without leading zeros; sides written out."""
    words: list[str] = []
    for word in _WORDS.findall(re.split(r"[:|]", name)[-1]):
        small = str(word).lower()
        side = next((s for s in ("left", "right") if small.startswith(s) and small != s), "")
        if small.isdecimal():
            words.append(str(int(small)))
        elif side:
            words += [side, small.removeprefix(side)]
        else:
            words.append(_SIDES.get(small, small))
    return words


def _spell(words: Sequence[str]) -> str:
    side = next((word for word in words if word in ("left", "right")), "")
    rest = list(words)
    if side:
        rest.remove(side)
    return f"{side}:{''.join(rest)}"


def _without_common_prefix(words: list[list[str]]) -> list[list[str]]:
    while True:
        first = Counter(w[0] for w in words if len(w) > 1)
        word, count = first.most_common(1)[0] if first else ("", 0)
        if not word or count < _COMMON * len(words):
            return words
        words = [w[1:] if len(w) > 1 and w[0] == word else w for w in words]


def _are_numbered(words: list[list[str]]) -> bool:
    return sum(len(w) > 1 and w[-1].isdecimal() for w in words) >= _COMMON * len(words)


def _first_of_each(words: list[list[str]], names: Sequence[str]) -> dict[str, str]:
    found: dict[str, str] = {}
    for spelled, name in zip(map(_spell, words), names, strict=True):
        found.setdefault(spelled, name)
    return found
