"""Ordered values against those that a distribution lets expect."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array, Bools, Index
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.frame import free_frame
from anaplot.drawing.legend import Entry
from anaplot.drawing.pathdata import polygons
from anaplot.drawing.plot import Head, Plot

__all__ = ["quantile_plot", "shown_ranks"]

_MOST = 600  # dots


def shown_ranks(n: int, most: int = _MOST) -> Index:
    """Return which of n ordered values are drawn: those at both ends, of the others every k-th."""
    if n <= most:
        return np.arange(n)
    end = most // 4
    middle = np.linspace(end, n - end - 1, most - 2 * end).round().astype(np.intp)
    return np.unique(np.concatenate((np.arange(end), middle, np.arange(n - end, n))))


def quantile_plot(
    head: Head,
    expected: Array,
    observed: Array,
    description: str,
    *,
    x_title: str,
    y_title: str,
    band: tuple[Array, Array] | None = None,
    band_label: str = "",
    marked: Bools | None = None,
    marked_label: str = "",
    what: str = "found",
    notes: Sequence[str] = (),
) -> Drawing:
    """Return a quantile plot.

    Parameters
    ----------
    head, description
        What stands above it, and what it says in words.
    expected, observed
        (n,) ascending: quantiles of the distribution, and the ordered values.
    x_title, y_title
        What they are.
    band, band_label
        (n,) between which values each should lie, and what the band is called.
    marked, marked_label
        (n,) which values are crossed, and what they are called.
    what
        What the dots are called.
    notes
        What is not drawn.
    """
    columns = [observed, expected, *(band or ())]
    low = min(float(column.min()) for column in columns)
    high = max(float(column.max()) for column in columns)
    plain = (float(expected.min()), float(expected.max()))
    frame = free_frame(head.bottom, plain, (low, high), height=340.0)
    plot = Plot(head, frame)
    plot.axes(x_title, y_title)
    if band is not None:
        lower, upper = (np.stack((expected, one), axis=1) for one in band)
        ring = frame.places(np.vstack((lower, upper[::-1])))[None]
        plot.path(polygons(ring), "f-series-2 tint")
        plot.explain(Entry("area", band_label, "f-series-2 tint"))
    ends = np.array([max(frame.x[0], frame.y[0]), min(frame.x[1], frame.y[1])])
    if ends[0] < ends[1]:
        plot.line(np.stack((ends, ends), axis=1), "l-series-2")
        plot.explain(Entry("line", "as expected", "line l-series-2"))
    at = np.stack((expected, observed), axis=1)
    crossed = np.zeros(len(at), dtype=bool) if marked is None else marked
    plot.dots(at[~crossed], "l-series-1", 4.0)
    plot.explain(Entry("dot", what, "dot l-series-1", size=4.0))
    if crossed.any():
        plot.marks("cross", at[crossed], "line bold l-bad", 4.0)
        plot.explain(Entry("mark", marked_label, "line bold l-bad", "cross", 4.0))
    plot.note(*notes)
    return plot.drawing(description)
