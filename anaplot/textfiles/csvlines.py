"""The lines of a CSV file as they stand: their ends, blank lines, blanks and quotes of fields."""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple, Self

__all__ = ["CsvLine", "CsvLines", "cell_value", "cells_of", "quoted_cell", "with_value"]

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

    @classmethod
    def of(cls, raw: str) -> Self:
        """Return a line with the blank ones before it."""
        *above, line = _lines_of(raw) or [""]
        text = line.rstrip("\r\n")
        return cls("".join(above), text, line[len(text) :])

    @property
    def raw(self) -> str:
        """The line with the blank ones before it, as it stands."""
        return f"{self.above}{self.text}{self.end}"


class CsvLines(NamedTuple):
    """The text of a CSV file by lines.

    Attributes
    ----------
    mark
        The byte order mark, where there is one.
    header
        Its first line.
    rows
        The line of every row with the blank ones before it, as it stands; also the last has an end.
    below
        Blank lines at the end.
    ended
        Whether the last line has an end in the text.
    """

    mark: str
    header: CsvLine
    rows: list[str]
    below: str
    ended: bool

    @classmethod
    def of(cls, text: str) -> Self:
        """Return the lines of a text that `read_csv` takes."""
        mark = _MARK if text.startswith(_MARK) else ""
        header, *rows = _lines_of(text[len(mark) :]) or [""]
        below = ""
        if any(map(str.isspace, rows)):
            rows, below = _behind_blank_lines(rows)
        lines = cls(mark, CsvLine.of(header), rows, below, ended=True)
        if CsvLine.of(rows[-1] if rows else header).end:
            return lines
        end = lines.end
        if rows:
            rows[-1] += end
        else:
            lines = lines._replace(header=lines.header._replace(end=end))
        return lines._replace(ended=False)

    @property
    def end(self) -> str:
        """How most of its lines end."""
        if not self.header.end.startswith("\r") and not any("\r" in raw for raw in self.rows):
            return "\n"
        ends = Counter((self.header.end, *(CsvLine.of(raw).end for raw in self.rows)))
        del ends[""]
        return ends.most_common(1)[0][0]

    def with_rows(self, header: str, rows: Sequence[str]) -> str:
        """Return the text with another header and other rows; the last line ends as it did."""
        lines = [self.header._replace(text=header).raw, *rows]
        if not self.ended:
            lines[-1] = CsvLine.of(lines[-1])._replace(end="").raw
        return "".join((self.mark, *lines, self.below))


def _lines_of(text: str) -> list[str]:
    """Return the lines of a text with their ends."""
    return io.StringIO(text, newline="").readlines()


def _behind_blank_lines(lines: list[str]) -> tuple[list[str], str]:
    """Return lines with the blank ones before each, and the blank ones at the end."""
    out: list[str] = []
    above = ""
    for line in lines:
        if line.isspace():
            above += line
        else:
            out.append(above + line)
            above = ""
    return out, above


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
    return _unquoted(cell).strip() if '"' in cell else cell.strip()


def with_value(cell: str, value: str) -> str:
    """Return a field that says something else; blanks around it stay, and quotes without need.

    Before a quote only spaces are passed over, and nothing behind it: where quotes are needed,
    other blanks stand within them.
    """
    inner = cell.lstrip(" ")
    outside = cell[: len(cell) - len(inner)]
    quoted = inner.startswith('"')
    text = _unquoted(inner) if quoted else inner
    said = text.strip()
    before, after = text.split(said, 1) if said else (text, "")
    if quoted_cell(value) != value or (quoted and quoted_cell(said) == said):
        return outside + quoted_cell(f"{before}{value}{after}", always=True)
    return f"{outside}{before}{value}{after}"


def _unquoted(cell: str) -> str:
    return next(csv.reader([cell], skipinitialspace=True))[0]


def quoted_cell(value: str, *, always: bool = False) -> str:
    """Return a value in quotes where it needs them, or always."""
    if not (value or always):
        return ""  # a row of one field that is blank would be quoted
    text = io.StringIO()
    csv.writer(
        text, lineterminator="", quoting=csv.QUOTE_ALL if always else csv.QUOTE_MINIMAL
    ).writerow([value])
    return text.getvalue()
