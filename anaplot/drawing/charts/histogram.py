"""How often values of a size occur, beside how often they should."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anaplot.aliases import Array, Bools
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import text
from anaplot.drawing.frame import free_frame
from anaplot.drawing.legend import Entry, hatching
from anaplot.drawing.pathdata import segments
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.ticks import ticks, written

__all__ = ["histogram"]

_BAR = "f-series-1"


def histogram(
    head: Head,
    counts: Sequence[int] | Array,
    edges: Array,
    description: str,
    *,
    x_title: str,
    what: str = "found",
    curve: Array | None = None,
    curve_label: str = "",
    bounds: Sequence[float] = (),
    bounds_label: str = "",
    notes: Sequence[str] = (),
) -> Drawing:
    """Return a histogram.

    Parameters
    ----------
    head, description
        What stands above it, and what it says in words.
    counts, edges
        (n,) numbers of values between (n + 1,) ascending edges.
    x_title
        What was counted, with its unit.
    what
        What the bars are called.
    curve, curve_label
        (k, 2) expected numbers by value, and what they are called; None: there is none.
    bounds, bounds_label
        Values at upright lines; bars beyond the outer ones are hatched.
    notes
        What is not drawn.
    """
    counts = np.asarray(counts, dtype=float)
    top = max(float(counts.max(initial=0.0)), 1.0)
    if curve is not None:
        top = max(top, float(curve[:, 1].max()))
    frame = free_frame(
        head.bottom, (float(edges[0]), float(edges[-1])), (0.0, top * 1.04), round_x=False
    )
    plot = Plot(head, frame)
    plot.axes(x_title, "number", x_ticks=ticks(*frame.x, 13))
    left, right = edges[:-1], edges[1:]
    some = counts > 0.0
    zero = np.zeros_like(counts)
    corners = np.stack(
        [
            np.stack((x, y), 1)
            for x, y in ((left, zero), (left, counts), (right, counts), (right, zero))
        ],
        axis=1,
    )
    plot.areas(corners[some], f"gap {_BAR}")
    outer = _outside(left, right, bounds) & some
    for k in np.flatnonzero(outer).tolist():
        (begin, bottom), (_, high), (end, _), _ = frame.places(corners[k]).tolist()
        plot.add(hatching(begin, high, end - begin, bottom - high))
    plot.explain(Entry("area", what, _BAR))
    if outer.any():
        plot.explain(Entry("hatched", f"{what}, beyond the bound", _BAR))
    if curve is not None:
        plot.line(curve, "bold l-series-2")
        plot.explain(Entry("line", curve_label, "line bold l-series-2"))
    for bound in bounds:
        at, _ = frame.places(np.array([bound, 0.0])).tolist()
        ends = np.array([[at, frame.top]]), np.array([[at, frame.bottom]])
        plot.path(segments(*ends), "line dashed l-ink")
        plot.add(text(at + 4.0, frame.top + 13.0, written(bound, 2), "t-small t-halo"))
    if len(bounds):
        plot.explain(Entry("line", bounds_label, "line dashed l-ink"))
    plot.note(*notes)
    return plot.drawing(description)


def _outside(left: Array, right: Array, bounds: Sequence[float]) -> Bools:
    """Return (n,) which bars lie wholly beyond the outer bounds."""
    if not len(bounds):
        return np.zeros(len(left), dtype=bool)
    high = left >= max(bounds) - 1e-12
    low = right <= min(bounds) + 1e-12
    return np.asarray(high | low if len(bounds) > 1 else high)
