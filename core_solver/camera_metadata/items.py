"""The two lists of facts inside a movie header that name lenses: QuickTime's keyed items and GoPro's settings."""

import struct
from collections.abc import Iterator

_MOST_ITEMS = 1024
_MOST_TEXT = 256

# QuickTime's well-known types of an item's value, as struct formats.
_NUMBERS = {
    23: "f", 24: "d", 65: "b", 66: "h", 67: "i", 74: "q", 75: "B", 76: "H", 77: "I", 78: "Q",
}  # fmt: skip
_UTF8, _SIGNED, _UNSIGNED = 1, 21, 22

_GOPRO_NUMBERS = {b"b": "b", b"B": "B", b"s": "h", b"S": "H", b"l": "i", b"L": "I", b"f": "f", b"d": "d"}
_GOPRO_NESTED, _GOPRO_TEXT = b"\0", (b"c", b"F")
_GOPRO_DEPTH = 4

Value = float | str


def keyed_items(keys: bytes, values: bytes) -> dict[str, Value]:
    """The facts of a `keys` box and the `ilst` box beside it, by name.

    Args:
        keys: payload: version, count, then size, namespace and name of each.
        values: payload: boxes whose kind is the number of their key, each with a `data` box inside.
    """
    names = list(_key_names(keys))
    facts: dict[str, Value] = {}
    for number, item in _boxes(values):
        index = int.from_bytes(number, "big") - 1
        data = next((content for kind, content in _boxes(item) if kind == b"data"), b"")
        value = _item_value(data)
        if 0 <= index < len(names) and value is not None:
            facts[names[index]] = value
    return facts


def gopro_settings(payload: bytes, depth: int = 0) -> dict[str, Value]:
    """The single values of a GPMF block: four letters, type, size of one, how many, then the value in whole words."""
    facts: dict[str, Value] = {}
    place = 0
    while place + 8 <= len(payload) and len(facts) < _MOST_ITEMS:
        key, kind, size = payload[place : place + 4], payload[place + 4 : place + 5], payload[place + 5]
        length = size * int.from_bytes(payload[place + 6 : place + 8], "big")
        content = payload[place + 8 : place + 8 + length]
        if kind == _GOPRO_NESTED and depth < _GOPRO_DEPTH:
            facts = gopro_settings(content, depth + 1) | facts
        elif kind in _GOPRO_TEXT:
            facts.setdefault(key.decode("latin-1"), _text(content))
        elif kind in _GOPRO_NUMBERS and len(content) >= struct.calcsize(_GOPRO_NUMBERS[kind]):
            facts.setdefault(key.decode("latin-1"), struct.unpack_from(">" + _GOPRO_NUMBERS[kind], content)[0])
        place += 8 + (length + 3) // 4 * 4
    return facts


def _key_names(keys: bytes) -> Iterator[str]:
    place = 8
    for _ in range(min(int.from_bytes(keys[4:8], "big"), _MOST_ITEMS)):
        size = int.from_bytes(keys[place : place + 4], "big")
        if size < 8 or place + size > len(keys):
            return
        yield keys[place + 8 : place + size].decode("utf-8", "replace")
        place += size


def _boxes(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    place = 0
    for _ in range(_MOST_ITEMS):
        size = int.from_bytes(content[place : place + 4], "big")
        if size < 8 or place + size > len(content):
            return
        yield content[place + 4 : place + 8], content[place + 8 : place + size]
        place += size


def _item_value(data: bytes) -> Value | None:
    """Type, locale, value."""
    kind, value = int.from_bytes(data[:4], "big"), data[8:]
    if kind == _UTF8:
        return _text(value)
    if kind in (_SIGNED, _UNSIGNED) and 1 <= len(value) <= 8:
        return int.from_bytes(value, "big", signed=kind == _SIGNED)
    form = _NUMBERS.get(kind)
    if form is not None and len(value) == struct.calcsize(form):
        return struct.unpack(">" + form, value)[0]
    return None


def _text(value: bytes) -> str:
    return value[:_MOST_TEXT].partition(b"\0")[0].decode("utf-8", "replace").strip()
