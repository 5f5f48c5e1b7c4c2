"""The lines of a CSV file as they stand: their ends, blank lines, blanks and quotes of fields."""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from typing import NamedTuple, Self

__all__ = ["CsvLine", "CsvLines", "cell_value", "cells_of", "with_value"]

_ENDS = re.compile(r"(\r\n|\r|\n)")
_MARK = "\ufeff"


class CsvLine(NamedTuple):
    """A line of a CSV file.

    Attributes
    ----------
    above
        Blank lines before it.
    text
        What stands in it.
    end
        How it ends; "" where the file does.
    """

    above: str
    text: str
    end: str


class CsvLines(NamedTuple):
    """The text of a CSV file by lines.

    Attributes
    ----------
    mark
        The byte order mark, where there is one.
    header
        Its first line.
    rows
        The line of every row.
    below
        Blank lines at the end.
    """

    mark: str
    header: CsvLine
    rows: tuple[CsvLine, ...]
    below: str

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the lines of a text that `read_csv` takes."""
        mark = _MARK if text.startswith(_MARK) else ""
        parts = [*_ENDS.split(text[len(mark) :]), ""]
        header = CsvLine("", *parts[:2])
        rows: list[CsvLine] = []
        above = ""
        for line, end in zip(parts[2::2], parts[3::2], strict=True):
            if not line or line.isspace():
                above += line + end
            else:
                rows.append(CsvLine(above, line, end))
                above = ""
        return cls(mark, header, tuple(rows), above)

    @property
    def end(self) -> str:
        """How most of its lines end."""
        ends = Counter(line.end for line in (self.header, *self.rows) if line.end)
        return ends.most_common(1)[0][0] if ends else "\n"

    def with_rows(self, header: str, rows: list[CsvLine]) -> str:
        """Return the text with another header and other rows; the last line ends as it did."""
        old = (self.header, *self.rows)
        ended = bool(self.below or old[-1].end)
        lines = [self.header._replace(text=header), *rows]
        parts = [self.mark]
        for line in lines:
            parts += (line.above, line.text, line.end or self.end)
        if not ended:
            parts.pop()
        return "".join((*parts, self.below))


def cells_of(line: str) -> list[str]:
    """Return the fields of a line with the blanks and quotes around them."""
    if '"' not in line:
        return line.split(",")
    cells: list[str] = []
    begin = 0
    while True:
        at = begin
        while line[at : at + 1] == " ":
            at += 1
        if line[at : at + 1] == '"':
            at += 1
            while (at := line.find('"', at) + 1) and line[at : at + 1] == '"':
                at += 1
        end = line.find(",", at)
        cells.append(line[begin:end] if end >= 0 else line[begin:])
        if end < 0:
            return cells
        begin = end + 1


def cell_value(cell: str) -> str:
    """Return what a field says, as `read_csv` reads it."""
    if '"' in cell:
        cell = next(csv.reader([cell], skipinitialspace=True))[0]
    return cell.strip()


def with_value(cell: str, value: str) -> str:
    """Return a field that says something else; blanks around it stay, and quotes without need."""
    inner = cell.strip()
    before, after = (cell, "") if not inner else cell.split(inner, 1)
    unasked = inner.startswith('"') and _quoted(cell_value(cell)) != inner
    return f"{before}{_quoted(value, always=unasked)}{after}"


def _quoted(value: str, *, always: bool = False) -> str:
    """Return a value in quotes where it needs them, or always."""
    if not (value or always):
        return ""  # a row of one field that is blank would be quoted
    text = io.StringIO()
    csv.writer(
        text, lineterminator="", quoting=csv.QUOTE_ALL if always else csv.QUOTE_MINIMAL
    ).writerow([value])
    return text.getvalue()
