"""Maps of numbers at the points of a block: accuracy, redundancy, what would stay undetected."""

from __future__ import annotations

import numpy as np

from anaplot.aliases import Array
from anaplot.bundle.blockmap import mean_redundancy
from anaplot.bundle.solve.adjusted import AdjustedBlock
from anaplot.drawing.classes import classes_of, draw_classes
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.ticks import written
from anaplot.report.columns import counted
from anaplot.report.figures.blockmap import draw_control
from anaplot.report.figures.crowding import sampled
from anaplot.report.figures.groundview import ground_view
from anaplot.report.figures.imageunits import image_units
from anaplot.report.figures.pointvalues import (
    largest_detectable,
    largest_effect,
    point_deviations,
)

__all__ = ["accuracy_maps", "detectable_map", "effect_map", "redundancy_map"]

_MOST, _MOST_WEAK = 4000, 30
_NAMED = 8


def accuracy_maps(block: AdjustedBlock) -> tuple[Drawing, ...]:
    """Return the maps of the standard deviations of points: in plan (of X and Y together), in Z.

    Empty where sigma0 does not exist.
    """
    s = point_deviations(block)
    if s is None:
        return ()
    plan = np.hypot(s[:, 0], s[:, 1])
    maps = (
        _map(block, plan, "accuracy-plan", "Standard deviation in plan", "sqrt(sX² + sY²)", "m"),
        _map(block, s[:, 2], "accuracy-height", "Standard deviation in height", "sZ", "m"),
    )
    return tuple(one for one in maps if one is not None)


def redundancy_map(block: AdjustedBlock) -> Drawing | None:
    """Return the map of the points' mean redundancy numbers; None without an image coordinate."""
    title, what = "Redundancy numbers", "mean r of a point's image coordinates"
    return _map(block, mean_redundancy(block), "redundancy", title, what, "", low_is_weak=True)


def detectable_map(block: AdjustedBlock) -> Drawing | None:
    """Return the map of the largest of each point's smallest detectable errors [um]."""
    return _map(
        block,
        largest_detectable(block),
        "detectable",
        "Smallest detectable errors",
        "the largest of a point's image coordinates",
        image_units(block.problem.block).small,
    )


def effect_map(block: AdjustedBlock) -> Drawing | None:
    """Return the map of how far an undetected error in one of its rays moves a point [m]."""
    return _map(
        block,
        largest_effect(block),
        "effect",
        "What stays undetected on the ground",
        "how far the largest error that is not detected moves its point",
        "m",
    )


def _map(
    block: AdjustedBlock,
    values: Array,
    key: str,
    title: str,
    what: str,
    unit: str,
    *,
    low_is_weak: bool = False,
) -> Drawing | None:
    view = ground_view(block)
    names = block.problem.points
    unit, values = _readable(values, unit)
    drawn = np.flatnonzero(view.near & np.isfinite(values))
    never = np.flatnonzero(view.near & np.isposinf(values))
    if not len(drawn):
        return None
    weak = -values if low_is_weak else values
    drawn = drawn[np.argsort(-weak[drawn], kind="stable")]  # the weakest first
    shown = values[drawn]
    behind = f" {unit}" if unit else ""
    worst = drawn[0]
    numbers = (
        f"{counted(len(drawn), 'point')}, median {_short(float(np.median(shown)))}{behind}, "
        f"{'smallest' if low_is_weak else 'largest'} {_short(float(values[worst]))}{behind} at "
        f"point {names[worst]}"
    )
    head = Head(key, title, f"{what}: {numbers}.")
    plot = Plot(head, view.frame(head))
    plot.axes(*view.titles)
    chosen, size = sampled(plot, view.at, drawn, drawn[:_MOST_WEAK], _MOST)
    draw_classes(
        plot,
        view.at[chosen],
        values[chosen],
        classes_of(shown, unit),
        turned=low_is_weak,
        size=size,
        every=shown,
    )
    if len(never):
        places = view.at[never[:_MOST]]
        plot.marks("cross", places, "line bold l-bad", 4.0)
        plot.explain(Entry("mark", f"no bound ({len(never)})", "line bold l-bad", "cross", 4.0))
    if len(chosen) < len(drawn):
        plot.note(
            f"{len(chosen)} of {len(drawn)} points are drawn: the weakest {_MOST_WEAK}, and one in "
            "each part of the map; the legend counts all."
        )
    draw_control(plot, view, hollow=True, size=max(size, 0.7))
    named = drawn[:_NAMED]
    plot.names(view.at[named], [names[k] for k in named.tolist()], obstacles=view.at[chosen[:3000]])
    plot.note(*view.far_note)
    unbounded = f" Of {counted(len(never), 'point')} there is no bound." if len(never) else ""
    return plot.drawing(f"{title}, {what}: {numbers}.{unbounded}")


def _readable(values: Array, unit: str) -> tuple[str, Array]:
    """Return metres as millimetres where they are small."""
    finite = values[np.isfinite(values)]
    if unit == "m" and len(finite) and float(np.median(finite)) < 0.1:
        return "mm", values * 1e3
    return unit, values


def _short(value: float) -> str:
    size = f"{value:.3g}"
    return size if "e" not in size else written(float(size), 0)
