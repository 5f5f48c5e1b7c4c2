"""A matrix of correlations: numbers on tints, their signs written."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import Svg, element, joined, shortened, text
from anaplot.drawing.frame import WIDTH
from anaplot.drawing.legend import Entry, legend
from anaplot.drawing.plot import Head, drawn
from anaplot.drawing.textwidth import SMALL, text_width
from anaplot.drawing.ticks import written

__all__ = ["LARGEST", "correlation_matrix"]

LARGEST = 60
"""Rows of a matrix that is drawn."""

_STEPS = (0.3, 0.6, 0.9)
_NUMBERS = 22  # rows up to which every cell has its number
_NAME = 18  # characters


def correlation_matrix(
    head: Head,
    names: Sequence[str],
    values: Array,
    description: str,
    *,
    notes: Sequence[str] = (),
) -> Drawing:
    """Return a matrix of correlations, its lower triangle.

    Parameters
    ----------
    head, description
        What stands above it, and what it says in words.
    names
        n names of rows and columns, at most `LARGEST`.
    values
        (n, n) correlations; NaN where there is none.
    notes
        What is not drawn.
    """
    n = len(names)
    if n > LARGEST:
        raise ValueError(f"a matrix of {n} rows is not drawn")
    short = [shortened(name, _NAME) for name in names]
    left = 24.0 + max((text_width(name, SMALL) for name in short), default=0.0)
    size = min(44.0, (WIDTH - left - 20.0) / max(n, 1))
    high = min(size, 26.0)
    top = head.bottom
    size_class = "t-small" if size >= 26.0 else "t-tiny"
    parts: list[Svg] = []
    for i in range(n):
        y = top + high * i
        parts.append(text(left - 6.0, y + high / 2.0 + 3.8, names[i], "t-small t-end", most=_NAME))
        for j in range(i):
            rho = float(values[i, j])
            parts.append(_cell(rho, left + size * j, y, size, high, n, size_class))
        x = left + size * i
        parts.append(element("rect", x=x, y=y, width=size, height=high, class_="f-grid gap"))
    bottom = top + high * n
    length = max((text_width(name, SMALL) for name in short), default=0.0)
    for j in range(n):
        x = left + size * (j + 0.5)
        upright = size < max(text_width(name, SMALL) for name in short)
        if upright:
            parts.append(
                text(x + 3.8, bottom + 6.0, names[j], "t-small t-end", most=_NAME, turned=True)
            )
        else:
            parts.append(text(x, bottom + 15.0, names[j], "t-small t-mid", most=_NAME))
    bottom += length + 12.0 if n and size < length else 22.0
    entries = [
        Entry("area", "−0.3 to −0.6", "f-minus-1 rim"),
        Entry("area", "to −0.9", "f-minus-2 rim"),
        Entry("area", "to −1", "f-minus-3 rim"),
        Entry("area", "0.3 to 0.6", "f-plus-1 rim"),
        Entry("area", "to 0.9", "f-plus-2 rim"),
        Entry("area", "to 1", "f-plus-3 rim"),
    ]
    explained, height = legend(entries, 24.0, bottom + 4.0, WIDTH - 44.0)
    bottom += height + 8.0
    for note in notes:
        bottom += 16.0
        parts.append(text(24.0, bottom, note, "t-soft t-small"))
    words = " ".join((description, *notes))
    return drawn(head, words, joined(*parts, explained), bottom + 12.0, notes)


def _cell(
    rho: float, x: float, y: float, width: float, height: float, n: int, size_class: str
) -> Svg:
    """Return a cell with its number; in large matrices only the sign of what is not small."""
    if not np.isfinite(rho):
        return text(x + width / 2.0, y + height / 2.0 + 3.8, "·", f"{size_class} t-mid t-soft")
    step = sum(abs(rho) >= limit for limit in _STEPS)
    sign = "minus" if rho < 0.0 else "plus"
    parts = []
    if step:
        box = f"f-{sign}-{step} gap"
        parts.append(element("rect", x=x, y=y, width=width, height=height, class_=box))
    if n <= _NUMBERS:
        shown = written(rho, 2)
        weight = "t-strong" if step == len(_STEPS) else "t-soft" if not step else ""
    elif step:
        shown, weight = ("−" if rho < 0.0 else "+"), "t-strong"
    else:
        return joined(*parts)
    classes = " ".join(filter(None, (size_class, "t-mid", weight)))
    parts.append(text(x + width / 2.0, y + height / 2.0 + 3.8, shown, classes))
    return joined(*parts)
