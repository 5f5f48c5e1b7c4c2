"""The map of the adjusted block as a drawing: photos, strips, points by redundancy, ellipses.

X of the ground system grows to the right, Y upwards, both at the same scale whatever the size.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from rich.cells import cell_len

from anaplot.aliases import Array, Bools, Index
from anaplot.console.braille import Canvas
from anaplot.console.mapdrawing import MapProjection, nice_above, write_name
from anaplot.textfiles.wording import plain

if TYPE_CHECKING:
    from anaplot.bundle.blockmap import BlockMap

__all__ = ["BlockLayer", "draw_block_map"]

_GRADES = ((0.6, "●"), (0.3, "◐"), (0.1, "○"))  # redundancy numbers, as in the report
_UNCHECKED = "?"
_BAR_DOTS = 10
_STEPS = 24  # of an ellipse
_PATCH = (8, 3)  # cells: where points are many, one ellipse stands in each
_FAR = 5.0  # times as far from the middle as nine points of ten: not shown
_BOTH_SCALES = 66  # cells for a line that says what ellipses and what distances are
_SHORTEST = 1.5  # dots: a smaller ellipse is hidden by the point's sign


class BlockLayer(IntEnum):
    """What a cell of the block's map shows; of several things the later one is seen."""

    PAPER = 0
    LEGEND = 1
    STRIP = 2
    ELLIPSE = 3
    PHOTO = 4
    NAME = 5
    WELL = 6
    FAIR = 7
    WEAK = 8
    UNCHECKED = 9
    KNOWN = 10
    FLAGGED = 11
    SELECTED = 12


_TIES = (BlockLayer.WELL, BlockLayer.FAIR, BlockLayer.WEAK, BlockLayer.UNCHECKED)
_SIGNS = (*(sign for _, sign in _GRADES), _UNCHECKED)
_KNOWN = {"control": "▲", "check": "□"}


@dataclass(frozen=True, slots=True)
class _Sight:
    """What of the block is on the paper, and where."""

    projection: MapProjection
    near: Bools
    places: Array
    centres: Array


def draw_block_map(
    block: BlockMap, columns: int, rows: int, *, selected: str | None = None
) -> Canvas:
    """Draw the map of an adjusted block.

    Of several points in a cell the worst is seen: a flagged one before control, control before
    one that is hardly checked. Where points are many, names stand at those that are flagged and
    at control, and of every patch of the map only the largest ellipse is drawn.

    Parameters
    ----------
    block
        The map's content.
    columns, rows
        Size in terminal cells.
    selected
        A point that is set off.

    Returns
    -------
    Canvas
        With the layers of `BlockLayer`.
    """
    canvas = Canvas(columns, rows)
    near = _near(block.places)
    there = np.flatnonzero(near & np.isfinite(block.ellipses).all(axis=1))
    patches = len(there) * _PATCH[0] * _PATCH[1] > canvas.columns * canvas.rows
    signs = _packed(_legend(block, near, patches=patches), canvas.columns)
    scales = 1 if canvas.columns >= _BOTH_SCALES else 2
    legend = len(signs) + scales
    bottom = canvas.rows - legend if canvas.rows >= 3 * legend else canvas.rows
    seen = _sight(block, near, canvas, bottom)
    shown = _largest(there, block, seen.places) if patches else there
    enlarged = _metres_per_dot(block.ellipses[shown, 0], canvas, patches=patches)
    _draw_strips(canvas, block, seen.centres)
    if enlarged is not None:
        _draw_ellipses(canvas, seen.places[shown], block.ellipses[shown], enlarged)
    if bottom < canvas.rows:
        stated = _packed(_scales(seen.projection.scale, enlarged), canvas.columns)
        for row, line in enumerate(stated[:scales] + signs, canvas.rows - len(signs) - scales):
            canvas.write(0, row, line, BlockLayer.LEGEND)
    _write_photos(canvas, seen.centres, bottom)
    layers = _layers(block, selected)
    order = np.argsort([int(layer) for layer in layers], kind="stable")
    at = _one_a_cell(order[seen.near[order]], seen.places)
    for k in at:
        column, row = _cell(seen.places[k])
        if row < bottom:
            canvas.write(column, row, _sign(block, k), layers[k])
    few = 40 * len(block.points) <= canvas.columns * canvas.rows
    for k in reversed(at):
        if few or layers[k] >= BlockLayer.KNOWN:
            layer = layers[k] if layers[k] >= BlockLayer.FLAGGED else BlockLayer.NAME
            name = plain(block.points[k])[:12]
            write_name(canvas, _cell(seen.places[k]), name, layer, bottom, pressing=few)
    if few or len(block.photos) <= canvas.rows:
        for name, place in zip(block.photos, seen.centres, strict=True):
            if np.isfinite(place).all():
                short = plain(name)[-12:]
                write_name(canvas, _cell(place), short, BlockLayer.PHOTO, bottom, pressing=few)
    return canvas


