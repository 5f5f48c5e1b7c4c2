"""A raster of braille cells: 2 x 4 dots each, so that dots lie on a square grid.

A terminal cell is about twice as high as wide; a length of n dots is therefore the same length
along x and along y. Dot (0, 0) is the upper left one, x grows to the right, y downwards.
"""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray
from rich.cells import cell_len

__all__ = ["Canvas"]

_BITS = np.array([[0x01, 0x08], [0x02, 0x10], [0x04, 0x20], [0x40, 0x80]], dtype=np.uint32)
_BLANK = 0x20
_DASH = 2  # dots, and as many between them
_PATTERN = 0x2800
_SECOND_HALF = "\U0010ffff"  # a noncharacter: the cell belongs to the wide character before it

Run = tuple[str, int]


class Canvas:
    """A drawing of braille dots and text, with one layer number per cell.

    The layer says how a cell is to be coloured; of several in one cell the highest stays.
    Layer 0 is the empty paper.

    Parameters
    ----------
    columns, rows
        Size in terminal cells.
    """

    def __init__(self, columns: int, rows: int) -> None:
        self.columns = max(columns, 0)
        self.rows = max(rows, 0)
        self.width = 2 * self.columns
        self.height = 4 * self.rows
        self._dots = np.zeros((self.height, self.width), dtype=np.bool_)
        self._layers = np.zeros((self.rows, self.columns), dtype=np.int16)
        self._text = np.zeros((self.rows, self.columns), dtype=np.uint32)

    def dots(self) -> NDArray[np.bool_]:
        """Return a copy of the raster, shape (4 rows, 2 columns)."""
        return self._dots.copy()

    def plot(self, x: ArrayLike, y: ArrayLike, layer: int) -> None:
        """Set single dots; those outside the raster are left out.

        Parameters
        ----------
        x, y
            (n,) positions [dots], rounded to the nearest dot.
        layer
            Their layer.
        """
        px = np.atleast_1d(np.asarray(x, dtype=np.float64))
        py = np.atleast_1d(np.asarray(y, dtype=np.float64))
        with np.errstate(invalid="ignore"):
            inside = (px > -0.5) & (px < self.width - 0.5) & (py > -0.5) & (py < self.height - 0.5)
        column = np.rint(px[inside]).astype(np.intp)
        row = np.rint(py[inside]).astype(np.intp)
        self._dots[row, column] = True
        row, column = row // 4, column // 2
        lower = self._layers[row, column] < layer
        self._layers[row[lower], column[lower]] = layer

    def paste(self, dots: NDArray[np.bool_], layers: NDArray[np.int16]) -> None:
        """Put a whole picture in place of what is there.

        Parameters
        ----------
        dots
            (4 rows, 2 columns) the raster.
        layers
            (rows, columns) the cells' layers.
        """
        self._dots[:] = dots
        self._layers[:] = layers
        self._text[:] = 0

    def lines(
        self,
        x0: ArrayLike,
        y0: ArrayLike,
        x1: ArrayLike,
        y1: ArrayLike,
        layer: int,
        *,
        heavy: bool = False,
        dotted: bool = False,
    ) -> None:
        """Draw straight lines, all at once.

        Parameters
        ----------
        x0, y0, x1, y1
            (n,) ends [dots]; lines with an end that is not finite are left out.
        layer
            Their layer.
        heavy
            Two dots wide instead of one.
        dotted
            With gaps as long as what is drawn.
        """
        if not self.width or not self.height:
            return
        ends = np.stack(
            np.broadcast_arrays(*(np.atleast_1d(np.asarray(v, float)) for v in (x0, y0, x1, y1)))
        )
        ends = ends[:, np.isfinite(ends).all(axis=0)]
        ends = self._clipped(ends)
        if not ends.shape[1]:
            return
        ax, ay, bx, by = ends
        steps = np.ceil(np.maximum(np.abs(bx - ax), np.abs(by - ay))).astype(np.intp)
        counts = steps + 1
        which = np.repeat(np.arange(counts.size), counts)
        along = np.arange(which.size) - np.repeat(np.cumsum(counts) - counts, counts)
        share = along / np.maximum(steps, 1)[which]
        x = ax[which] + share * (bx - ax)[which]
        y = ay[which] + share * (by - ay)[which]
        flat = (np.abs(bx - ax) >= np.abs(by - ay))[which]
        if dotted:
            drawn = along // _DASH % 2 == 0
            x, y, flat = x[drawn], y[drawn], flat[drawn]
        self.plot(x, y, layer)
        if heavy:
            self.plot(np.where(flat, x, x + 1.0), np.where(flat, y + 1.0, y), layer)

    def _clipped(self, ends: NDArray[np.float64]) -> NDArray[np.float64]:
        """Cut lines at the raster's edge (Liang and Barsky 1984), dropping those outside."""
        ax, ay, bx, by = ends
        enter, leave = np.zeros(ax.size), np.ones(ax.size)
        seen = np.ones(ax.size, dtype=np.bool_)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for start, delta, last in (
                (ax, bx - ax, self.width - 1),
                (ay, by - ay, self.height - 1),
            ):
                for direction, distance in ((-delta, start + 0.49), (delta, last + 0.49 - start)):
                    share = distance / direction
                    enter = np.where(direction < 0, np.maximum(enter, share), enter)
                    leave = np.where(direction > 0, np.minimum(leave, share), leave)
                    seen &= (direction != 0) | (distance >= 0)
            seen &= (enter <= leave) & np.isfinite(bx - ax) & np.isfinite(by - ay)
        ax, ay, bx, by, enter, leave = (v[seen] for v in (ax, ay, bx, by, enter, leave))
        dx, dy = bx - ax, by - ay
        return np.stack([ax + enter * dx, ay + enter * dy, ax + leave * dx, ay + leave * dy])

    def arrow(
        self, x0: float, y0: float, x1: float, y1: float, layer: int, *, dotted: bool = False
    ) -> None:
        """Draw a heavy arrow, its shaft dotted or not, from (x0, y0) to (x1, y1) [dots]."""
        length = math.hypot(x1 - x0, y1 - y0)
        if not math.isfinite(length) or length < 1.0:
            return
        ux, uy = (x1 - x0) / length, (y1 - y0) / length
        barb = min(5.0, length / 2.0)
        back_x, back_y = x1 - barb * ux, y1 - barb * uy
        half = 0.6 * barb
        self.lines(x0, y0, x1, y1, layer, heavy=True, dotted=dotted)
        self.lines(
            [back_x - half * uy, back_x + half * uy],
            [back_y + half * ux, back_y - half * ux],
            [x1, x1],
            [y1, y1],
            layer,
            heavy=True,
        )

    def has_room(self, column: int, row: int, cells: int, *, over_dots: bool = False) -> bool:
        """Return whether `cells` cells from (column, row) lie inside and carry nothing.

        With `over_dots`, dots below do not count.
        """
        if not (0 <= row < self.rows and column >= 0 and column + cells <= self.columns):
            return False
        if self._text[row, column : column + cells].any():
            return False
        if over_dots:
            return True
        return not self._dots[4 * row : 4 * row + 4, 2 * column : 2 * (column + cells)].any()

    def write(self, column: int, row: int, text: str, layer: int) -> None:
        """Write text over the dots; what lies outside is cut, characters without width dropped."""
        if not 0 <= row < self.rows:
            return
        for character in text:
            cells = cell_len(character)
            if cells == 0:
                continue
            if column >= 0 and column + cells <= self.columns:
                self._text[row, column] = ord(character)
                self._text[row, column + 1 : column + cells] = ord(_SECOND_HALF)
                self._layers[row, column : column + cells] = layer
            column += cells

    def runs(self) -> list[list[Run]]:
        """Return every row as runs of (text, layer)."""
        if not self.rows or not self.columns:
            return [[] for _ in range(self.rows)]
        cells = self._dots.reshape(self.rows, 4, self.columns, 2)
        bits = np.einsum("rycx,yx->rc", cells, _BITS, dtype=np.uint32)
        codes = np.where(bits > 0, bits + _PATTERN, _BLANK).astype("<u4")
        codes = np.where(self._text > 0, self._text, codes).astype("<u4")
        drawn = []
        for code, layer in zip(codes, self._layers, strict=True):
            cuts = [0, *(np.flatnonzero(layer[1:] != layer[:-1]) + 1).tolist(), self.columns]
            # One character per cell, so the line can be cut by cells before halves are dropped.
            line = code.tobytes().decode("utf-32-le")
            layers = layer[cuts[:-1]].tolist()
            row = [
                (line[first:end], number)
                for (first, end), number in zip(itertools.pairwise(cuts), layers, strict=True)
            ]
            if _SECOND_HALF in line:
                row = [(text.replace(_SECOND_HALF, ""), number) for text, number in row]
            drawn.append(row)
        return drawn

    def text(self) -> str:
        """Return the whole drawing as text, one line per row."""
        return "\n".join("".join(part for part, _ in row) for row in self.runs())
