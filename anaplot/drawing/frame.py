"""The rectangle that a chart is drawn in: from numbers to places, with equal or free scales."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anaplot.aliases import Array
from anaplot.drawing.ticks import covering

__all__ = ["WIDTH", "Frame", "Range", "equal_frame", "free_frame"]

Range = tuple[float, float]
"""Lowest and highest value."""

WIDTH = 640.0
"""Width of every drawing; a page shows it as wide as it has room."""

_LEFT, _RIGHT = 84.0, 16.0
_NUMBERS = 64.0  # room for numbers at the left of a frame that is not to scale
_MARGIN = 0.06  # of the extent, around what is drawn to scale
_FINEST = 1e-9  # of the size of the numbers: a narrower extent is no axis
_FLATTEST, _STEEPEST = 0.34, 0.92  # height over width of a frame to scale


@dataclass(frozen=True, slots=True)
class Frame:
    """A rectangle and the numbers at its sides.

    Attributes
    ----------
    left, top, width, height
        In units of the drawing.
    x, y
        Numbers at the left and right side, and at the lower and upper one.
    """

    left: float
    top: float
    width: float
    height: float
    x: Range
    y: Range

    @property
    def right(self) -> float:
        """Its right side."""
        return self.left + self.width

    @property
    def bottom(self) -> float:
        """Its lower side."""
        return self.top + self.height

    @property
    def scale(self) -> tuple[float, float]:
        """Units of the drawing for one of x and for one of y."""
        return self.width / (self.x[1] - self.x[0]), self.height / (self.y[1] - self.y[0])

    def places(self, points: Array) -> Array:
        """Return (n, 2) places of (n, 2) numbers; also (n, k, 2) of as many."""
        sx, sy = self.scale
        out = np.empty(np.shape(points))
        out[..., 0] = self.left + (points[..., 0] - self.x[0]) * sx
        out[..., 1] = self.bottom - (points[..., 1] - self.y[0]) * sy
        return out

    def steps(self, vectors: Array) -> Array:
        """Return (n, 2) steps in the drawing of (n, 2) differences of numbers."""
        sx, sy = self.scale
        return np.asarray(vectors * np.array([sx, -sy]))

    def spreads(self, covariance: Array) -> Array:
        """Return (n, 2, 2) covariances in the drawing of those of numbers."""
        sx, sy = self.scale
        turned = np.array([sx, -sy])
        return np.asarray(covariance * turned[:, None] * turned)

    def within(self, start: Array, step: Array) -> Array:
        """Return (n,) which part, 0 to 1, of steps in the drawing lies within the frame.

        Of a step that begins outside it is all: what lies outside is not cut.
        """
        low, high = np.array([self.left, self.top]), np.array([self.right, self.bottom])
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(step > 0.0, (high - start) / step, (low - start) / step)
        room = np.where(step == 0.0, 1.0, room).min(axis=1)
        return np.where(((start >= low) & (start <= high)).all(axis=1), np.minimum(room, 1.0), 1.0)


def free_frame(
    top: float,
    x: Range,
    y: Range,
    *,
    height: float = 270.0,
    round_x: bool = True,
) -> Frame:
    """Return a frame as wide as the drawing whose sides are round numbers.

    Parameters
    ----------
    top
        Its upper side.
    x, y
        What it has to hold.
    height
        Of it.
    round_x
        Whether its left and right side are round, too.
    """
    y = _wide(y)
    x = _wide(x)
    if round_x:
        of_x = covering(*x, most=12).values
        x = of_x[0], of_x[-1]
    of_y = covering(*y).values
    return Frame(_NUMBERS, top, WIDTH - _NUMBERS - _RIGHT, height, x, (of_y[0], of_y[-1]))


def equal_frame(top: float, points: Array, *, margin: float = _MARGIN) -> Frame:
    """Return a frame as wide as the drawing in which x and y have the same scale.

    Parameters
    ----------
    top
        Its upper side.
    points
        (n, 2) what it has to hold; n may be 0.
    margin
        Room around them, in parts of their larger extent.
    """
    if len(points) == 0:
        points = np.zeros((1, 2))
    low, high = points.min(axis=0), points.max(axis=0)
    middle, extent = (low + high) / 2.0, high - low
    least = max(float(np.abs(points).max()) * _FINEST, 1e-12)
    size = max(float(extent.max()), least) * (1.0 + 2.0 * margin)
    extent = np.maximum(extent + 2.0 * margin * extent.max(), 1e-3 * size)
    width = WIDTH - _LEFT - _RIGHT
    ratio = min(max(float(extent[1] / extent[0]), _FLATTEST), _STEEPEST)
    height = round(width * ratio)
    scale = min(width / extent[0], height / extent[1])
    half_x, half_y = width / scale / 2.0, height / scale / 2.0
    return Frame(
        _LEFT,
        top,
        width,
        height,
        (float(middle[0] - half_x), float(middle[0] + half_x)),
        (float(middle[1] - half_y), float(middle[1] + half_y)),
    )


def _wide(of: Range) -> Range:
    """Return a range in which numbers of this size can be told apart."""
    low, high = of
    least = max(abs(low), abs(high)) * _FINEST
    if high - low < least:
        middle = (low + high) / 2.0
        return middle - least, middle + least
    return low, high
