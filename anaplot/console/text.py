"""Text cut, padded and wrapped by terminal cells."""

from __future__ import annotations

import math

from rich.cells import cell_len, chop_cells, set_cell_size

from anaplot.textfiles.wording import plain

__all__ = ["cell", "fit", "fit_end", "number", "wrap"]


def fit(text: str, width: int, *, right: bool = False) -> str:
    """Return harmless text of exactly `width` cells; what is too long ends in an ellipsis."""
    text = plain(text)
    if width <= 0:
        return ""
    length = cell_len(text)
    if length > width:
        return set_cell_size(text, width - 1) + "…"
    padding = " " * (width - length)
    return padding + text if right else text + padding


def wrap(text: str, width: int) -> list[str]:
    """Return harmless text as lines of at most `width` cells, broken between words if possible."""
    width = max(width, 1)
    lines: list[str] = []
    line = ""
    for word in plain(text).split():
        joined = f"{line} {word}" if line else word
        if cell_len(joined) <= width:
            line = joined
            continue
        if line:
            lines.append(line)
        *full, line = chop_cells(word, width)
        lines.extend(full)
    if line:
        lines.append(line)
    return lines


def fit_end(text: str, width: int) -> str:
    """Return harmless text of exactly `width` cells; of what is too long the end is kept.

    Names of points differ at their end more often than at their start.
    """
    text = plain(text)
    if cell_len(text) <= width:
        return fit(text, width)
    kept = text
    while cell_len(kept) > max(width - 1, 0):
        kept = kept[1:]
    return fit("…" + kept, width)


def number(value: float | None, width: int, decimals: int) -> str:
    """Return a number right-aligned in `width` cells; a dash for what does not exist.

    A number too long for its column gives up decimals, then turns to powers of ten.
    """
    if value is None or not math.isfinite(value):
        return "–".rjust(width)
    for places in range(decimals, -1, -1):
        shown = f"{value:z.{places}f}"  # z: no minus sign before a rounded nothing
        if len(shown) <= width:
            break
    else:
        shown = f"{value:.0e}"
    return shown.rjust(width)


def cell(value: float | None, width: int, decimals: int) -> str:
    """Return a number right-aligned in `width` cells that never touches its neighbour."""
    return " " + number(value, width - 1, decimals)
