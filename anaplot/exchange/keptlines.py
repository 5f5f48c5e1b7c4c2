"""A file that keeps what is done of long work: JSON, one line each, what is asked first.

A line that was torn off by a crash is cut; one that is damaged in another way is refused by its
number. A file that does not begin with this work's first line, or a part of it, is left as it is.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import place, plain, reason

__all__ = ["KeptLines"]

Row = TypeVar("Row")


class KeptLines(Generic[Row]):
    """What is done, open for more; use it as a context manager.

    Parameters
    ----------
    path
        The file; made when it does not exist, else a regular file.
    head
        What is asked; an existing file must say the same.

    Raises
    ------
    InputError
        The file cannot be read or written, is damaged, or belongs to other work.

    Attributes
    ----------
    rows
        What is done.
    """

    what: ClassVar[str]
    """What it is that is done, in a word."""

    longest: ClassVar[int] = 4 * 1024 * 1024
    """Bytes of a line, at most."""

    largest: ClassVar[int] = 256 * 1024 * 1024
    """Bytes of the file, at most."""

    def __init__(self, path: Path, head: dict[str, Any]) -> None:
        self._path = path
        self.rows: tuple[Row, ...] = ()
        length = 0
        try:
            if path.exists():
                data = read_bytes(path, self.largest)
                length = data.rfind(b"\n") + 1
                if length == 0 and not _line(head).startswith(data):
                    raise InputError(
                        f"{place(path, 1)}: not a {self.what}'s file, and not overwritten; "
                        "name another file"
                    )
                self.rows = self._read(data[:length], head)
            self._file = path.open("ab")
        except OSError as error:
            raise InputError(f"{place(path)}: {reason(error)}") from None
        try:
            self._file.truncate(length)  # what a crash left of a line that was not finished
            if length == 0:
                self._write(head)
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def _row(self, value: dict[str, Any], where: str) -> Row:
        """Return what a line says; raises InputError that begins with `where`."""
        raise NotImplementedError

    def _write(self, value: dict[str, Any]) -> None:
        """Write a line; it is on disk when this returns."""
        try:
            self._file.write(_line(value))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InputError(f"{place(self._path)}: {reason(error)}") from None

    def _read(self, data: bytes, head: dict[str, Any]) -> tuple[Row, ...]:
        rows = []
        for number, line in enumerate(data.splitlines(keepends=True), 1):
            where = place(self._path, number)
            value = self._parsed(line, where)
            if number == 1:
                self._same(value, head, where)
            else:
                rows.append(self._row(value, where))
        return tuple(rows)

    def _parsed(self, line: bytes, where: str) -> dict[str, Any]:
        if len(line) > self.longest:
            raise InputError(f"{where}: longer than {self.longest} bytes")
        try:
            value = json.loads(line.decode("utf-8"))
        except (ValueError, RecursionError):
            raise InputError(f"{where}: not a line of a {self.what}'s file") from None
        if not isinstance(value, dict):
            raise InputError(f"{where}: not a line of a {self.what}'s file")
        return value

    def _same(self, value: dict[str, Any], head: dict[str, Any], where: str) -> None:
        for key, expected in head.items():
            if value.get(key) != expected:
                said = plain(json.dumps(value.get(key)), 60)
                wanted = plain(json.dumps(expected), 60)
                raise InputError(
                    f"{where}: belongs to another {self.what}: "
                    f"{key} is {said}, asked is {wanted}; name another file"
                )


def _line(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode() + b"\n"
