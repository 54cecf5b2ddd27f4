"""Words on pictures, readable on any background."""

import cv2
import numpy as np
from numpy.typing import NDArray

WHITE = (255, 255, 255)
INK = (60, 50, 45)
_OUTLINE = (25, 25, 25)


def draw_text(picture: NDArray[np.uint8], text: str, place: tuple[float, float], size: float) -> None:
    """Draw white outlined text, its lower left corner at (u, v), moved to stay inside the BGR picture."""
    thickness = max(1, round(1.5 * size))
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, thickness)
    u = round(min(max(place[0], 2), max(picture.shape[1] - width - 4, 2)))
    v = round(min(max(place[1], height + 2), picture.shape[0] - 4))
    for paint, weight in ((_OUTLINE, 3 * thickness), (WHITE, thickness)):
        cv2.putText(picture, text, (u, v), cv2.FONT_HERSHEY_SIMPLEX, size, paint, weight, cv2.LINE_AA)


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
