"""The map of a model as a drawing: points, residual vectors and critical transfers.

x of the left photo grows to the right, y upwards, both at the same scale whatever the size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TypeVar

import numpy as np
from rich.cells import cell_len

from anaplot.adjustment.tested import Transfer
from anaplot.aliases import Array
from anaplot.console.braille import Canvas
from anaplot.console.inwork import InWork, in_work
from anaplot.orientation.results import Row
from anaplot.session.transfer import Mark
from anaplot.station.snapshot import PointView, Snapshot
from anaplot.textfiles.wording import plain

__all__ = ["Layer", "MapProjection", "draw_map", "drawn_from", "nice_above", "write_name"]

_Number = TypeVar("_Number", float, Array)

_SMALLEST_EXTENT = 20.0  # mm: a single point is not blown up to the whole map
_BAR_DOTS = 10
_NICE = (1.0, 1.5, 2.0, 3.0, 5.0, 7.5, 10.0)
_MARKERS = {"pending": "○", "measured": "●", "flagged": "!", "off": "x"}
_KNOWN = {
    "lateral": {"pending": "◇", "measured": "◆"},
    "control": {"pending": "△", "measured": "▲"},
    "": {},
}
"""Markers of points known from another strip or on the ground, where others have another one."""


class Layer(IntEnum):
    """What a cell of the map shows; of several things the later one gives the colour."""

    PAPER = 0
    LEGEND = 1
    NAME = 2
    RESIDUAL = 3
    TRANSFER = 4
    FLAGGED_RESIDUAL = 5
    OFF = 6
    PENDING = 7
    MEASURED = 8
    NEXT = 9
    TARGET = 10
    FLAGGED = 11
    SELECTED = 12
    CULPRIT = 13


def nice_above(value: float) -> float:
    """Return the smallest of 1, 1.5, 2, 3, 5, 7.5 times a power of ten not below `value`."""
    power = 10.0 ** math.floor(math.log10(value))
    steps = (power * step for step in _NICE)
    return next(step for step in steps if step >= value * (1.0 - 1e-9))


@dataclass(frozen=True, slots=True)
class MapProjection:
    """Image coordinates [mm] to dots, the same scale along x and y.

    Attributes
    ----------
    scale
        Dots per mm.
    x, y
        Image coordinates [mm] at the middle of the raster.
    width, height
        Of the raster [dots].
    """

    scale: float
    x: float
    y: float
    width: int
    height: int

    def dots(self, x: _Number, y: _Number) -> tuple[_Number, _Number]:
        """Return the position [dots] of image coordinates [mm]."""
        return (
            (self.width - 1) / 2.0 + self.scale * (x - self.x),
            (self.height - 1) / 2.0 - self.scale * (y - self.y),
        )

    @classmethod
    def around(
        cls,
        points: list[tuple[float, float]],
        width: int,
        height: int,
        margin: tuple[int, int],
        *,
        step: float = 5.0,
        smallest: float = _SMALLEST_EXTENT,
    ) -> MapProjection:
        """Return the largest projection that shows all points with a margin [dots] around them.

        The frame is rounded outward to `step`, so that it stands still while points shift a
        little, and is `smallest` wide at least.
        """
        xs = [x for x, _ in points] or [0.0]
        ys = [y for _, y in points] or [0.0]
        left, right = step * math.floor(min(xs) / step), step * math.ceil(max(xs) / step)
        lower, upper = step * math.floor(min(ys) / step), step * math.ceil(max(ys) / step)
        room_x = max(width - 1 - 2 * margin[0], 1)
        room_y = max(height - 1 - 2 * margin[1], 1)
        scale = min(
            room_x / max(right - left, smallest),
            room_y / max(upper - lower, smallest),
        )
        return cls(scale, (left + right) / 2.0, (lower + upper) / 2.0, width, height)


def _legend(
    canvas: Canvas, um_per_dot: float | None, transfers: bool, target: bool, marks: set[Mark]
) -> int:
    """Write what the signs mean at the bottom; returns the number of rows it takes."""
    if canvas.rows < 6:
        return 0
    signs = ["○ open", "● done", "! flag", "x off"]
    signs += [
        f"{_KNOWN[mark]['measured']} {mark}" for mark in ("lateral", "control") if mark in marks
    ]
    if target:
        signs.append("(●) plates here")
    if transfers:
        signs.append("━▶ shows as large there")
    line, column = canvas.rows - 1, 0
    for sign in signs:
        cells = cell_len(sign)
        if column + cells > canvas.columns:
            break
        canvas.write(column, line, sign, Layer.LEGEND)
        column += cells + (2 if canvas.columns >= 50 else 1)
    if um_per_dot is None:
        return 1
    bar = "⠒" * (_BAR_DOTS // 2)
    canvas.write(0, line - 1, bar, Layer.RESIDUAL)
    label = f"{_BAR_DOTS * um_per_dot:g} µm residual"
    canvas.write(len(bar) + 1, line - 1, label, Layer.LEGEND)
    return 2


def _longest(raster: Canvas) -> int:
    """Return how long a residual vector may be [dots]; the margins have room for it."""
    return max((min(raster.width, raster.height) - 16) // 8, 5)


def _um_per_dot(work: InWork, raster: Canvas) -> float | None:
    """Return the scale of the residual vectors [um per dot], a round number.

    The largest is as long as `_longest` at most. Residuals below three times the a-priori sigma0
    do not enlarge it, so that good models look calm.
    """
    if not work.solved:
        return None
    sizes = [abs(row.residual) for row in work.table if math.isfinite(row.residual)]
    largest = max([3.0 * work.apriori_um, *sizes])
    return nice_above(largest / _longest(raster)) if 0.0 < largest < math.inf else None


def _name_places(
    column: int, row: int, cells: int, ringed: bool
) -> tuple[tuple[int, int, int, int], ...]:
    """Return where a name may stand: column, row, and blanks it needs to its left and right."""
    gap = 2 if ringed else 1
    middle = column - (cells - 1) // 2
    return (
        (column + gap, row, 0, 1),
        (column - gap - cells + 1, row, 1, 0),
        (middle, row + 1, 1, 1),
        (middle, row - 1, 1, 1),
        (column + 1, row - 1, 1, 1),
        (column + 1, row + 1, 1, 1),
        (column - cells, row + 1, 1, 1),
        (column - cells, row - 1, 1, 1),
    )


def _mark(canvas: Canvas, column: int, row: int, view: PointView, snapshot: Snapshot) -> None:
    layers = {
        "pending": Layer.PENDING,
        "measured": Layer.MEASURED,
        "flagged": Layer.FLAGGED,
        "off": Layer.OFF,
    }
    layer = layers[view.status]
    if view.status == "flagged" and view.point in (
        key[0] for key in in_work(snapshot).suspects[:1]
    ):
        layer = Layer.CULPRIT
    if view.point == snapshot.next_point and view.status == "pending":
        layer = Layer.NEXT
    sign = _KNOWN[view.mark].get(view.status, _MARKERS[view.status])
    canvas.write(column, row, sign, layer)


def drawn_from(
    snapshot: Snapshot, selected: tuple[str, str] | None, *, all_transfers: bool
) -> tuple[object, ...]:
    """Return everything on which `draw_map` depends, but for the size."""
    work = in_work(snapshot)
    of_model = work.points, work.table, work.solved, work.apriori_um, work.suspects
    where = snapshot.target, snapshot.next_point, selected, all_transfers
    return *where, snapshot.diagnosis, *of_model


def draw_map(
    snapshot: Snapshot,
    selected: tuple[str, str] | None,
    columns: int,
    rows: int,
    *,
    all_transfers: bool = False,
) -> Canvas:
    """Draw the map of the current model, or of the fiducials during an inner orientation.

    Parameters
    ----------
    snapshot
        What to draw; it may be without a solution.
    selected
        The row whose critical transfers are drawn, and whose point is set off.
    columns, rows
        Size in terminal cells.
    all_transfers
        Draw the critical transfers of every row instead.

    Returns
    -------
    Canvas
        With the layers of `Layer`.
    """
    canvas = Canvas(columns, rows)
    work = in_work(snapshot)
    views = [v for v in work.points if math.isfinite(v.x) and math.isfinite(v.y)]
    transfers = _transfers(snapshot, selected, all_transfers)
    um_per_dot = _um_per_dot(work, canvas)
    target = any(v.point == snapshot.target for v in views)
    marks = {v.mark for v in views}
    legend = _legend(canvas, um_per_dot, bool(transfers), target, marks)
    projection = MapProjection.around(
        [(v.x, v.y) for v in views],
        canvas.width,
        canvas.height - 4 * legend,
        (max(_longest(canvas), 6), _longest(canvas) + 1),
    )
    places = {v.point: projection.dots(v.x, v.y) for v in views}
    _draw_residuals(canvas, work, places, um_per_dot)
    critical = {(t.source[0], t.target[0]) for t in transfers if t.critical}
    for source, sink in dict.fromkeys((t.source[0], t.target[0]) for t in transfers):
        if source in places and sink in places and source != sink:
            dotted = (source, sink) not in critical
            canvas.arrow(*places[source], *places[sink], Layer.TRANSFER, dotted=dotted)

    point = selected[0] if selected else None
    urgent = {snapshot.target, snapshot.next_point, point}
    ordered = sorted(
        views,
        key=lambda v: (v.point != snapshot.target, v.status != "flagged", v.point not in urgent),
    )
    cells = _cells(ordered, places, snapshot.target, canvas.columns, canvas.rows - legend)
    # The urgent ones are drawn last so that no neighbour hides them, and named first.
    for view in reversed(ordered):
        _mark(canvas, *cells[view.point], view, snapshot)
    if snapshot.target in cells:
        column, row = cells[snapshot.target]
        canvas.write(column - 1, row, "(", Layer.TARGET)
        canvas.write(column + 1, row, ")", Layer.TARGET)
    for view in ordered:
        name = plain(view.point)[:12]
        pressing = view.status == "flagged" or view.point in urgent
        layer = Layer.FLAGGED if view.status == "flagged" else Layer.NAME
        if view.point == snapshot.next_point:
            layer = Layer.NEXT
        if view.point == point:
            layer = Layer.SELECTED
        write_name(
            canvas,
            cells[view.point],
            name,
            layer,
            canvas.rows - legend,
            pressing=pressing,
            ringed=view.point == snapshot.target,
        )
    return canvas


def _cells(
    views: list[PointView],
    places: dict[str, tuple[float, float]],
    target: str | None,
    columns: int,
    rows: int,
) -> dict[str, tuple[int, int]]:
    """Return the cell of every point's sign.

    Twin points a few millimetres apart often share a cell; the second moves to the nearest free
    one beside it, so that both are seen.
    """
    cells: dict[str, tuple[int, int]] = {}
    taken: set[tuple[int, int]] = set()
    for view in views:
        x, y = places[view.point]
        own = (round(x) // 2, min(round(y) // 4, rows - 1))
        near = sorted(
            ((own[0] + i, own[1] + j) for i in (-1, 0, 1) for j in (-1, 0, 1)),
            key=lambda cell: math.hypot(2 * cell[0] + 0.5 - x, 4 * cell[1] + 1.5 - y),
        )
        free = (c for c in near if c not in taken and 0 <= c[0] < columns and 0 <= c[1] < rows)
        cell = own if own not in taken else next(free, own)
        taken.add(cell)
        if view.point == target:  # the ring needs the cells at either side
            taken |= {(cell[0] - 1, cell[1]), (cell[0] + 1, cell[1])}
        cells[view.point] = cell
    return cells


def write_name(
    canvas: Canvas,
    cell: tuple[int, int],
    name: str,
    layer: int,
    bottom: int,
    *,
    pressing: bool,
    ringed: bool = False,
) -> None:
    """Write a point's name where there is room.

    Parameters
    ----------
    canvas
        The map.
    cell
        Column and row of the point's sign.
    name, layer
        What is written, and as what.
    bottom
        The row below the last one that may carry it.
    pressing
        Whether it may cover lines.
    ringed
        Whether the cells at either side of the sign are taken.
    """
    cells = cell_len(name)
    for over_dots in (False, True) if pressing else (False,):
        for column, row, left, right in _name_places(*cell, cells, ringed):
            # At the map's edge no blank is needed.
            first = max(column - left, min(column, 0))
            last = min(column + cells + right, max(column + cells, canvas.columns))
            if row < bottom and canvas.has_room(first, row, last - first, over_dots=over_dots):
                canvas.write(column, row, name, layer)
                return


def _transfers(
    snapshot: Snapshot, selected: tuple[str, str] | None, all_transfers: bool
) -> tuple[Transfer[Row], ...]:
    if snapshot.diagnosis is None:
        return ()
    if all_transfers:
        return snapshot.diagnosis.transfers
    return tuple(t for t in snapshot.diagnosis.transfers if selected in (t.source, t.target))


def _draw_residuals(
    canvas: Canvas,
    work: InWork,
    places: dict[str, tuple[float, float]],
    um_per_dot: float | None,
) -> None:
    if um_per_dot is None:
        return
    calm: list[tuple[float, float, float, float]] = []
    flagged: list[tuple[float, float, float, float]] = []
    for row in work.table:
        place = places.get(row.point)
        if place is None:
            continue
        length = row.residual / um_per_dot
        x, y = place
        end = (x + length, y) if row.axis == "x" else (x, y - length)
        (flagged if row.flagged else calm).append((x, y, *end))
    for ends, layer in ((calm, Layer.RESIDUAL), (flagged, Layer.FLAGGED_RESIDUAL)):
        x0, y0, x1, y1 = np.array(ends, dtype=np.float64).reshape(-1, 4).T
        canvas.lines(x0, y0, x1, y1, layer, heavy=layer == Layer.FLAGGED_RESIDUAL)
