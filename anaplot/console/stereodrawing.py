"""The two patches of the stereo view as drawings: halftone, marked points, the floating mark."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from rich.cells import cell_len

from anaplot.console.braille import Canvas
from anaplot.console.halftone import TONES, halftone, tones
from anaplot.textfiles.wording import plain

if TYPE_CHECKING:
    from anaplot.simulation.stereo import MarkedPoint

__all__ = ["StereoLayer", "draw_patch", "patch_size"]

_LONGEST_NAME = 12
_ARM = 2  # cells of the cross beside the mark, and between it and the mark


class StereoLayer(IntEnum):
    """What a cell shows, beside the tones 0 to TONES - 1 of the picture."""

    NAME = TONES
    MARK = TONES + 1


def patch_size(columns: int, rows: int) -> tuple[int, int] | None:
    """Return the size [cells] of a patch in this room, or None when there is too little.

    Both are odd, so that the mark has a cell of its own in the middle; the patch is never much
    higher than wide (a cell is twice as high as wide).
    """
    rows = min(rows, columns * 3 // 4)
    columns, rows = columns - 1 + columns % 2, rows - 1 + rows % 2
    return (columns, rows) if columns >= 9 and rows >= 5 else None


def draw_patch(
    grey: NDArray[np.float64], marks: tuple[MarkedPoint, ...], *, negative: bool = False
) -> Canvas:
    """Draw a patch.

    Parameters
    ----------
    grey
        (4 rows, 2 columns), 0 black to 1 white, with rows and columns odd numbers of cells.
    marks
        The points in it; names are written where there is room.
    negative
        Whether dots are darker than the paper, as on a light screen.

    Returns
    -------
    Canvas
        Its layers are tones, and those of `StereoLayer`.
    """
    columns, rows = grey.shape[1] // 2, grey.shape[0] // 4
    canvas = Canvas(columns, rows)
    dots = halftone(grey)
    canvas.paste(~dots if negative else dots, tones(1.0 - grey if negative else grey))
    _draw_mark(canvas)
    for mark in marks:
        _draw_name(canvas, mark)
    return canvas


def _draw_mark(canvas: Canvas) -> None:
    """Draw the floating mark: a dot, and an open cross that leads the eye to it."""
    column, row = canvas.columns // 2, canvas.rows // 2
    canvas.write(column, row, "•", StereoLayer.MARK)
    canvas.write(column - 2 * _ARM, row, "━" * _ARM, StereoLayer.MARK)
    canvas.write(column + 1 + _ARM - 1, row, "━" * _ARM, StereoLayer.MARK)
    for up in (-_ARM, _ARM):
        canvas.write(column, row + up, "┃", StereoLayer.MARK)


def _draw_name(canvas: Canvas, mark: MarkedPoint) -> None:
    """Write a name beside its signal, away from the floating mark."""
    name = f" {plain(mark.point).strip()[:_LONGEST_NAME]} "
    cells = cell_len(name)
    row = round((mark.row - 1.5) / 4.0)
    after = math.ceil((mark.column + mark.radius) / 2.0)
    before = math.floor((mark.column - mark.radius) / 2.0) + 1 - cells
    below = math.ceil((mark.row + mark.radius) / 4.0)
    above = math.floor((mark.row - mark.radius) / 4.0) - 1
    middle = round(mark.column / 2.0 - cells / 2.0)
    places = (
        (after, row),
        (before, row),
        (middle, below),
        (middle, above),
        (after, below),
        (after, above),
        (before, below),
        (before, above),
    )
    for column, line in places:
        if _clear(canvas, column, line, cells):
            canvas.write(column, line, name, StereoLayer.NAME)
            return


def _clear(canvas: Canvas, column: int, row: int, cells: int) -> bool:
    beside = abs(row - canvas.rows // 2) > 1
    left, right = canvas.columns // 2 - _ARM, canvas.columns // 2 + _ARM
    return canvas.has_room(column, row, cells, over_dots=True) and (
        beside or column > right or column + cells <= left
    )
