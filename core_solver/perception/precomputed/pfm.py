"""Portable float maps: one float a pixel, the lowest row first."""

import re

import numpy as np
from numpy.typing import NDArray

_HEAD = re.compile(rb"(P[fF])\s+(\d{1,6})\s+(\d{1,6})\s+([-+]?[0-9.eE+-]{1,20})\s")


def decode_pfm(data: bytes) -> NDArray[np.float32]:
    """The picture (h, w); the first channel of a coloured one.

    Raises:
        ValueError: damaged, cut off or no PFM file.
    """
    head = _HEAD.match(data)
    if head is None:
        raise ValueError("its head is not a PFM file's")
    width, height, scale = int(head[2]), int(head[3]), float(head[4])
    channels = 3 if head[1] == b"PF" else 1
    count = width * height * channels
    if count == 0 or len(data) - head.end() < 4 * count:
        raise ValueError("it is cut off")
    values = np.frombuffer(data, "<f4" if scale < 0 else ">f4", count, head.end())
    return values.reshape(height, width, channels)[::-1, :, 0].astype(np.float32)
