"""What has moved between two epochs: displacements with their confidence ellipses."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.adjustment.hypothesis import critical_f
from anaplot.aliases import Array, Bools, Index
from anaplot.bundle.epochs.displacementtests import EpochTests
from anaplot.bundle.hypotheses.verdict import VarianceFactor
from anaplot.drawing.charts.bars import MOST_BARS, bars
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.frame import equal_frame
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.thinning import thinned
from anaplot.drawing.ticks import round_down, written
from anaplot.report.columns import counted
from anaplot.report.figures.blockmap import length_of
from anaplot.report.figures.groundview import PointView

__all__ = ["displacement_heights", "displacement_map"]

_MOST = 1500
_LONG = 46.0  # units of the drawing: the longer displacements
_FLAT = 0.25  # of their extent in plan: points that reach higher are looked at from the side
_LARGEST_ELLIPSE = 90.0


def displacement_map(tests: EpochTests, *, key: str = "displacements") -> Drawing | None:
    """Return the displacements of points as vectors; None without a compared point.

    Drawn are the two coordinates in which the points extend most: X and Y of a terrain, X and Z or
    Y and Z of a facade. Each has its confidence ellipse of 1 - alpha at its tip, by the sigma
    of the tests; points that the tests of single points reject (Bonferroni) are drawn bold with a
    diamond.

    Parameters
    ----------
    tests
        Tested displacements of two epochs, or of a pair of a series.
    key
        Of the drawing.
    """
    found = tests.differences
    n = len(found.points)
    if not n:
        return None
    view = PointView(*_looked_at(found.places))
    d = found.d.reshape(-1, 3)
    vectors = view.of(d)
    moved = _moved(tests)
    covariance, variance = _covariances(tests, view)
    length = np.hypot(vectors[:, 0], vectors[:, 1])
    head = Head(key, "x", "x")
    scale = view.frame(head).scale[0]
    times = round_down(_LONG / (max(float(np.quantile(length, 0.9)), 1e-12) * scale))
    where = "".join("XYZ"[k] for k in view.axes)
    largest = int(np.argmax(length))
    numbers = (
        f"{counted(n, 'point')}, {int(moved.sum())} moved; largest {length_of(length[largest])} at "
        f"point {found.points[largest]}"
    )
    title = f"Displacements in {where[0]} and {where[1]}, {found.epochs[0]} to {found.epochs[1]}"
    enlarged = f"{written(times, 0)} times enlarged" if times >= 1.0 else f"{times:g} times as long"
    remark = f"{numbers}. Displacements and ellipses {enlarged}."
    head = Head(key, title, remark)
    near = np.flatnonzero(view.near)
    tips = view.at[near] + vectors[near] * times
    plot = Plot(head, equal_frame(head.bottom, np.vstack((view.at[near], tips)), margin=0.08))
    plot.axes(*view.titles)
    chosen = near[thinned(view.at[near], _MOST, moved[near])]
    if variance is not None:
        radius = sqrt(2.0 * critical_f(tests.alpha, 2, variance.degrees))
        _ellipses(plot, view, vectors, covariance * radius**2, chosen, times)
        percent = f"{100.0 * (1.0 - tests.alpha):g}"
        plot.explain(
            Entry("ellipse", f"confidence ellipse, {percent} %", "line thin l-soft", length=20.0)
        )
    for these, classes in ((~moved, "l-series-1"), (moved, "bold l-series-2")):
        of = chosen[these[chosen]]
        plot.arrows(view.at[of], vectors[of], times, classes)
    plot.dots(view.at[chosen[~moved[chosen]]], "l-series-1", 4.5)
    plot.marks("diamond", view.at[chosen[moved[chosen]]], "f-series-2 rim", 4.5)
    unit = round_down(40.0 / (plot.frame.scale[0] * times))
    reach = unit * plot.frame.scale[0] * times
    plot.explain(
        Entry("arrow", length_of(unit), "line l-series-1", length=reach),
        Entry("dot", "not moved, or not testable", "dot l-series-1", size=4.5),
        Entry("mark", f"moved ({int(moved.sum())})", "f-series-2 rim", "diamond", 4.5),
    )
    order = chosen[np.argsort(~moved[chosen], kind="stable")]
    plot.names(view.at[order], [found.points[k] for k in order.tolist()], obstacles=tips[:2000])
    if len(chosen) < len(near):
        plot.note(f"{len(chosen)} of {len(near)} points are drawn, those that moved first.")
    plot.note(*view.far_note)
    return plot.drawing(f"{title}: {remark}")


def displacement_heights(tests: EpochTests, *, key: str = "heights") -> Drawing | None:
    """Return the displacements in height as bars, the most significant first; None without any."""
    found = tests.differences
    d = found.d.reshape(-1, 3)[:, 2]
    q = np.diag(found.cofactors).reshape(-1, 3)[:, 2]
    there = np.flatnonzero((q > 0.0) & ~found.given[:, 2])
    if not len(there):
        return None
    size = np.abs(d[there]) / np.sqrt(q[there])
    chosen = there[np.argsort(-size, kind="stable")][:MOST_BARS]
    rejected = np.array(
        [bool(p.coordinates[2].verdict and p.coordinates[2].verdict.rejected) for p in tests.points]
    )
    names = [found.points[k] for k in chosen.tolist()]
    largest = int(chosen[np.argmax(np.abs(d[chosen]))])
    title = f"Displacements in Z, {found.epochs[0]} to {found.epochs[1]}"
    numbers = (
        f"{counted(len(there), 'point')}, {int(rejected[there].sum())} moved in height; largest "
        f"{1e3 * d[largest]:.1f} mm at point {found.points[largest]}"
    ).replace(" -", " −")
    notes: tuple[str, ...] = ()
    if len(chosen) < len(there):
        notes = (f"{len(chosen)} of {len(there)} points are drawn, the most significant ones.",)
    return bars(
        Head(key, title, f"{numbers}."),
        names,
        1e3 * d[chosen],
        f"{title}: {numbers}.",
        x_title="dZ [mm]",
        what="displacement in height",
        decimals=1,
        marked=rejected[chosen],
        marked_label="moved (Bonferroni over all coordinates)",
        notes=notes,
    )


def _looked_at(places: Array) -> tuple[Array, tuple[int, int]]:
    """Return (n, 2) places along the axes of the drawing, and which axes these are."""
    extent = np.ptp(places, axis=0)
    axes = (0, 1)
    if extent[2] > _FLAT * max(extent[0], extent[1]) and min(extent[:2]) < extent[2]:
        axes = (0, 2) if extent[0] >= extent[1] else (1, 2)
    return places[:, list(axes)], axes


def _moved(tests: EpochTests) -> Bools:
    return np.array(
        [bool(point.verdict and point.verdict.rejected) for point in tests.points], dtype=bool
    )


def _covariances(tests: EpochTests, view: PointView) -> tuple[Array, VarianceFactor | None]:
    """Return (n, 2, 2) covariances of the displacements, and whose sigma is in them."""
    found = tests.differences
    n = len(found.points)
    at = np.arange(n)
    q = found.cofactors.reshape(n, 3, n, 3)[at, :, at, :]
    variance = VarianceFactor(found.vtpv, found.redundancy, found.by_known)
    used = variance.used
    if used is None:
        return view.of_covariances(q), None
    return view.of_covariances(q) * used**2, variance


def _ellipses(
    plot: Plot, view: PointView, vectors: Array, covariance: Array, chosen: Index, times: float
) -> None:
    size = np.sqrt(np.einsum("nii->n", covariance[chosen])) * plot.frame.scale[0] * times
    small = chosen[(size > 0.0) & (size <= _LARGEST_ELLIPSE)]
    tips = view.at[small] + vectors[small] * times
    plot.ellipses(tips, covariance[small], times, "line thin l-soft")
    if len(small) < int(np.count_nonzero(size > 0.0)):
        plot.note("Ellipses larger than the drawing can hold are left out.")
