"""A CSV file with a header, read strictly and by columns: complaints name file, line and column."""

from __future__ import annotations

import csv
import io
import math
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, cast

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import not_utf8, open_input
from anaplot.textfiles.kinds import Fields, Kind, WrongValueError
from anaplot.textfiles.wording import hint, place, quoted, reason

__all__ = ["MAX_CSV_BYTES", "CsvColumns", "csv_text", "csv_text_of_columns", "read_csv"]

MAX_CSV_BYTES = 256_000_000

_READ = 1 << 20  # characters that are read at a time
_BLOCK = 1 << 15  # characters that are taken apart at a time: their fields stay in the cache
_ROWS = 1 << 14  # rows that are made text at a time
_BLANKS = " \t\v\f\r\x1c\x1d\x1e\x1f"  # all that strip takes of ASCII text, but for line ends
_QUOTED = ('"', ",", "\n", "\r")


class NumberColumn:
    """A column of numbers; NaN where a field is blank."""

    def __init__(self, kind: Kind[Any]) -> None:
        self.kind = kind
        self.numbers: array[float] = array("d")

    def take(self, texts: Sequence[str]) -> None:
        """Add the values of further fields; raises WrongValueError."""
        self.numbers += self.kind.numbers(texts)

    def listed(self) -> list[Any]:
        """Return the value of every row."""
        # no kind takes NaN for a number
        return [None if number != number else number for number in self.numbers]


class CodedColumn:
    """A column of names or words: each value once, and which of them every row has."""

    def __init__(self, kind: Kind[Any]) -> None:
        self.kind = kind
        self.values: list[Any] = []
        self.index: array[int] = array("q")
        self._codes = _Codes(kind, self.values)

    def take(self, texts: Sequence[str]) -> None:
        """Add the values of further fields; raises WrongValueError."""
        if texts[0] == texts[-1] and texts.count(texts[0]) == len(texts):
            self.index.extend(array("q", [self._codes[texts[0]]]) * len(texts))
        else:
            self.index.extend(map(self._codes.__getitem__, texts))

    def listed(self) -> list[Any]:
        """Return the value of every row."""
        return list(map(self.values.__getitem__, self.index))


class _Codes(dict[str, int]):
    """Where the value of a field stands among the values; a new field is looked at once."""

    def __init__(self, kind: Kind[Any], values: list[Any]) -> None:
        super().__init__()
        self._kind, self._values = kind, values

    def __missing__(self, text: str) -> int:
        self._values.append(self._kind.of_text(text))
        code = self[text] = len(self._values) - 1
        return code


def _blank(kind: Kind[Any], count: int) -> CodedColumn | NumberColumn:
    """Return a column that the file does not have."""
    if kind.numeric:
        numbers = NumberColumn(kind)
        numbers.numbers = array("d", [math.nan]) * count
        return numbers
    column = CodedColumn(kind)
    column.values.append(None)
    column.index = array("q", [0]) * count
    return column


class CsvColumns:
    """The columns of a CSV file, all of one length, by name.

    Parameters
    ----------
    path
        The file.
    columns
        What stands in them, by name.
    starts
        (row, line) where the lines begin to differ from the rows by another number.
    header
        The columns that the file has, in its order.
    count
        Number of rows.
    """

    def __init__(
        self,
        path: Path,
        columns: Mapping[str, CodedColumn | NumberColumn],
        starts: Sequence[tuple[int, int]],
        header: Sequence[str],
        count: int,
    ) -> None:
        self.header = tuple(header)
        self._path = path
        self._columns = columns
        self._starts = starts
        self._count = count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, name: str) -> list[Any]:
        return self._columns[name].listed()

    def numbers(self, name: str) -> array[float]:
        """Return a column of numbers; NaN where a field is blank."""
        column = self._columns[name]
        if isinstance(column, CodedColumn):
            raise TypeError(f"column {name} is none of numbers")
        return column.numbers

    def coded(self, name: str) -> tuple[tuple[Any, ...], array[int]]:
        """Return the values of a column of names or words, and which of them each row has.

        They stand in the order of their first rows.
        """
        column = self._columns[name]
        if not isinstance(column, CodedColumn):
            raise TypeError(f"column {name} is one of numbers")
        return tuple(column.values), column.index

    def line(self, row: int) -> int:
        """Return the line of a row (from 0)."""
        first, line = self._starts[bisect_right(self._starts, (row, MAX_CSV_BYTES)) - 1]
        return line + row - first

    def fail(self, row: int | None, column: str | None, message: str) -> InputError:
        """Return the error about a field, a row, or the file."""
        return _fault(self._path, None if row is None else self.line(row), column, message)

    def refuse_twice(self, *key: str) -> None:
        """Refuse two rows that agree in some columns; raises InputError that names both lines."""
        columns = [self[name] for name in key]
        if len(set(zip(*columns, strict=True))) == len(self):
            return
        first: dict[tuple[Any, ...], int] = {}
        for row, values in enumerate(zip(*columns, strict=True)):
            other = first.setdefault(values, row)
            if other != row:
                inside = zip(key[1:], values[1:], strict=True)
                where = "".join(f" in {name} {_said(value)}" for name, value in inside if value)
                lines = f"(lines {self.line(other)} and {self.line(row)})"
                raise self.fail(row, None, f"{key[0]} {_said(values[0])} twice{where} {lines}")


def _said(value: Any) -> str:
    return quoted(value) if isinstance(value, str) else f"{value:g}"


