"""What the marks and lines of a drawing mean, in rows beneath it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anaplot.drawing.element import NOTHING, Svg, element, joined, shortened, text
from anaplot.drawing.pathdata import Shape, arrows, dots, ellipses, marks, segments
from anaplot.drawing.textwidth import text_width

__all__ = ["Entry", "hatching", "legend"]

_ROW = 20.0
_SYMBOL, _GAP, _AFTER = 20.0, 6.0, 20.0
_LONGEST = 90  # characters of what is said


@dataclass(frozen=True, slots=True)
class Entry:
    """A symbol and what it means.

    Attributes
    ----------
    kind
        "mark" of a shape, "dot", "line", "area", "hatched", "arrow" or "ellipse" of a length.
    label
        What it means.
    classes
        As where it is drawn.
    shape, size
        Of a mark; width of a dot.
    length
        Of an arrow or an ellipse's longer axis, in units of the drawing.
    """

    kind: Literal["mark", "dot", "line", "area", "hatched", "arrow", "ellipse"]
    label: str
    classes: str
    shape: Shape = "circle"
    size: float = 4.5
    length: float = _SYMBOL

    @property
    def room(self) -> float:
        """Width of its symbol."""
        return max(_SYMBOL, self.length) if self.kind in ("arrow", "ellipse") else _SYMBOL

    def symbol(self, x: float, y: float) -> Svg:
        """Return the symbol with its left end in the middle of a line."""
        middle = np.array([[x + self.room / 2.0, y]])
        if self.kind == "mark":
            return element("path", d=marks(self.shape, middle, self.size), class_=self.classes)
        if self.kind == "dot":
            return element("path", d=dots(middle), class_=self.classes, stroke_width=self.size)
        if self.kind in ("area", "hatched"):
            box = element(
                "rect", x=x + 2.0, y=y - 5.5, width=16.0, height=11.0, class_=self.classes
            )
            if self.kind == "area":
                return box
            return joined(box, hatching(x + 2.0, y - 5.5, 16.0, 11.0))
        half = np.array([[self.length / 2.0, 0.0]])
        if self.kind == "ellipse":
            spread = np.array([[[half[0, 0] ** 2, 0.0], [0.0, (0.6 * half[0, 0]) ** 2]]])
            return element("path", d=ellipses(middle, spread), class_=self.classes)
        draw = arrows if self.kind == "arrow" else segments
        return element("path", d=draw(middle - half, middle + half), class_=self.classes)


def hatching(x: float, y: float, width: float, height: float) -> Svg:
    """Return slanting lines that fill a rectangle."""
    begins = np.arange(2.0, width + height, 4.0)
    start = np.stack((x + np.minimum(begins, width), y + np.maximum(begins - width, 0.0)), axis=1)
    end = np.stack((x + np.maximum(begins - height, 0.0), y + np.minimum(begins, height)), axis=1)
    return element("path", d=segments(start, end), class_="line thin l-ink")


def legend(entries: Sequence[Entry], left: float, top: float, width: float) -> tuple[Svg, float]:
    """Return a legend and how high it is.

    Parameters
    ----------
    entries
        In their order; they go on in the next row where there is no more room.
    left, top, width
        Where it may stand.
    """
    if not entries:
        return NOTHING, 0.0
    x, y = left, top + _ROW / 2.0
    parts: list[Svg] = []
    for entry in entries:
        label = shortened(entry.label, _LONGEST)
        wide = entry.room + _GAP + text_width(label)
        if x > left and x + wide > left + width:
            x, y = left, y + _ROW
        parts.append(entry.symbol(x, y))
        parts.append(text(x + entry.room + _GAP, y + 4.0, entry.label, most=_LONGEST))
        x += wide + _AFTER
    return element("g", joined(*parts), class_="legend"), y + _ROW / 2.0 - top
