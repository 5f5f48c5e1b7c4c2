"""What of a report stands on its page: texts in pieces, tables with the rows that are shown.

Numbers and names are written by the same functions as on a terminal (`report/astext.py`), from the
same tables that `--json` writes. What is markup is the template's business alone.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count
from typing import NamedTuple

from anaplot.drawing.drawing import Drawing
from anaplot.report.astext import cell_texts, line_pieces
from anaplot.report.columns import counted, shortened
from anaplot.report.document import Column, Line, Listed, Table, Values
from anaplot.report.html.captions import caption_of, words_of
from anaplot.report.html.parts import (
    Captioned,
    Defined,
    Definitions,
    Facts,
    HtmlBlock,
    Report,
    Section,
)
from anaplot.textfiles.wording import plain

__all__ = [
    "MOST_ROWS",
    "BlockView",
    "PageView",
    "SectionView",
    "TableView",
    "Text",
    "of_every_row",
    "page_view",
    "text_of",
]

MOST_ROWS = 2500
"""A longer table shows only the rows that need a look; a file beside the page has them all."""

_LONGEST = 60  # characters of a name that are shown; the whole is its title
_FIRST = 50  # rows of a longer table of which none needs a look
_FOLDED = 30  # rows of a table that is shown without being opened
_FEW = 14  # rows that are not parted on paper
_SHORT = 90  # characters of a caption in one line
_MANY, _ACROSS = 9, 17  # columns from which paper has smaller letters, and lies across


class Text(NamedTuple):
    """A piece of text: what is read, whether it is a name, and the whole of one that is cut."""

    text: str
    is_name: bool = False
    whole: str = ""


class LineView(NamedTuple):
    """A line: its pieces, its kind, and whether blanks in it mean columns."""

    pieces: tuple[Text, ...]
    kind: str
    laid_out: bool


class Head(NamedTuple):
    """The head of a column: its words, unit, the key of its definition, whether it holds names."""

    title: str
    unit: str
    key: str
    names: bool


class Row(NamedTuple):
    """A row: its cells, and whether it needs a look."""

    cells: tuple[Text, ...]
    look: bool


@dataclass(frozen=True, slots=True)
class TableView:
    """A table as it is shown.

    Attributes
    ----------
    id
        Once on the page; also the name of the file beside it that has every row.
    caption
        What it shows.
    heads
        Of its columns; the first names the row.
    groups
        Rows with the same line above them, and that line; one without a line where there are none.
    rows
        How many the table has, of which `shown` are shown.
    cut
        What is said of the others, or "".
    folded
        Whether only the caption is shown until it is opened.
    short
        Whether the caption stands in one line.
    width
        "many" or "across" where it has so many columns that paper needs smaller letters, or lies
        across; "few" where it has so few rows that paper does not part them.
    """

    id: str
    caption: tuple[Text, ...]
    heads: tuple[Head, ...]
    groups: tuple[tuple[Text | None, tuple[Row, ...]], ...]
    rows: int
    shown: int
    cut: str
    folded: bool
    short: bool
    width: str


@dataclass(frozen=True, slots=True)
class BlockView:
    """A part of a section, and of which kind: "lines", "heading", "facts", "table" and so on."""

    kind: str
    lines: tuple[LineView, ...] = ()
    words: tuple[str, ...] = ()
    table: TableView | None = None
    drawings: tuple[Drawing, ...] = ()
    section: SectionView | None = None
    defined: tuple[Defined, ...] = ()


@dataclass(frozen=True, slots=True)
class SectionView:
    """A section: address, heading and its level, parts, whether folded, how it is on paper."""

    id: str
    title: tuple[Text, ...]
    level: int
    blocks: tuple[BlockView, ...]
    folded: bool
    on_paper: str


@dataclass(frozen=True, slots=True)
class PageView:
    """A page: title, lead, verdict, sections, and by their addresses the tables that it cuts."""

    title: tuple[Text, ...]
    lead: tuple[Text, ...]
    verdict: tuple[tuple[str, LineView], ...]
    sections: tuple[SectionView, ...]
    cut: Mapping[str, Table]


def text_of(line: str | Line) -> tuple[Text, ...]:
    """Return the pieces of a line."""
    if isinstance(line, str):
        return (Text(plain(line)),)
    return tuple(
        Text(piece.text)
        if piece.name is None
        else Text(piece.text, True, _whole(piece.text, piece.name))
        for piece in line_pieces(line)
    )


def _whole(shown: str, name: str) -> str:
    """Return a name made plain where not all of it is shown."""
    whole = plain(name)
    return "" if whole in shown else whole


def of_every_row(name: str) -> str:
    """Return what a page says of a file that has every row of one of its tables."""
    return f"{name} has every row"


def page_view(report: Report, *, most_rows: int = MOST_ROWS, beside: str = "") -> PageView:
    """Return a report as it is shown.

    Parameters
    ----------
    report
        The report.
    most_rows
        How many rows a table may have that is shown whole.
    beside
        How the folder beside the page is called that has whole tables; "": there is none.
    """
    plan = _Plan(most_rows, beside)
    sections = tuple(plan.section(section, 2) for section in report.all_sections)
    verdict = tuple(map(_labelled, report.verdict))
    lead = () if report.lead is None else text_of(report.lead)
    return PageView(text_of(report.title), lead, verdict, sections, plan.cut)


class _Addresses:
    """Gives every address once."""

    def __init__(self) -> None:
        self._taken: set[str] = set()

    def of(self, key: str) -> str:
        """Return an address for a key: itself, or with a number behind it."""
        address = next(one for one in _numbered(key) if one not in self._taken)
        self._taken.add(address)
        return address


def _numbered(key: str) -> Iterator[str]:
    yield key
    for k in count(2):
        yield f"{key}-{k}"


class _Plan:
    """Puts together what is shown."""

    def __init__(self, most_rows: int, beside: str) -> None:
        self._most_rows = most_rows
        self._beside = beside
        self._addresses = _Addresses()
        self._inside = False  # of something that is folded
        self.cut: dict[str, Table] = {}

    def section(self, section: Section, level: int) -> SectionView:
        address = self._addresses.of(section.key)
        around, self._inside = self._inside, self._inside or section.folded
        blocks = tuple(self._blocks(section.blocks, level))
        self._inside = around
        return SectionView(
            address, text_of(section.title), level, blocks, section.folded, section.on_paper
        )

    def _blocks(self, blocks: Iterable[HtmlBlock], level: int) -> Iterator[BlockView]:
        lines: list[LineView] = []
        drawings: list[Drawing] = []
        for block in blocks:
            if drawings and not isinstance(block, Drawing):
                yield BlockView("drawings", drawings=tuple(drawings))
                drawings = []
            if isinstance(block, Line | Listed):
                lines += _lines(block)
                continue
            if lines:
                yield from _paragraphs(lines)
                lines = []
            if isinstance(block, Section):
                inner = self.section(block, min(level + 1, 6))
                yield BlockView("section", section=inner)
            elif isinstance(block, Drawing):
                drawings.append(block)
            elif isinstance(block, Definitions):
                yield BlockView("definitions", defined=block.rows)
            elif isinstance(block, Facts):
                said = tuple(_line(line) for _, line in block.items)
                yield BlockView("facts", lines=said, words=tuple(word for word, _ in block.items))
            else:
                yield BlockView("table", table=self._table(block))
        yield from _paragraphs(lines)
        if drawings:
            yield BlockView("drawings", drawings=tuple(drawings))

    def _table(self, block: Table | Captioned) -> TableView:
        table, caption = (
            (block.table, block.caption)
            if isinstance(block, Captioned)
            else (block, caption_of(block.key))
        )
        address = self._addresses.of(f"table-{table.key.replace('_', '-')}")
        n = len(table)
        marked = table.marked()
        chosen = _chosen(table, self._most_rows, marked)
        if len(chosen) < n:
            self.cut[address] = table
        columns = [(column, cell_texts(column, values, chosen)) for column, values in _shown(table)]
        to_look = set(marked)
        looks = [k in to_look for k in chosen]
        cells = [
            Row(tuple(_cell(text, column) for column, text in zip(heads, row, strict=True)), look)
            for (heads, row), look in zip(_rows(columns, len(chosen)), looks, strict=True)
        ]
        return TableView(
            address,
            text_of(caption),
            tuple(_head(column) for column, _ in columns),
            _grouped(table, chosen, cells),
            n,
            len(chosen),
            self._left_out(address, n, len(chosen), looks=any(looks)),
            len(chosen) > _FOLDED and not self._inside,
            sum(len(piece.text) for piece in text_of(caption)) <= _SHORT,
            _width(len(columns)) + (" few" if len(chosen) <= _FEW else ""),
        )

    def _left_out(self, address: str, n: int, shown: int, *, looks: bool) -> str:
        if shown == n:
            return ""
        which = "those that need a look" if looks else "the first, since none needs a look"
        where = f"; {plain(self._beside)}/{of_every_row(f'{address}.csv')}" if self._beside else ""
        return f"{shown} of {counted(n, 'row')} are shown, {which}{where}"


def _width(columns: int) -> str:
    if columns >= _ACROSS:
        return "across"
    return "many" if columns >= _MANY else ""


def _rows(
    columns: Sequence[tuple[Column, list[str]]], n: int
) -> Iterator[tuple[list[Column], tuple[str, ...]]]:
    heads = [column for column, _ in columns]
    if columns and n:
        for row in zip(*(texts for _, texts in columns), strict=True):
            yield heads, row


def _shown(table: Table) -> list[tuple[Column, Values]]:
    """Return the columns that a page has: those of a person, without one that is a mere remark."""
    return [
        (column, values)
        for column, values in table.for_people()
        if column.key or any(value not in (None, "") for value in values)
    ]


def _head(column: Column) -> Head:
    title = plain(column.title.strip()) or words_of(column.key)
    unit = column.shown_unit
    if "[" in title or unit in title.split():
        unit = ""
    return Head(title, unit, column.key or column.title, column.align == "<")


def _cell(text: str, column: Column) -> Text:
    if column.align == ">":
        return Text(text)
    shown = shortened(text, max(_LONGEST, column.width or 0))
    return Text(shown, True, "" if shown == text else text)


def _grouped(
    table: Table, chosen: Sequence[int], rows: list[Row]
) -> tuple[tuple[Text | None, tuple[Row, ...]], ...]:
    if not table.group:
        return ((None, tuple(rows)),)
    keys = [column.key for column in table.columns]
    names = table.values[keys.index(table.group)]
    groups: list[tuple[str, list[Row]]] = []
    for k, row in zip(chosen, rows, strict=True):
        name = plain(str(names[k]))
        if not groups or groups[-1][0] != name:
            groups.append((name, []))
        groups[-1][1].append(row)
    return tuple((Text(name, True), tuple(some)) for name, some in groups)


def _chosen(table: Table, most: int, marked: Sequence[int]) -> Sequence[int]:
    n = len(table)
    if n <= most:
        return range(n)
    if table.most is not None:
        return range(most)
    return marked[:most] or range(min(n, _FIRST))


def _lines(block: Line | Listed) -> list[LineView]:
    if isinstance(block, Listed):
        shown = [_line(line) for line in block.lines[: block.most]]
        left = len(block.lines) - len(shown)
        if left and block.more:
            shown.append(_line(Line((block.more.format(left),))))
        return shown
    return [_line(block)]


def _line(line: Line) -> LineView:
    pieces = text_of(line)
    text = "".join(piece.text for piece in pieces)
    return LineView(pieces, line.kind, text.startswith(" ") or "   " in text)


def _labelled(line: Line) -> tuple[str, LineView]:
    """Return the word before the colon with which a line begins, "" without one, and the rest."""
    first = line.parts[0] if line.parts else ""
    label, colon, rest = first.partition(": ") if isinstance(first, str) else ("", "", "")
    if not colon:
        return "", _line(line)
    return label, _line(replace(line, parts=(rest, *line.parts[1:])))


def _paragraphs(lines: Sequence[LineView]) -> Iterator[BlockView]:
    """Yield lines that belong together: those between empty ones and headings."""
    some: list[LineView] = []
    for line in lines:
        if some and (not line.pieces or line.kind == "heading"):
            yield _together(some)
            some = []
        if line.kind == "heading" and not line.laid_out:
            yield BlockView("heading", lines=(line,))
        elif line.kind == "heading":
            yield BlockView("heading", lines=(_title(line),))
            some.append(line)
        elif line.pieces:
            some.append(line)
    if some:
        yield _together(some)


def _together(lines: Sequence[LineView]) -> BlockView:
    """Return lines that stand below each other, laid out where one of them is."""
    laid_out = any(line.laid_out for line in lines)
    return BlockView("lines", lines=tuple(line._replace(laid_out=laid_out) for line in lines))


def _title(line: LineView) -> LineView:
    """Return the words with which a heading of columns begins."""
    text = "".join(piece.text for piece in line.pieces).strip().partition("  ")[0]
    return line._replace(pieces=(Text(text, True),), laid_out=False)
