"""A CSV file with a header, read strictly and by columns: complaints name file, line and column."""

from __future__ import annotations

import csv
import io
from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, cast

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import not_utf8, open_input
from anaplot.textfiles.kinds import Fields, Kind, WrongValueError
from anaplot.textfiles.wording import hint, place, quoted, reason

__all__ = ["MAX_CSV_BYTES", "CsvColumns", "csv_text", "read_csv"]

MAX_CSV_BYTES = 256_000_000

_BLOCK = 1 << 20  # characters that are held as text at a time
_ROWS = 1 << 14  # rows that are made text at a time
_BLANKS = " \t\v\f\r\x1c\x1d\x1e\x1f"  # all that strip takes of ASCII text, but for line ends
_QUOTED = ('"', ",", "\n", "\r")


class CsvColumns:
    """The columns of a CSV file: lists of one length, by name.

    Parameters
    ----------
    path
        The file.
    columns
        Values by the name of the column.
    starts
        (row, line) where the lines begin to differ from the rows by another number.
    header
        The columns that the file has, in its order.
    """

    def __init__(
        self,
        path: Path,
        columns: Mapping[str, list[Any]],
        starts: Sequence[tuple[int, int]],
        header: Sequence[str],
    ) -> None:
        self.header = tuple(header)
        self._path = path
        self._columns = columns
        self._starts = starts

    def __len__(self) -> int:
        return len(next(iter(self._columns.values())))

    def __getitem__(self, name: str) -> list[Any]:
        return self._columns[name]

    def line(self, row: int) -> int:
        """Return the line of a row (from 0)."""
        first, line = self._starts[bisect_right(self._starts, (row, MAX_CSV_BYTES)) - 1]
        return line + row - first

    def fail(self, row: int | None, column: str | None, message: str) -> InputError:
        """Return the error about a field, a row, or the file."""
        return _fault(self._path, None if row is None else self.line(row), column, message)

    def refuse_twice(self, *key: str) -> None:
        """Refuse two rows that agree in some columns; raises InputError that names both lines."""
        columns = [self._columns[name] for name in key]
        if len(set(zip(*columns, strict=True))) == len(self):
            return
        first: dict[tuple[Any, ...], int] = {}
        for row, values in enumerate(zip(*columns, strict=True)):
            other = first.setdefault(values, row)
            if other != row:
                inside = zip(key[1:], values[1:], strict=True)
                where = "".join(f" in {name} {quoted(value)}" for name, value in inside if value)
                lines = f"(lines {self.line(other)} and {self.line(row)})"
                raise self.fail(row, None, f"{key[0]} {quoted(values[0])} twice{where} {lines}")


def read_csv(
    path: Path,
    required: Fields,
    optional: Fields | None = None,
    either: Sequence[Fields] = (),
) -> CsvColumns:
    """Read a CSV file of declared columns, which may stand in any order.

    Blanks around fields and blank lines are left out.

    Parameters
    ----------
    path
        The file.
    required, optional
        Kind of every column that must be there, and that may be: None in every row where it is
        left out.
    either
        Groups of columns of which one must be there, whole, and none of the others.

    Raises
    ------
    InputError
        The file cannot be read, its header does not name the columns, a row has another length
        than the header, a quote is not closed in its line, or a field is not of its kind.
    """
    kinds = {**required, **(optional or {})}
    for group in either:
        kinds |= group
    columns: dict[str, list[Any]] = {name: [] for name in kinds}
    starts: list[tuple[int, int]] = [(0, 2)]
    count = 0
    with io.TextIOWrapper(open_input(path, MAX_CSV_BYTES), encoding="utf-8-sig") as file:
        blocks = _blocks(path, file)
        header = _header(path, next(blocks, (1, [""]))[1][0], kinds, required, either)
        for number, block in blocks:
            for first, lines in _between_blank_lines(number, block):
                starts.append((count, first))
                texts = dict(zip(header, _columns(path, first, lines, len(header)), strict=True))
                for name, values in _values(path, first, texts, kinds).items():
                    columns[name] += values
                count += len(lines)
    for name in kinds.keys() - set(header):
        columns[name] = [None] * count
    return CsvColumns(path, columns, starts, header)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as the text of a CSV file; numbers with the digits that read back exactly."""
    out = [_rows_text([header])]
    left = iter(rows)
    while some := list(islice(left, _ROWS)):
        out.append(_rows_text(some))
    return "".join(out)


def _rows_text(rows: Sequence[Sequence[object]]) -> str:
    """Return rows as text, column by column; quoted are only those with a field that needs it."""
    columns = [_texts(column) for column in zip(*rows, strict=True)]
    joined = "".join(map("".join, columns))
    if len(columns) > 1 and not any(mark in joined for mark in _QUOTED):
        return "\n".join([*map(",".join, zip(*columns, strict=True)), ""])
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(zip(*columns, strict=True))
    return text.getvalue()


def _texts(column: Sequence[object]) -> Sequence[str]:
    """Return what stands in the fields of a column."""
    kinds = set(map(type, column))
    if kinds == {str}:
        return cast("Sequence[str]", column)
    if kinds == {float}:
        return list(map(repr, column))
    return ["" if v is None else repr(float(v)) if isinstance(v, float) else str(v) for v in column]


def _blocks(path: Path, file: io.TextIOWrapper) -> Iterator[tuple[int, list[str]]]:
    """Yield the lines of a file, many at a time, and the number of the first."""
    number = 1
    try:
        text = file.readline()
        while text:
            lines = text.removesuffix("\n").split("\n")
            yield number, lines
            number += len(lines)
            text = file.read(_BLOCK) + file.readline()
    except UnicodeDecodeError:
        raise not_utf8(path, _line_not_utf8(path)) from None
    except OSError as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error


def _between_blank_lines(first: int, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield lines that follow each other, and the number of the first."""
    begin = 0
    for at in [at for at, line in enumerate(lines) if not line or line.isspace()]:
        if at > begin:
            yield first + begin, lines[begin:at]
        begin = at + 1
    if begin < len(lines):
        yield first + begin, lines[begin:]


