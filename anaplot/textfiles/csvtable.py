"""A CSV file with a header, read strictly and quickly: complaints name file, line and column."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import not_utf8, open_input
from anaplot.textfiles.wording import hint, place, quoted, reason

__all__ = ["MAX_CSV_BYTES", "CsvTable"]

MAX_CSV_BYTES = 256_000_000


class CsvTable:
    """An open CSV file; a context manager.

    Parameters
    ----------
    path
        The file.
    required, optional
        Names of its columns, which may stand in any order.

    Raises
    ------
    InputError
        The file cannot be read, or its header does not name the columns.
    """

    def __init__(self, path: Path, required: Sequence[str], optional: Sequence[str]) -> None:
        self._path = path
        self._file = io.TextIOWrapper(
            open_input(path, MAX_CSV_BYTES), encoding="utf-8-sig", newline=""
        )
        try:
            self._reader = csv.reader(self._file, strict=True, skipinitialspace=True)
            self._line = 0
            header = self._header(required, optional)
        except BaseException:
            self._file.close()
            raise
        self.columns: dict[str, int] = {name: index for index, name in enumerate(header)}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[tuple[int, list[str]]]:
        """Yield line number and fields, blanks around them removed; blank lines are left out.

        Raises
        ------
        InputError
            A row of another length than the header, a quote that is not closed, a byte that is
            not UTF-8.
        """
        width = len(self.columns)
        while (row := self._next()) is not None:
            if len(row) != width:
                if len(row) <= 1 and not "".join(row).strip():
                    continue
                raise self.fail(self._line, f"{_fields(len(row))}, the header has {width}")
            yield self._line, [field.strip() for field in row]

    def fail(self, line: int | None, message: str) -> InputError:
        """Return the error about a line."""
        return InputError(f"{place(self._path, line)}: {message}")

    def number(self, line: int, column: str, text: str) -> float:
        """Return the finite decimal number that a field holds.

        Raises
        ------
        InputError
            The field is empty or holds no such number.
        """
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        # float() also takes 1_000, other scripts' digits, "nan" and what overflows.
        if math.isfinite(value) and text.isascii() and "_" not in text:
            return value
        if not text:
            raise self.fail(line, f"{column} is empty")
        raise self.fail(line, f"{column} = {quoted(text)} is not a finite number")

    def _next(self) -> list[str] | None:
        first = self._line = self._reader.line_num + 1
        try:
            row = next(self._reader)
        except StopIteration:
            return None
        except csv.Error as error:
            if self._reader.line_num > first:
                raise self._open_quote(first) from None
            raise self.fail(first, f"not a CSV row: {reason(error)}") from None
        except UnicodeDecodeError:
            raise not_utf8(self._path, self._line_not_utf8()) from None
        except OSError as error:
            raise InputError(f"{place(self._path)}: cannot be read: {reason(error)}") from error
        if self._reader.line_num > first:
            raise self._open_quote(first)
        return row

    def _open_quote(self, line: int) -> InputError:
        return self.fail(line, "a quotation mark is not closed in its line")

    def _header(self, required: Sequence[str], optional: Sequence[str]) -> list[str]:
        row = self._next()
        names = [] if row is None else [field.strip() for field in row]
        if not any(names):
            self._refuse_header(f"no header: {','.join(required)} expected")
        if len(names) == 1 and (";" in names[0] or "\t" in names[0]):
            self._refuse_header("columns must be separated by commas")
        known = (*required, *optional)
        for index, name in enumerate(names):
            if name not in known:
                self._refuse_header(f"unknown column {quoted(name)}{hint(name, known)}")
            if name in names[:index]:
                self._refuse_header(f"column {quoted(name)} twice")
        for name in required:
            if name not in names:
                self._refuse_header(f"column {quoted(name)} is missing")
        return names

    def _refuse_header(self, message: str) -> NoReturn:
        raise self.fail(self._line, message)

    def _line_not_utf8(self) -> int | None:
        """Return the line that is not UTF-8: the decoder only knows where its buffer began."""
        with open_input(self._path, MAX_CSV_BYTES) as file:
            for number, raw in enumerate(file, start=1):
                try:
                    raw.decode("utf-8")
                except UnicodeDecodeError:
                    return number
        return None


def _fields(count: int) -> str:
    return "1 field" if count == 1 else f"{count} fields"
