"""The figure of one model (1983, Figures 2, 4 and 7): r at the points, and where errors show."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from anaplot.adjustment.tested import Observation, Transfer
from anaplot.aliases import Array
from anaplot.drawing import pathdata
from anaplot.drawing.classes import Classes, draw_classes
from anaplot.drawing.drawing import Drawing
from anaplot.drawing.element import text
from anaplot.drawing.frame import equal_frame
from anaplot.drawing.labels import placed
from anaplot.drawing.legend import Entry
from anaplot.drawing.plot import Head, Plot
from anaplot.drawing.textwidth import SMALL, TINY, text_width
from anaplot.drawing.thinning import thinned
from anaplot.orientation.results import ModelSolution, Row
from anaplot.orientation.suitability import worst_transfer
from anaplot.report.columns import counted
from anaplot.report.figures.groundview import near_ones
from anaplot.textfiles.wording import plain

__all__ = ["REDUNDANCY_CLASSES", "model_figure"]

REDUNDANCY_CLASSES = Classes(
    (0.1, 0.3, 0.6), ("below 0.1", "0.1 to 0.3", "0.3 to 0.6", "0.6 and more")
)
"""Classes of redundancy numbers, the same on every map."""

_MOST_POINTS, _MOST_NAMED, _MOST_ARROWS, _MOST_VALUES = 3000, 40, 60, 14
_NAME = 14  # characters
_LINE = 12.0
_CLEAR = 9.0  # between an arrow and the mark at its end
_SHORTEST = 12.0  # of an arrow
_ALONG = 0.38  # of an arrow: where its value stands
_ASIDE = 3.5  # from the line between two points, so that one there and one back are two


class _Point(NamedTuple):
    """A point of a model and its rows.

    Attributes
    ----------
    name
        Its name.
    at
        Its place in `_Points.at`.
    rows
        Its tested rows, by axis.
    """

    name: str
    at: int
    rows: dict[str, Observation[Row]]

    @property
    def weakest(self) -> float:
        """The smaller of its redundancy numbers."""
        return min(row.r for row in self.rows.values())

    @property
    def flagged(self) -> bool:
        """Whether one of its rows is."""
        return any(row.flagged for row in self.rows.values())

    @property
    def numbers(self) -> str:
        """Its redundancy numbers, as they are read."""
        return "  ".join(
            f"{axis} {row.r:.2f}" for axis, row in sorted(self.rows.items(), reverse=True)
        )


def _points(model: ModelSolution) -> tuple[list[_Point], Array]:
    rows: dict[str, dict[str, Observation[Row]]] = defaultdict(dict)
    for row in model.table:
        rows[row.point][row.axis] = row
    found = [point for point in model.points if point.point in rows]
    at = np.array([(point.X, point.Y) for point in found]).reshape(-1, 2)
    good = np.isfinite(at).all(axis=1)
    good[good] = near_ones(at[good])
    kept = np.flatnonzero(good)
    points = [_Point(found[k].point, i, rows[found[k].point]) for i, k in enumerate(kept.tolist())]
    return points, at[kept]


def model_figure(
    model: ModelSolution,
    transfers: Iterable[Transfer[Row]] = (),
    *,
    key: str = "model",
    unit: str = "µm",
) -> Drawing | None:
    """Return the figure of a model; None where none of its points has a place.

    Points in the model's system with the redundancy numbers of their rows, y and x, flagged ones
    ringed; arrows from a row to the one in which its error shows as large (critical, in full) or
    nearly so (serious, dotted), as `Diagnosis.transfers` has them, with what a unit error shows
    there.

    Parameters
    ----------
    model
        The model.
    transfers
        Of `diagnose`.
    key
        Of the drawing.
    unit
        Of sigma0, as `image_units` has it.
    """
    points, at = _points(model)
    if not points:
        return None
    flagged = [point for point in points if point.flagged]
    every = list(transfers)
    weakest = min(points, key=lambda point: point.weakest)
    sigma0 = "no redundancy" if model.sigma0_um is None else f"sigma0 {model.sigma0_um:.2f} {unit}"
    critical = sum(one.critical for one in every)
    numbers = (
        f"{counted(len(points), 'point')}, {sigma0}, redundancy {model.redundancy}; smallest r "
        f"{weakest.weakest:.2f} at point {weakest.name}; {counted(critical, 'critical transfer')}"
    )
    head = Head(key, f"Model {model.name}", f"{numbers}.")
    centres = np.array([model.centre[:2], np.add(model.centre[:2], model.base[:2])])
    plot = Plot(head, equal_frame(head.bottom, np.vstack((at, centres)), margin=0.13))
    plot.axes("X [mm]", "Y [mm]", grid=False)
    plot.line(centres, "dashed l-soft")
    plot.marks("plus", centres, "line l-series-1", 5.0)
    notes = _draw_points(plot, points, at)
    left_out = _draw_transfers(plot, points, at, every)
    ringed = at[[point.at for point in flagged]]
    plot.marks("circle", ringed, "line bold l-bad", 8.0)
    if flagged:
        plot.explain(Entry("mark", f"flagged ({len(flagged)})", "line bold l-bad", "circle", 6.5))
    plot.explain(Entry("mark", "projection centre", "line l-series-1", "plus", 5.0))
    _name_points(plot, points, at, centres)
    plot.note(*notes, *left_out)
    said = f"Model {model.name}: {numbers}."
    if flagged:
        names = ", ".join(point.name for point in flagged[:10])
        said += f" Flagged: {names}{' and more' if len(flagged) > 10 else ''}."
    worst = worst_transfer(every)
    if worst is not None:
        said += (
            f" An error in {_row(worst.source)} shows {worst.share:.2f} times as large in "
            f"{_row(worst.target)} as in itself."
        )
    return plot.drawing(said)


def _row(row: Row) -> str:
    return f"{plain(row[0], 60)} {row[1]}"


def _draw_points(plot: Plot, points: list[_Point], at: Array) -> tuple[str, ...]:
    r = np.array([point.weakest for point in points])
    order = np.argsort(r, kind="stable")
    first = np.array([points[k].flagged for k in order.tolist()], dtype=bool)
    chosen = order[thinned(at[order], _MOST_POINTS, first)]
    draw_classes(plot, at[chosen], r[chosen], REDUNDANCY_CLASSES, what="r", turned=True)
    if len(chosen) == len(points):
        return ()
    return (f"{len(chosen)} of {len(points)} points are drawn, the weakest of each part.",)


def _draw_transfers(
    plot: Plot, points: list[_Point], at: Array, transfers: list[Transfer[Row]]
) -> tuple[str, ...]:
    """Draw arrows from point to point, the largest share of each pair of points."""
    where = {point.name: point.at for point in points}
    largest: dict[tuple[str, str], Transfer[Row]] = {}
    for one in transfers:
        ends = one.source[0], one.target[0]
        if ends[0] == ends[1] or ends[0] not in where or ends[1] not in where:
            continue
        had = largest.get(ends)
        if had is None or one.share > had.share:
            largest[ends] = one
    order = sorted(largest.values(), key=lambda one: -one.share)
    drawn: list[tuple[Transfer[Row], Array, Array]] = []
    close = 0
    for one in order[:_MOST_ARROWS]:
        begin, end = plot.frame.places(at[[where[one.source[0]], where[one.target[0]]]])
        along = end - begin
        length = float(np.hypot(*along))
        if length < 2.0 * _CLEAR + _SHORTEST:
            close += 1
            continue
        along = along / length
        aside = _ASIDE * np.array([-along[1], along[0]])
        drawn.append((one, begin + _CLEAR * along + aside, end - _CLEAR * along + aside))
    for critical, classes, label in (
        (True, "line bold l-series-2", "an error shows as large, or larger, there"),
        (False, "line dotted l-series-2", "nearly as large"),
    ):
        of = np.array([(a, b) for one, a, b in drawn if one.critical is critical])
        if len(of):
            plot.path(pathdata.arrows(of[:, 0], of[:, 1]), classes)
            plot.explain(Entry("arrow", label, classes, length=26.0))
    _values(plot, drawn)
    notes = []
    if sum(one.source[0] != one.target[0] for one in transfers) > len(largest):
        notes.append("Of several transfers from a point to another the largest is drawn.")
    if close:
        notes.append(f"{counted(close, 'transfer')} between close neighbours not drawn.")
    if len(order) > _MOST_ARROWS:
        notes.append(f"The {_MOST_ARROWS} largest of {len(order)} transfers are drawn.")
    return tuple(notes)


def _values(plot: Plot, drawn: list[tuple[Transfer[Row], Array, Array]]) -> None:
    """Write what unit errors show beside their arrows, critical ones first, where there is room.

    Not in their middle, where diagonals cross.
    """
    boxes: list[tuple[float, float, float, float]] = []
    for one, a, b in sorted(drawn, key=lambda each: not each[0].critical):
        along = (b - a) / np.hypot(*(b - a))
        shown = f"{one.source[1]}→{one.target[1]} {one.value:+.2f}".replace("-", "−")
        half = text_width(shown, TINY) / 2.0
        # to the same side as the arrow stands aside
        away = np.array([-along[1], along[0]]) * (6.0 + abs(along[1]) * half + abs(along[0]) * 3.0)
        x, y = (a + _ALONG * (b - a) + away).tolist()
        box = (x - half, y - 5.0, x + half, y + 5.0)
        if any(
            box[0] < other[2] and other[0] < box[2] and box[1] < other[3] and other[1] < box[3]
            for other in boxes
        ):
            continue
        boxes.append(box)
        plot.add(text(x, y + 3.0, shown, "t-tiny t-mid t-halo t-soft"))
        if len(boxes) == _MOST_VALUES:
            return


def _name_points(plot: Plot, points: list[_Point], at: Array, centres: Array) -> None:
    """Write names and numbers where there is room, of what is flagged and weak first."""
    order = sorted(points, key=lambda point: (not point.flagged, point.weakest))[:_MOST_NAMED]
    names = [plain(point.name) for point in order]
    short = [name if len(name) <= _NAME else f"{name[:_NAME]}…" for name in names]
    wide = [
        max(text_width(name, SMALL), text_width(point.numbers, TINY))
        for name, point in zip(short, order, strict=True)
    ]
    sizes = np.array([(width, 2.0 * _LINE) for width in wide])
    places = plot.frame.places(at[[point.at for point in order]])
    others = plot.frame.places(np.vstack((at[:2000], centres)))
    towards = places - others.mean(axis=0)  # away from the middle, where arrows are
    found = placed(plot.frame, places, sizes, obstacles=others, most=_MOST_NAMED, towards=towards)
    for label in found:
        point = order[label.which]
        left_of_it = label.x + wide[label.which] / 2.0 < places[label.which, 0] - 4.0
        x = label.x + (wide[label.which] if left_of_it else 0.0)
        side = " t-end" if left_of_it else ""
        classes = "t-small t-strong t-halo" + side + (" t-bad" if point.flagged else "")
        plot.add(text(x, label.y + 9.0, point.name, classes, most=_NAME))
        lower = label.y + 9.0 + _LINE
        plot.add(text(x, lower, point.numbers, f"t-tiny t-soft t-halo{side}"))