def read_csv(
    path: Path,
    required: Fields,
    optional: Fields | None = None,
    either: Sequence[Fields] = (),
    raw: bytes | None = None,
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
    raw
        What stands in the file; None: it is opened.

    Raises
    ------
    InputError
        The file cannot be read, its header does not name the columns, a row has another length
        than the header, a quote is not closed in its line, or a field is not of its kind.
    """
    kinds = {**required, **(optional or {})}
    for group in either:
        kinds |= group
    starts: list[tuple[int, int]] = [(0, 2)]
    count = 0
    source = open_input(path, MAX_CSV_BYTES) if raw is None else io.BytesIO(raw)
    with io.TextIOWrapper(source, encoding="utf-8-sig") as file:
        blocks = _blocks(path, file)
        header = _header(path, next(blocks, (1, ""))[1], kinds, required, either)
        columns = {
            name: NumberColumn(kinds[name]) if kinds[name].numeric else CodedColumn(kinds[name])
            for name in header
        }
        for number, text in blocks:
            for first, rows, fields in _parts(path, number, text, len(header)):
                starts.append((count, first))
                _take(path, first, columns, fields)
                count += rows
    for name in kinds.keys() - columns.keys():
        columns[name] = _blank(kinds[name], count)
    return CsvColumns(path, columns, starts, header, count)


def csv_text(header: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return rows as the text of a CSV file; numbers with the digits that read back exactly."""
    out = [_text([[name] for name in header])]
    left = iter(rows)
    while some := list(islice(left, _ROWS)):
        out.append(_text(list(zip(*some, strict=True))))
    return "".join(out)


def csv_text_of_columns(
    header: Sequence[str], count: int, columns: Callable[[slice], Sequence[Sequence[object]]]
) -> str:
    """Return `count` rows as the text of a CSV file, as `csv_text`, from some rows of each column.

    Parameters
    ----------
    header
        Names of the columns.
    count
        How many rows there are.
    columns
        Returns of each column what stands in some rows.
    """
    parts = (columns(slice(first, first + _ROWS)) for first in range(0, count, _ROWS))
    return "".join([_text([[name] for name in header]), *map(_text, parts)])


def _text(values: Sequence[Sequence[object]]) -> str:
    """Return columns as text; quoted are only the rows with a field that needs it."""
    columns = [_texts(column) for column in values]
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


def _blocks(path: Path, file: io.TextIOWrapper) -> Iterator[tuple[int, str]]:
    """Yield the lines of a file, many at a time, and the number of the first."""
    number = 1
    try:
        text = file.readline()
        while text:
            begin = 0
            while begin < len(text):
                end = text.find("\n", begin + _BLOCK) + 1 or len(text)
                block = text[begin:end]
                yield number, block.removesuffix("\n")
                number += block.count("\n")
                begin = end
            text = file.read(_READ) + file.readline()
    except UnicodeDecodeError:
        raise not_utf8(path, _line_not_utf8(path)) from None
    except OSError as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error


def _parts(
    path: Path, number: int, text: str, width: int
) -> Iterator[tuple[int, int, list[list[str]]]]:
    """Yield lines between blank ones: number of the first, how many, their fields by column."""
    columns = _plain_columns(text, width)
    if columns is not None:
        yield number, len(columns[0]), columns
        return
    for first, lines in _between_blank_lines(number, text.split("\n")):
        part = "\n".join(lines)
        columns = _plain_columns(part, width) or _careful_columns(path, first, lines, width)
        yield first, len(lines), columns


def _between_blank_lines(first: int, lines: list[str]) -> Iterator[tuple[int, list[str]]]:
    """Yield lines that follow each other, and the number of the first."""
    begin = 0
    for at in [at for at, line in enumerate(lines) if not line or line.isspace()]:
        if at > begin:
            yield first + begin, lines[begin:at]
        begin = at + 1
    if begin < len(lines):
        yield first + begin, lines[begin:]


def _plain_columns(text: str, width: int) -> list[list[str]] | None:
    """Return the fields of lines by column; None where that takes a look at every line."""
    if '"' in text or width == 1:
        return None
    # a mark between lines: where it is every field behind width others, all have as many
    fields = text.replace("\n", ",\n,").split(",")
    step = width + 1
    if len(fields) % step != width:
        return None
    marks = fields[width::step]
    if marks.count("\n") != len(marks) or len(marks) != text.count("\n"):
        return None
    return _stripped(text, [fields[column::step] for column in range(width)])


def _careful_columns(path: Path, first: int, lines: list[str], width: int) -> list[list[str]]:
    """Return the fields of lines by column, looked at line by line."""
    rows = []
    for number, line in enumerate(lines, first):
        row = _fields(path, number, line)
        if len(row) != width:
            count = "1 field" if len(row) == 1 else f"{len(row)} fields"
            raise _fault(path, number, None, f"{count}, the header has {width}")
        rows.append(row)
    return _stripped("\n".join(lines), [list(column) for column in zip(*rows, strict=True)])


def _stripped(text: str, columns: list[list[str]]) -> list[list[str]]:
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


def _take(
    path: Path,
    first: int,
    columns: Mapping[str, CodedColumn | NumberColumn],
    fields: Sequence[Sequence[str]],
) -> None:
    """Add the values of some rows to the columns; the fault of the first row that has one."""
    wrong: list[tuple[int, str, str]] = []
    for (name, column), texts in zip(columns.items(), fields, strict=True):
        try:
            column.take(texts)
        except WrongValueError:
            wrong.append(_first_wrong(name, column.kind, texts))
    if wrong:
        row, name, message = min(wrong, key=lambda fault: fault[0])
        raise _fault(path, first + row, name, message)


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
