"""A rectangle of a picture with axes: metres (or seconds and centimetres) to pixels, grid and labels."""

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from core_solver.preview.text import INK, draw_plain_text

Image = NDArray[np.uint8]
Colour = tuple[int, int, int]

GRID = (228, 226, 224)
_FRAME = (170, 165, 160)
_MARGIN = (54, 30, 16, 34)  # left, top, right, bottom pixels for labels around the axes


@dataclass(frozen=True)
class Range:
    """What an axis shows."""

    low: float
    high: float

    @property
    def span(self) -> float:
        """Length of the axis, in its unit."""
        return self.high - self.low


class Panel:
    """Axes inside `picture`; the second axis points up."""

    def __init__(
        self, picture: Image, box: tuple[int, int, int, int], across: Range, up: Range, *, equal: bool
    ) -> None:
        """Lay axes into a box (left, top, right, bottom); with `equal` both axes get the scale of the tighter one."""
        left, top, right, bottom = (edge + sign * m for edge, sign, m in zip(box, (1, 1, -1, -1), _MARGIN, strict=True))
        self._view = picture[top:bottom, left:right]
        self._picture, self._corner = picture, (left, top)
        height, width = self._view.shape[:2]
        scale = np.array([width / across.span, height / up.span])
        if equal:
            scale[:] = scale.min()
        # With equal scales one axis has room to spare: it shows more on both sides.
        self.across = _widened(across, width / scale[0])
        self.up = _widened(up, height / scale[1])
        self._scale = scale
        self._view[:] = 255

    def pixels(self, points: ArrayLike) -> NDArray[np.int32]:
        """Points (..., 2) in the axes' units to whole pixels of the view."""
        points = np.asarray(points, float)
        u = (points[..., 0] - self.across.low) * self._scale[0]
        v = (self.up.high - points[..., 1]) * self._scale[1]
        return np.clip(np.round(np.stack([u, v], axis=-1)), -30_000, 30_000).astype(np.int32)

    def title(self, text: str) -> None:
        """Text above the axes."""
        draw_plain_text(self._picture, text, (self._corner[0], self._corner[1] - 10), 0.6)

    def grid(self, across_unit: str, up_unit: str) -> None:
        """Grid lines at round numbers, labelled at the left and below; none across without a unit."""
        height, width = self._view.shape[:2]
        for value in _round_values(self.across, width / 90) if across_unit else []:
            u = int(self.pixels((value, 0))[0])
            cv2.line(self._view, (u, 0), (u, height), GRID, 1)
            self._label(f"{value:g}", u - 8, height + 16)
        for value in _round_values(self.up, height / 60):
            v = int(self.pixels((0, value))[1])
            cv2.line(self._view, (0, v), (width, v), GRID, 1)
            self._label(f"{value:g}", -40, v + 5)
        self._label(across_unit, width - 9 * len(across_unit), height + 31)
        self._label(up_unit, 4, 14)

    def frame(self) -> None:
        """The outline, drawn last so that nothing covers it."""
        height, width = self._view.shape[:2]
        cv2.rectangle(self._view, (0, 0), (width - 1, height - 1), _FRAME, 1)

    def line(self, points: ArrayLike, colour: Colour, thickness: int = 1) -> None:
        """A polyline through (n, 2) points."""
        cv2.polylines(self._view, [self.pixels(points).reshape(-1, 1, 2)], False, colour, thickness, cv2.LINE_AA)

    def area(self, points: ArrayLike, colour: Colour) -> None:
        """A filled convex polygon."""
        cv2.fillConvexPoly(self._view, self.pixels(points), colour, cv2.LINE_AA)

    def disc(self, point: ArrayLike, radius: int, colour: Colour, *, hollow: bool = False) -> None:
        """A dot of so many pixels."""
        u, v = self.pixels(point).tolist()
        cv2.circle(self._view, (u, v), radius, (255, 255, 255) if hollow else colour, -1, cv2.LINE_AA)
        cv2.circle(self._view, (u, v), radius, colour, 2, cv2.LINE_AA)

    def dots(self, points: NDArray[np.float64], colours: Image) -> None:
        """Single pixels; later ones cover earlier ones."""
        pixels = self.pixels(points)
        height, width = self._view.shape[:2]
        inside = np.all((pixels >= 0) & (pixels < (width, height)), axis=1)
        u, v = pixels[inside].T
        self._view[v, u] = colours[inside]

    def text(self, text: str, point: ArrayLike, shift: tuple[int, int] = (0, 0), colour: Colour = INK) -> None:
        """Text at a point, shifted by pixels."""
        u, v = self.pixels(point).tolist()
        draw_plain_text(self._view, text, (u + shift[0], v + shift[1]), 0.45, colour)

    def _label(self, text: str, u: float, v: float) -> None:
        draw_plain_text(self._picture, text, (self._corner[0] + u, self._corner[1] + v), 0.42)


def _widened(axis: Range, span: float) -> Range:
    extra = (span - axis.span) / 2
    return Range(axis.low - extra, axis.high + extra)


def _round_values(axis: Range, count: float) -> list[float]:
    """Round numbers in steps of 1, 2 or 5 times a power of ten, about `count` of them."""
    rough = axis.span / max(count, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * f for f in (1, 2, 5, 10) if power * f >= rough * 0.999)
    first, last = math.ceil(axis.low / step), math.floor(axis.high / step)
    return [round(n * step, 6) for n in range(first, last + 1)]
