"""A document as text for a terminal: names made safe, long tables cut to what needs a look."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from itertools import chain, compress
from typing import Any, NamedTuple

from anaplot.report.columns import PAGE, cell, column, fitted, shortened, wrapped
from anaplot.report.document import (
    Block,
    Column,
    Figure,
    Line,
    Listed,
    Names,
    Table,
    Value,
    Values,
    is_array,
)
from anaplot.report.places import at_places
from anaplot.textfiles.wording import plain

__all__ = [
    "MOST_ROWS",
    "Piece",
    "cell_texts",
    "line_pieces",
    "line_text",
    "page_parts",
    "page_text",
    "table_lines",
]

MOST_ROWS = 100
"""A longer table shows only the rows that need a look, unless all is asked for."""

_AT_ONCE = 4096
"""Rows of a long table that are written at once."""

_AT_FIRST = 128
"""Of the first ones: where rows are made as they are read, `| head` waits for no more."""


def page_text(page: Iterable[Block], *, everything: bool = False) -> str:
    """Return a page.

    Parameters
    ----------
    page
        Its blocks.
    everything
        Whether long tables and lists are shown whole.
    """
    return "\n".join(page_parts(page, everything=everything))


def page_parts(page: Iterable[Block], *, everything: bool = False) -> Iterator[str]:
    """Yield the lines of a page, those of large tables many at once with line feeds between."""
    for block in page:
        if isinstance(block, Table):
            yield from map("\n".join, _table_parts(block, everything))
        else:
            yield from _lines(block, everything)


def _lines(block: Line | Listed | Figure, everything: bool) -> Iterator[str]:
    if isinstance(block, Line):
        yield from _folded(block, everything)
    elif isinstance(block, Figure):
        yield from block.lines(block.data)
    else:
        yield from _listed(block, everything)


def _listed(listed: Listed, everything: bool) -> Iterator[str]:
    most = len(listed.lines) if everything else listed.most
    for line in listed.lines[:most]:
        yield from _folded(line, everything)
    if len(listed.lines) > most and listed.more:
        yield listed.more.format(len(listed.lines) - most)


def _folded(line: Line, everything: bool) -> list[str]:
    if line.indent is None:
        return [line_text(line, everything=everything)]
    indent = " " * line.indent
    for k, part in enumerate(line.parts):
        if isinstance(part, Names):
            before, after = (Line(some) for some in (line.parts[:k], line.parts[k + 1 :]))
            items, more = _items(part, everything)
            items += [more.strip()] if more else []
            words = line_text(before, everything=everything)
            *begun, head = _wrapped(words, indent, whole=True)
            if begun:
                head += words[len(words.rstrip()) :]
            lines = wrapped(head, items, separator=part.separator, indent=indent)
            lines[-1] += line_text(after, everything=everything)
            # what stands after the list may be long as well; names stay whole
            return begun + [some for one in lines for some in _wrapped(one, indent, whole=True)]
    return _wrapped(line_text(line), indent)


def _wrapped(text: str, indent: str, *, whole: bool = False) -> list[str]:
    if whole and len(text) <= PAGE:
        return [text]
    lines = textwrap.wrap(
        text,
        PAGE,
        subsequent_indent=indent,
        break_long_words=not whole,
        break_on_hyphens=not whole,
    )
    return lines or [""]


def line_text(line: Line, *, everything: bool = False) -> str:
    """Return a line."""
    return "".join(piece.text for piece in line_pieces(line, everything=everything))


class Piece(NamedTuple):
    """A piece of a line as it is read, and the whole of it where it is a name or a word."""

    text: str
    name: str | None = None


def line_pieces(line: Line, *, everything: bool = False) -> Iterator[Piece]:
    """Yield the pieces of a line, for what sets names apart from the words around them."""
    for part in line.parts:
        if isinstance(part, str):
            yield Piece(part)
        elif isinstance(part, Value):
            yield Piece(_value(part), part.value if isinstance(part.value, str) else None)
        else:
            most = _most(part, everything)
            for k, item in enumerate(part.items[:most]):
                if k:
                    yield Piece(part.separator)
                yield from line_pieces(item, everything=everything)
            if len(part.items) > most:
                yield Piece(part.more.format(len(part.items) - most))


def _value(part: Value) -> str:
    value = part.value
    if part.form.endswith("c"):
        return _cell(part)
    if value is None:
        return part.none
    text = _name(value, part.form) if isinstance(value, str) else format(value, part.form)
    return f"{text} {part.unit}" if part.unit else text


def _most(names: Names, everything: bool) -> int:
    return len(names.items) if everything or names.most is None else names.most


def _items(names: Names, everything: bool) -> tuple[list[str], str]:
    """Return the items of a list that are shown, and what is said of the others."""
    count, most = len(names.items), _most(names, everything)
    items = [line_text(item, everything=everything) for item in names.items[:most]]
    return items, names.more.format(count - most) if count > most else ""


def _name(value: str, form: str) -> str:
    place, _, most = form.partition(".")
    return format(shortened(value, int(most)) if most else plain(value), place)


def _cell(part: Value) -> str:
    width, _, decimals = part.form[:-1].partition(".")
    if part.value is None or isinstance(part.value, str):
        return column(part.none if part.value is None else plain(part.value), int(width))
    return cell(part.value, int(decimals or 0), int(width))


def table_lines(table: Table, *, everything: bool = True) -> list[str]:
    """Return a table, a line each row, with its heading."""
    return list(chain.from_iterable(_table_parts(table, everything)))


def _table_parts(table: Table, everything: bool) -> Iterator[list[str]]:
    """Yield the heading of a table, and its rows some thousand at a time."""
    n = len(table)
    chosen = _chosen(table, everything)
    columns: list[tuple[Column, Values, list[str] | None]] = []
    heads, units, row = "", "", ""
    for one, values in table.for_people():
        width = one.width or 0
        names = None
        if one.align == "<":
            names = cell_texts(one, values, chosen)  # the longest of all says how wide it is
            title = len(one.title) if one.head is None else 0
            width = max([title, width, *map(len, names)])
            head = f"{'':{one.gap}}{one.title:<{width}}"
            row += f"{'':{one.gap}}%-{width}s"
        else:
            head = f"{one.title:>{width}}"
            row += f" %{width - 1}s"
        columns.append((one, values, names))
        if one.head is not None:
            head = one.head
        heads += head
        shown = "" if "[" in one.title else one.shown_unit
        unit = f"{shown:{table.units}{len(one.title)}}" if table.units else ""
        units += f"{unit:>{len(head)}}"
    yield [heads.rstrip(), units.rstrip()] if units.strip() else [heads.rstrip()]
    before = None
    last, step = 0, min(_AT_FIRST, _AT_ONCE)
    while last < len(chosen):
        first, last, step = last, last + step, min(2 * step, _AT_ONCE)
        some = chosen[first:last]
        cells = (
            cell_texts(one, values, some) if names is None else names[first:last]
            for one, values, names in columns
        )
        every = tuple(chain.from_iterable(zip(*cells, strict=True)))
        rows = [line.rstrip() for line in ("\n".join([row] * len(some)) % every).split("\n")]
        if table.group:
            rows, before = _grouped(table, some, rows, before)
        yield rows
    if len(chosen) < n and (table.most is None or table.more):
        yield [_left_out(table, len(chosen))]


def _grouped(
    table: Table, chosen: Sequence[int], rows: list[str], before: Any
) -> tuple[list[str], Any]:
    """Return rows with a line above those of each group, and the last group."""
    keys = [column.key for column in table.columns]
    groups = table.values[keys.index(table.group)]
    lines: list[str] = []
    for k, row in zip(chosen, rows, strict=True):
        if groups[k] != before:
            before = groups[k]
            lines.append(plain(str(before)))
        lines.append(row)
    return lines, before


def _chosen(table: Table, everything: bool) -> Sequence[int]:
    """Return the rows that are shown."""
    n = len(table)
    if everything:
        return range(n)
    if table.most is not None:
        return range(min(n, table.most))
    if n <= MOST_ROWS:
        return range(n)
    return table.marked()[:MOST_ROWS]


def _left_out(table: Table, shown: int) -> str:
    n = len(table)
    if table.most is not None:
        return table.more.format(n - shown)
    rows = f"{n - shown} of {n} rows are not shown" if shown else f"{n} rows are not shown"
    return f"  ... {rows}; --all prints them"


def cell_texts(column: Column, values: Values, chosen: Sequence[int]) -> list[str]:
    """Return what stands in the cells of the chosen rows, without blanks around it."""
    each: Any = at_places(values, chosen)
    if is_array(each):
        each = each.tolist()
    if column.decimals is not None:
        numbers = map(_length, each) if column.parts else each
        return _numbers([math.nan if v is None else v * column.scale for v in numbers], column)
    write = str if column.form is None else column.form
    texts = [column.none if v is None else write(v) for v in each]
    return texts if "".join(texts).isprintable() else [plain(text) for text in texts]


def _length(vector: Iterable[float] | None) -> float | None:
    """Return the length of a vector; None of one that does not exist."""
    return None if vector is None else math.hypot(*vector)


def _numbers(each: Sequence[float], column: Column) -> list[str]:
    """Return numbers in at most a cell's width; all at once, as most of them fit."""
    texts = "\n".join([f"%.{column.decimals}f"] * len(each)) % tuple(each)
    cells = texts.split("\n") if each else []
    most = (column.width or 0) - 1
    if max(map(len, cells), default=0) > most:
        for k in compress(range(len(cells)), (len(text) > most for text in cells)):
            cells[k] = fitted(each[k], column.decimals or 0, most)
    instead = {"nan": column.none, f"{-0.0:.{column.decimals}f}": f"{0.0:.{column.decimals}f}"}
    return [instead.get(text, text) for text in cells]
