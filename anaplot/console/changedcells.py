"""Only what changes goes to the terminal.

A frame, as it is composed, paints every widget that was asked to draw itself. What the terminal
shows is known here cell by cell, and of a frame only those cells pass that differ.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from itertools import groupby

from rich.cells import cell_len, get_character_cell_size
from textual.driver import Driver

__all__ = ["ShownCells", "writing_changes"]

_PARTS = re.compile(
    r"\x1b\[(?P<line>\d+);(?P<column>\d+)H"
    r"|\x1b\[(?P<style>[\d;]*)m"
    r"|(?P<text>[^\x00-\x1f\x7f]+)"
    r"|(?P<next>\n(?=\x1b\[\d+;\d+H))"
    r"|(?P<frame>\x1b\[\?2026[hl])"
    r"|(?P<beside>\x07|\x1b\][^\x07\x1b]*(?:\x07|\x1b\\))"  # a bell, a title, the clipboard
    r"|(?P<other>\x1b\[[0-?]*[ -/]*[@-~]|(?s:.))"
)
_BEGIN = "\x1b[?2026h"  # of a frame, for terminals that show it at once
_RESET = "\x1b[0m"
_NEAR = 6  # unchanged cells that cost less than a jump over them

Cell = tuple[str, str] | None
"""Text and style of a cell; None: unknown. Text that is no sequence of single cells (wide or
combined characters) stands in the first of its cells, and "" in the others."""


class ShownCells:
    """What the terminal shows.

    Positions, styles, text and the marks of a frame are understood. Anything else passes as it is,
    and what it has made of the screen is not known.
    """

    def __init__(self) -> None:
        self._rows: dict[int, list[Cell]] = {}
        self._cursor: tuple[int, int] | None = None
        self._style = ""
        self._begun = False  # a frame has begun, and nothing of it is written yet

    def forget(self) -> None:
        """Take nothing for known: what comes next is written whole."""
        self._rows = {}
        self._cursor = None

    def changes(self, data: str) -> str:
        """Return what has to be written so that the terminal shows what `data` would show.

        Parameters
        ----------
        data
            Text and whole control sequences, as a frame has them: every line is begun with its
            position.
        """
        out: list[str] = []
        changed: dict[int, set[int]] = {}
        place = self._cursor
        for part in _PARTS.finditer(data):
            kind = part.lastgroup
            if kind == "column":
                place = int(part["line"]), int(part["column"])
            elif kind == "style":
                self._turn(part["style"])
            elif kind == "text" and place is not None:
                place = self._put(part["text"], place, changed)
            elif kind != "next":
                self._write(changed, place, out)
                self._pass(part[0], kind, out)
                place = self._cursor
        self._write(changed, place, out)
        return "".join(out)

    # -- taking in -------------------------------------------------------------------------------

    def _turn(self, style: str) -> None:
        """Take a style: it adds to what there is, until everything is reset."""
        if style in ("", "0"):
            self._style = ""
        else:
            self._style = f"{self._style};{style}" if self._style else style

    def _put(
        self, text: str, place: tuple[int, int], changed: dict[int, set[int]]
    ) -> tuple[int, int]:
        line, column = place
        row = self._rows.setdefault(line, [])
        cells = _cells(text, self._style)
        end = column + len(cells)
        row += [None] * (end + 1 - len(row))
        if row[column:end] != cells:
            new = {k for k, cell in enumerate(cells, column) if row[k] != cell}
            changed.setdefault(line, set()).update(new)
            _cut(row, column)
            _cut(row, end)
            row[column:end] = cells
        return line, end

    # -- giving out ------------------------------------------------------------------------------

    def _write(
        self, changed: dict[int, set[int]], place: tuple[int, int] | None, out: list[str]
    ) -> None:
        """Write the changed cells, and put the cursor in its place."""
        written = ""
        for line in sorted(changed):
            row = self._rows[line]
            for first, end in _stretches(sorted(changed[line]), row):
                self._begin(out)
                out.append(f"\x1b[{line};{first}H")
                known = (cell for cell in row[first:end] if cell is not None)
                for style, cells in groupby(known, key=lambda cell: cell[1]):
                    out.append(_change(written, style))
                    out += [text for text, _ in cells]
                    written = style
                self._cursor = None
        changed.clear()
        if written:
            out.append(_RESET)
        if place is not None and place != self._cursor:
            self._begin(out)
            out.append(f"\x1b[{place[0]};{place[1]}H")
            self._cursor = place

    def _begin(self, out: list[str]) -> None:
        if self._begun:
            out.append(_BEGIN)
            self._begun = False

    def _pass(self, data: str, kind: str | None, out: list[str]) -> None:
        if data == _BEGIN:
            self._begun = True
        elif kind == "frame" and self._begun:
            self._begun = False  # nothing has changed between its begin and its end
        else:
            self._begin(out)
            out.append(data)
            if kind not in ("frame", "beside"):
                self.forget()


def _cells(text: str, style: str) -> list[Cell]:
    if text.isascii() or all(get_character_cell_size(character) == 1 for character in text):
        return [(character, style) for character in text]
    return [(text, style), *[("", style)] * (cell_len(text) - 1)]


def _cut(row: list[Cell], at: int) -> None:
    """Take for unknown the text that goes on from before a cell to it: a part is overwritten."""

    def goes_on(k: int) -> bool:
        cell = row[k]
        return cell is not None and not cell[0]

    if not goes_on(at):
        return
    first, end = at, at
    while goes_on(first):
        first -= 1
    while end < len(row) and goes_on(end):
        end += 1
    row[first:end] = [None] * (end - first)


def _stretches(columns: list[int], row: list[Cell]) -> Iterator[tuple[int, int]]:
    """Yield first columns and ends of what is written without a jump."""
    first = last = columns[0]
    for column in columns[1:]:
        if column - last > _NEAR or None in row[last:column]:
            yield first, last + 1
            first = column
        last = column
    yield first, last + 1


@lru_cache(maxsize=4096)
def _change(old: str, new: str) -> str:
    """Return the control sequence from one style to another."""
    if old == new:
        return ""
    if not new:
        return _RESET
    (before, *colours), (after, *wanted) = _split(old), _split(new)
    lost = any(colour and not other for colour, other in zip(colours, wanted, strict=True))
    if before != after or lost:
        return f"\x1b[{new}m" if not old else f"\x1b[0;{new}m"
    return f"\x1b[{';'.join(c for c, o in zip(wanted, colours, strict=True) if c != o)}m"


def _split(style: str) -> tuple[str, str, str]:
    """Return the attributes, the colour and the background of a style."""
    attributes, colour, background = [], "", ""
    codes = iter(style.split(";") if style else ())
    for code in codes:
        whole = code
        if code in ("38", "48"):
            space = next(codes, "")
            rest = [next(codes, "") for _ in range({"2": 3, "5": 1}.get(space, 0))]
            whole = ";".join((code, space, *rest))
        if code in _COLOURS:
            colour = whole
        elif code in _BACKGROUNDS:
            background = whole
        else:
            attributes.append(code)
    return ";".join(attributes), colour, background


_COLOURS = {"38", *(str(k) for k in (*range(30, 38), *range(90, 98)))}
_BACKGROUNDS = {"48", *(str(k) for k in (*range(40, 48), *range(100, 108)))}


def writing_changes(driver: type[Driver], shown: ShownCells) -> type[Driver]:
    """Return a driver class that writes changes only.

    Parameters
    ----------
    driver
        What writes to the terminal.
    shown
        What the terminal shows.
    """

    def write(self: Driver, data: str) -> None:
        if rest := shown.changes(data):
            driver.write(self, rest)

    return type(f"Changes{driver.__name__}", (driver,), {"write": write})