def _one_a_cell(order: Index, places: Array) -> list[int]:
    """Return of an order of points those that are the last ones in their cells."""
    cells = np.rint(places[order]).astype(np.int64) // (2, 4)
    _, last = np.unique(cells[::-1], axis=0, return_index=True)
    kept: list[int] = order[np.sort(len(order) - 1 - last)].tolist()
    return kept


def _grade(r: float) -> int:
    """Return the place of a redundancy number among the grades; without one the last."""
    return next((k for k, (least, _) in enumerate(_GRADES) if r >= least), len(_GRADES))


def _layers(block: BlockMap, selected: str | None) -> list[BlockLayer]:
    layers = []
    for name, kind, r, flagged in zip(
        block.points, block.kinds, block.r.tolist(), block.flagged.tolist(), strict=True
    ):
        if name == selected:
            layer = BlockLayer.SELECTED
        elif flagged:
            layer = BlockLayer.FLAGGED
        elif kind != "tie":
            layer = BlockLayer.KNOWN
        else:
            layer = _TIES[_grade(r)]
        layers.append(layer)
    return layers


def _sign(block: BlockMap, k: int) -> str:
    if block.flagged[k]:
        return "!"
    if block.kinds[k] != "tie":
        return _KNOWN[block.kinds[k]]
    return _SIGNS[_grade(float(block.r[k]))]


def _cell(place: Array) -> tuple[int, int]:
    return round(float(place[0])) // 2, round(float(place[1])) // 4


def _sight(block: BlockMap, near: Bools, canvas: Canvas, bottom: int) -> _Sight:
    """Return the largest projection that shows the block; what lies far off is left out."""
    places, centres = block.places, block.centres
    every = np.concatenate([places[near], centres[_near(centres)]])
    low, high = (every.min(axis=0), every.max(axis=0)) if len(every) else (np.zeros(2),) * 2
    extent = float((high - low).max())
    step = nice_above(extent / 50.0) if 0.0 < extent < math.inf else 1.0
    projection = MapProjection.around(
        [tuple(low.tolist()), tuple(high.tolist())],
        canvas.width,
        4 * bottom,
        (8, 6),
        step=step,
        smallest=step,
    )

    def dots(xy: Array) -> Array:
        return np.stack(projection.dots(xy[:, 0], xy[:, 1]), axis=1)

    there = np.where(_near(centres)[:, None], dots(centres), np.nan)
    return _Sight(projection, near, dots(places), there)


def _near(places: Array) -> Bools:
    """Return which places are not far off from nine tenths of them."""
    finite: Bools = np.asarray(np.isfinite(places).all(axis=1))
    if not finite.any():
        return finite
    middle = np.median(places[finite], axis=0)
    with np.errstate(invalid="ignore", over="ignore"):
        away: Array = np.linalg.norm(places - middle, axis=1)
    return np.asarray(finite & (away <= _FAR * np.quantile(away[finite], 0.9)))


