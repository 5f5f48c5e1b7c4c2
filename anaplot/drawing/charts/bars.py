"""Bars: a number each of things with names."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import element, shortened, text
from anaplot.drawing.frame import WIDTH, Frame
from anaplot.drawing.legend import Entry, hatching
from anaplot.drawing.pathdata import segments
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.textwidth import SMALL, text_width
from anaplot.drawing.ticks import covering, ticks, written

__all__ = ["MOST_BARS", "bars"]

MOST_BARS = 40
"""Bars of one drawing."""

_ROW = 18.0
_NAME = 24  # characters
_HATCHED = 36.0  # of a bar that is marked
_BEYOND = 1.07  # of the longest bar: room for its number


def bars(
    head: Head,
    names: Sequence[str],
    values: Array,
    description: str,
    *,
    x_title: str,
    what: str,
    bound: float | None = None,
    bound_label: str = "",
    marked: Bools | None = None,
    marked_label: str = "",
    notes: Sequence[str] = (),
) -> Drawing:
    """Return lying bars from top to bottom.

    Parameters
    ----------
    head, description
        What stands above them, and what they say in words.
    names, values
        n names, at most `MOST_BARS`, and (n,) finite numbers.
    x_title
        What the numbers are, with their unit.
    what
        What the bars are called.
    bound, bound_label
        A number at an upright line, and what it is called.
    marked, marked_label
        (n,) which bars are hatched, and what they are called.
    notes
        What is not drawn.
    """
    n = len(names)
    if not 0 < n <= MOST_BARS:
        raise ValueError(f"{n} bars are not drawn")
    short = [shortened(name, _NAME) for name in names]
    left = 30.0 + max(text_width(name, SMALL) for name in short)
    numbers = [0.0, *values.tolist()]
    if bound is not None:
        numbers.append(bound)
    round_x = covering(_BEYOND * min(numbers), _BEYOND * max(numbers), 9).values
    frame = Frame(
        left,
        head.bottom,
        WIDTH - left - 48.0,
        _ROW * n + 8.0,
        (round_x[0], round_x[-1]),
        (0.0, 1.0),
    )
    plot = Plot(head, frame)
    plot.axes(
        x_title, "", x_ticks=ticks(*frame.x, 9), y_ticks=covering(0.0, 1.0, 3)._replace(values=())
    )
    x = frame.places(np.stack((values, np.zeros(n)), axis=1))[:, 0]
    zero = float(frame.places(np.zeros(2))[0])
    hatched = np.zeros(n, dtype=bool) if marked is None else marked
    for k in range(n):
        y = frame.top + 4.0 + _ROW * k
        low, width = min(zero, float(x[k])), abs(float(x[k]) - zero)
        box = element("rect", x=low, y=y + 2.5, width=width, height=_ROW - 5.0, class_="f-series-1")
        plot.add(box)
        if hatched[k]:
            # its outer end is enough to be seen
            end = min(width, _HATCHED)
            begin = low if x[k] < zero else low + width - end
            plot.add(hatching(begin, y + 2.5, end, _ROW - 5.0))
        plot.add(text(left - 7.0, y + 12.8, names[k], "t-small t-end", most=_NAME))
        value = written(float(values[k]), 2)
        plot.add(text(max(zero, float(x[k])) + 5.0, y + 12.8, value, "t-small t-halo"))
    plot.explain(Entry("area", what, "f-series-1"))
    if hatched.any():
        plot.explain(Entry("hatched", marked_label, "f-series-1"))
    if bound is not None:
        at = float(frame.places(np.array([bound, 0.0]))[0])
        ends = np.array([[at, frame.top]]), np.array([[at, frame.bottom]])
        plot.path(segments(*ends), "line dashed bold l-series-2")
        plot.explain(Entry("line", bound_label, "line dashed bold l-series-2"))
    plot.note(*notes)
    return plot.drawing(description)
