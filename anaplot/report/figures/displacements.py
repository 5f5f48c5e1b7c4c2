"""Displacements between two epochs: vectors with the ellipses within which they are none."""

from __future__ import annotations

from math import sqrt

import numpy as np

from anaplot.adjustment.hypothesis import critical_f
from anaplot.aliases import Array, Bools
from anaplot.bundle.epochs.displacementtests import EpochTests
from anaplot.bundle.hypotheses.verdict import VarianceFactor
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.frame import equal_frame
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.thinning import thinned
from anaplot.drawing.ticks import round_down, written
from anaplot.report.columns import counted
from anaplot.report.movementdecimals import movement_decimals

__all__ = ["displacement_maps"]

_MOST, _NAMED = 600, 30
_UPRIGHT = 0.35  # of the longer of X and Y: height from which an object stands upright
_LONG, _SHORT = 60.0, 24.0  # units of the drawing: the largest vector, a median ellipse's half axis


def displacement_maps(found: EpochTests) -> tuple[Drawing, ...]:
    """Return the displacements between two epochs along the object, and across it.

    The first drawing has X and Y, of an upright object Z and the longer of both; the second the
    displacements along the third axis. Points that the test calls moved are marked; ellipses and
    bars hold a displacement of nothing with the probability 1 - alpha, each point by itself.
    """
    of = found.differences
    if not len(of.points):
        return ()
    moved = np.array([p.verdict is not None and bool(p.verdict.rejected) for p in found.points])
    across = _across(of.places)
    along = [axis for axis in range(3) if axis != across]
    one = _map(found, moved, along, along, "displacements")
    other = _map(found, moved, along, [across], "displacements-across")
    return tuple(drawing for drawing in (one, other) if drawing is not None)


def _across(places: Array) -> int:
    """Return the axis that a drawing has no room for: Z, of an upright object X or Y."""
    x, y, z = np.ptp(places, axis=0).tolist()
    if z > min(x, y) and z > _UPRIGHT * max(x, y):
        return 0 if x < y else 1
    return 2


def _map(
    found: EpochTests, moved: Bools, along: list[int], axes: list[int], key: str
) -> Drawing | None:
    of = found.differences
    n = len(of.points)
    free = ~of.given[:, axes].any(axis=1)
    if not free.any():
        return None
    at = of.places[:, along]
    vectors, covariance = _vectors(found, axes), _regions(found, axes)
    length = np.linalg.norm(of.d.reshape(n, 3)[:, axes], axis=1)
    first, second = of.numbers
    letters = " and ".join("XYZ"[axis] for axis in axes)
    title = f"Displacements in {letters} from epoch {first} to {second}"
    largest = int(np.argmax(np.where(free, length, -1.0)))
    numbers = (
        f"{counted(int(free.sum()), 'point')}, {int(moved[free].sum())} moved, largest "
        f"{1e3 * length[largest]:.{movement_decimals(of) - 1}f} mm at point {of.points[largest]}"
    )
    head = Head(f"{key}-{first}-{second}", title, f"{numbers}.")
    plot = Plot(head, equal_frame(head.bottom, at, margin=0.12))
    plot.axes(*(f"{'XYZ'[axis]} [m]" for axis in along))
    order = np.flatnonzero(free)[np.argsort(-length[free], kind="stable")]
    chosen = order[thinned(at[order], _MOST, moved[order])]
    if len(chosen) < len(order):
        plot.note(f"{len(chosen)} of {len(order)} points are drawn, the moved ones among them.")
    times = _exaggeration(plot, length[chosen], covariance[chosen])
    for which, classes in ((~moved, "l-series-1"), (moved, "bold l-bad")):
        some = chosen[which[chosen]]
        plot.ellipses(at[some], covariance[some], times, "line thin l-soft")
        plot.arrows(at[some], vectors[some], times, classes)
        label = "moved" if classes.endswith("bad") else "not moved"
        if len(some):
            text = f"{label} ({len(some)})"
            plot.explain(Entry("arrow", text, f"line {classes}", length=24.0))
    plot.dots(at[chosen], "l-ink", 2.5)
    plot.note(f"Vectors and ellipses are enlarged {written(times, 0)} times.")
    _explain(plot, found, times, ellipses=bool(np.isfinite(covariance[chosen]).all()))
    named = np.concatenate((order[moved[order]], order[~moved[order]]))[:_NAMED]
    few = chosen[:1000]
    ends = np.vstack([at[few] + part * times * vectors[few] for part in (0.0, 0.4, 0.7, 1.0)])
    plot.names(at[named], [of.points[k] for k in named.tolist()], obstacles=ends)
    names = [of.points[k] for k in order[moved[order]][:10].tolist()]
    said = f"Moved: {', '.join(names)}." if names else "No point by itself has moved."
    return plot.drawing(f"{title}: {numbers}. {said}")


def _vectors(found: EpochTests, axes: list[int]) -> Array:
    """Return (n, 2) displacements [m]; one along a single axis stands upright."""
    d = found.differences.d.reshape(-1, 3)[:, axes]
    return d if len(axes) == 2 else np.column_stack([np.zeros(len(d)), d[:, 0]])


def _regions(found: EpochTests, axes: list[int]) -> Array:
    """Return (n, 2, 2) matrices whose ellipses hold no displacement at 1 - alpha; NaN without."""
    of = found.differences
    n, count = len(of.points), len(axes)
    blocks = of.cofactors.reshape(n, 3, n, 3)[np.arange(n), :, np.arange(n), :]
    q = blocks[:, axes][:, :, axes]
    variance = VarianceFactor(of.vtpv, of.redundancy, of.by_known)
    sigma = variance.used
    if sigma is None:
        return np.full((n, 2, 2), np.nan)
    q = q * (sigma**2 * count * critical_f(found.alpha, count, variance.degrees))
    if count == 2:
        return np.asarray(q)
    bars = np.zeros((n, 2, 2))
    bars[:, 1, 1] = q[:, 0, 0]
    return bars


def _exaggeration(plot: Plot, length: Array, covariance: Array) -> float:
    """Return by how much vectors and ellipses are enlarged."""
    scale = plot.frame.scale[0]
    half = np.sqrt(np.maximum(np.einsum("nii->n", covariance), 0.0))
    half = half[np.isfinite(half)]
    longest = float(np.max(length, initial=0.0))
    typical = float(np.median(half)) if len(half) else 0.0
    limits = [_LONG / longest if longest > 0.0 else np.inf, _SHORT / typical if typical else np.inf]
    times = min(limits)
    return round_down(times / scale) if np.isfinite(times) else 1.0


def _explain(plot: Plot, found: EpochTests, times: float, *, ellipses: bool) -> None:
    scale = plot.frame.scale[0] * times
    size = round_down(sqrt(_LONG * _SHORT) / scale)
    plot.explain(Entry("arrow", f"{1e3 * size:g} mm", "line l-series-1", length=size * scale))
    if ellipses:
        label = f"holds no displacement at {100.0 * (1.0 - found.alpha):g} %"
        plot.explain(Entry("ellipse", label, "line thin l-soft", length=24.0))