def _columns(path: Path, first: int, lines: list[str], width: int) -> list[list[str]]:
    """Return the fields of lines by column."""
    # a mark between lines: where it is every field behind width others, all have as many
    text = ",\n,".join(lines)
    fields = text.split(",") if '"' not in text else []
    if len(fields) == (width + 1) * len(lines) - 1 and set(fields[width :: width + 1]) <= {"\n"}:
        step = width + 1
    else:
        fields, step = [], width
        for number, line in enumerate(lines, first):
            row = _fields(path, number, line)
            if len(row) != width:
                count = "1 field" if len(row) == 1 else f"{len(row)} fields"
                raise _fault(path, number, None, f"{count}, the header has {width}")
            fields += row
    columns = [fields[column::step] for column in range(width)]
    if text.isascii() and not any(blank in text for blank in _BLANKS):
        return columns
    return [list(map(str.strip, column)) for column in columns]


def _fields(path: Path, number: int, line: str) -> list[str]:
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line], strict=True, skipinitialspace=True))
    except csv.Error as error:
        message = f"not a CSV row: {reason(error)}"
        if "unexpected end" in message:
            message = "a quotation mark is not closed in its line"
        raise _fault(path, number, None, message) from None


def _header(
    path: Path, line: str, known: Fields, required: Fields, either: Sequence[Fields]
) -> list[str]:
    if either:
        # what is there of the groups says which is meant; nothing: the first
        there = {field.strip() for field in _fields(path, 1, line)}
        first = next((group for group in either if there & group.keys()), either[0])
        required = {**required, **first}
    names = [field.strip() for field in _fields(path, 1, line)]
    message = ""
    if not any(names):
        message = f"no header: {','.join(required)} expected"
    elif len(names) == 1 and (";" in names[0] or "\t" in names[0]):
        message = "columns must be separated by commas"
    else:
        message = _column_fault(names, known)
        for group in either:
            stray = next((name for name in names if name in group and name not in required), None)
            if stray is not None:
                meant = " or ".join(",".join(one) for one in either)
                message = message or f"column {quoted(stray)}: either {meant}"
        for name in required:
            if name not in names:
                message = message or f"no column {quoted(name)}"
    if message:
        raise _fault(path, 1, None, message)
    return names


def _column_fault(names: list[str], known: Fields) -> str:
    seen: set[str] = set()
    for name in names:
        if name not in known:
            return f"unknown column {quoted(name)}{hint(name, known)}"
        if name in seen:
            return f"column {quoted(name)} twice"
        seen.add(name)
    return ""


def _values(
    path: Path, first: int, texts: Mapping[str, list[str]], kinds: Fields
) -> dict[str, list[Any]]:
    """Return the values of some rows by column; the fault of the first row that has one."""
    found: dict[str, list[Any]] = {}
    wrong: list[tuple[int, str, str]] = []
    for name, column in texts.items():
        try:
            found[name] = kinds[name].column(column)
        except WrongValueError:
            wrong.append(_first_wrong(name, kinds[name], column))
    if wrong:
        row, name, message = min(wrong, key=lambda fault: fault[0])
        raise _fault(path, first + row, name, message)
    return found


def _first_wrong(name: str, kind: Kind[Any], column: Sequence[str]) -> tuple[int, str, str]:
    for row, text in enumerate(column):
        try:
            kind.of_text(text)
        except WrongValueError as error:
            return row, name, str(error)
    raise AssertionError(f"column {name}: a kind refuses together what it takes one by one")


def _fault(path: Path, line: int | None, column: str | None, message: str) -> InputError:
    where = f"{column}: " if column else ""
    return InputError(f"{place(path, line)}: {where}{message}")


def _line_not_utf8(path: Path) -> int | None:
    """Return the line that is not UTF-8: the decoder only knows where its buffer began."""
    with open_input(path, MAX_CSV_BYTES) as file:
        for number, raw in enumerate(file, start=1):
            try:
                raw.decode("utf-8")
            except UnicodeDecodeError:
                return number
    return None
