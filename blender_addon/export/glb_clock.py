# SPDX-License-Identifier: GPL-3.0-or-later
"""Mend the times in a GLB file: stretch the clock of its animations. numpy and the standard library only.

Blender's glTF exporter turns frames into seconds wrongly for rates that are not whole: at 29.97 it multiplies by
Blender's frame rate base where it should divide. So files are written at a whole rate and stretched afterwards.
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<II")


def stretch_clock(path: Path, factor: float) -> None:
    """Multiply all times of all animations in a GLB file.

    Args:
        path: a GLB with one JSON chunk followed by one binary chunk, as Blender writes it.
        factor: new seconds per old second.
    """
    content = bytearray(path.read_bytes())
    json_length, _ = _CHUNK.unpack_from(content, _HEADER.size)
    json_start = _HEADER.size + _CHUNK.size
    document = json.loads(content[json_start : json_start + json_length])
    binary = content[json_start + json_length :]
    for index in _clock_accessors(document):
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        start = _CHUNK.size + view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        # A view of the bytes: writing to it writes to the chunk.
        times = np.frombuffer(binary, "<f4", accessor["count"], start)
        times *= np.float32(factor)
        accessor["min"], accessor["max"] = [float(times.min())], [float(times.max())]
    path.write_bytes(_assemble(content, document, binary))


def _clock_accessors(document: dict[str, Any]) -> set[int]:
    """Samplers share accessors: each is to be stretched once."""
    return {sampler["input"] for animation in document.get("animations", []) for sampler in animation["samplers"]}


def _assemble(content: bytearray, document: dict[str, Any], binary: bytearray) -> bytes:
    magic, version, _ = _HEADER.unpack_from(content)
    _, json_kind = _CHUNK.unpack_from(content, _HEADER.size)
    text = json.dumps(document, separators=(",", ":")).encode()
    # Chunks end on multiples of four bytes; JSON is filled up with spaces.
    text += b" " * (-len(text) % 4)
    total = _HEADER.size + _CHUNK.size + len(text) + len(binary)
    return _HEADER.pack(magic, version, total) + _CHUNK.pack(len(text), json_kind) + text + bytes(binary)
