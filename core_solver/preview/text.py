"""Words on pictures, readable on any background."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

WHITE = (255, 255, 255)
INK = (60, 50, 45)
_OUTLINE = (25, 25, 25)


def text_size(text: str, size: float) -> tuple[int, int]:
    """Width and height in pixels of all that `draw_text` paints."""
    (width, height), below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, _thickness(size))
    return width + 2 * _margin(size), height + below + 2 * _margin(size)


def draw_text(picture: NDArray[np.uint8], text: str, place: tuple[float, float], size: float) -> None:
    """Draw white outlined text, the lower left corner of all that is painted at (u, v) in the BGR picture."""
    thickness, margin = _thickness(size), _margin(size)
    _, below = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
    origin = round(place[0]) + margin, round(place[1]) - margin - below
    for paint, weight in ((_OUTLINE, 3 * thickness), (WHITE, thickness)):
        cv2.putText(picture, text, origin, cv2.FONT_HERSHEY_SIMPLEX, size, paint, weight, cv2.LINE_AA)


def _thickness(size: float) -> int:
    return max(1, round(1.5 * size))


def _margin(size: float) -> int:
    """Pixels for the outline, and for brackets, which are taller than OpenCV says."""
    return 2 * _thickness(size) + math.ceil(2.5 * size)


def draw_plain_text(
    picture: NDArray[np.uint8],
    text: str,
    place: tuple[float, float],
    size: float = 0.45,
    colour: tuple[int, int, int] = INK,
) -> None:
    """Draw text on a light background, its lower left corner at (u, v)."""
    origin = round(place[0]), round(place[1])
    cv2.putText(picture, text, origin, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