def _largest(there: Index, block: BlockMap, places: Array) -> Index:
    """Return of points those with the largest ellipse of each patch of the map."""
    columns, rows = _PATCH
    there = there[np.argsort(-block.ellipses[there, 0], kind="stable")]
    patch = (places[there] // (2 * columns, 4 * rows)).astype(np.int64)
    _, first = np.unique(patch, axis=0, return_index=True)
    return np.asarray(there[np.sort(first)])


def _metres_per_dot(a: Array, canvas: Canvas, *, patches: bool) -> float | None:
    """Return the scale of the ellipses [m per dot], a round number; None where there are none."""
    largest = float(a.max()) if len(a) else 0.0
    if not 0.0 < largest < math.inf:
        return None
    room = 2 * _PATCH[1] if patches else max(min(canvas.width, canvas.height) // 14, 5)
    return nice_above(largest / room)


def _draw_strips(canvas: Canvas, block: BlockMap, centres: Array) -> None:
    legs = np.array(
        [leg for strip in block.strips for leg in itertools.pairwise(strip)], dtype=int
    ).reshape(-1, 2)
    (x0, y0), (x1, y1) = centres[legs[:, 0]].T, centres[legs[:, 1]].T
    canvas.lines(x0, y0, x1, y1, BlockLayer.STRIP, dotted=True)


def _draw_ellipses(canvas: Canvas, places: Array, ellipses: Array, metres: float) -> None:
    a, b = ellipses[:, 0, None] / metres, ellipses[:, 1, None] / metres
    turned = ellipses[:, 2, None]
    around = np.linspace(0.0, 2.0 * np.pi, _STEPS + 1)[None, :]
    u, v = a * np.cos(around), b * np.sin(around)
    x = places[:, 0, None] + u * np.cos(turned) - v * np.sin(turned)
    y = places[:, 1, None] - u * np.sin(turned) - v * np.cos(turned)
    seen = a[:, 0] >= _SHORTEST
    x, y = x[seen], y[seen]
    canvas.lines(
        x[:, :-1].ravel(), y[:, :-1].ravel(), x[:, 1:].ravel(), y[:, 1:].ravel(), BlockLayer.ELLIPSE
    )


def _write_photos(canvas: Canvas, centres: Array, bottom: int) -> None:
    for place in centres[np.isfinite(centres).all(axis=1)]:
        column, row = _cell(place)
        if row < bottom:
            canvas.write(column, row, "+", BlockLayer.PHOTO)


def _legend(block: BlockMap, near: Bools, *, patches: bool) -> list[str]:
    """Return what the signs mean."""
    signs = [f"{sign} {'≥' if k else 'r≥'}{least:g}" for k, (least, sign) in enumerate(_GRADES)]
    signs += [f"{_UNCHECKED} less", "! flagged"]
    signs += [f"{sign} {kind}" for kind, sign in _KNOWN.items() if kind in block.kinds]
    signs.append("+ photo")
    if patches:
        signs.append("ellipses: the largest of each patch")
    beyond = len(block.points) - int(near.sum())
    if beyond:
        signs.append(f"{beyond} beyond")
    return signs


def _scales(scale: float, enlarged: float | None) -> list[str]:
    """Return what stands for how much; `scale` in dots per m, `enlarged` in m per dot."""
    bar = "⠒" * (_BAR_DOTS // 2)
    ground = f"{bar} {_two_digits(_BAR_DOTS / scale)} m on the ground"
    if enlarged is None:
        return [ground]
    times = _two_digits(1.0 / (enlarged * scale))
    return [f"{bar} {_BAR_DOTS * enlarged:g} m in ellipses, x {times}", ground]


def _two_digits(value: float) -> str:
    return f"{float(f'{value:.2g}'):.12g}"


def _packed(parts: list[str], width: int) -> list[str]:
    """Return parts side by side, in as many lines as they need; what is too long is cut."""
    packed: list[str] = []
    for part in parts:
        together = f"{packed[-1]}  {part}" if packed else part
        if packed and cell_len(together) <= width:
            packed[-1] = together
        else:
            packed.append(part)
    return packed
