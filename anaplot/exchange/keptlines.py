"""A file that keeps what is done of long work: JSON, one line each, what is asked first.

A line that was torn off by a crash is cut; one that is damaged in another way is refused by its
number. A file that does not begin with this work's first line, or a part of it, is left as it is.
"""

from __future__ import annotations

import contextlib
import json
import os
from itertools import count
from pathlib import Path
from typing import Any, ClassVar, Generic, Self, TypeVar

from anaplot.errors import InputError
from anaplot.exchange.lockfile import lock_open
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wholefile import write_all
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
        The file cannot be read or written, is damaged, belongs to other work, or is written by
        somebody else just now.

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
        try:
            if path.exists():
                open_input(path, self.largest).close()  # never waits for what is no file
            self._file = path.open("ab", buffering=0)
        except OSError as error:
            raise InputError(f"{place(path)}: {reason(error)}") from None
        try:
            self._lock()  # before it is read: what another one writes would be cut
            self._length = self._read(head)
            self._file.truncate(self._length)  # what a crash left of a line that was not finished
            if self._length == 0:
                self._write(head, "what is asked")
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

    def _lock(self) -> None:
        try:
            lock_open(self._file.fileno())
        except BlockingIOError:
            raise InputError(
                f"{place(self._path)}: another anaplot writes into it; name another file"
            ) from None
        except OSError as error:
            raise InputError(f"{place(self._path)}: cannot be locked: {reason(error)}") from None

    def _write(self, value: dict[str, Any], called: str) -> None:
        """Write a line; it is on disk when this returns.

        Nothing is written that would be refused when it is read; `called`: what it says, for that.
        """
        line = _line(value)
        if len(line) > self.longest:
            raise InputError(
                f"{place(self._path)}: {called} has {len(line)} bytes, a line has at most "
                f"{self.longest}: it cannot be kept"
            )
        if self._length + len(line) > self.largest:
            raise InputError(
                f"{place(self._path)}: is full before {called}, at most {self.largest} bytes; "
                "name another file for less"
            )
        try:
            write_all(self._file.fileno(), line)
            os.fsync(self._file.fileno())
        except OSError as error:
            with contextlib.suppress(OSError):
                self._file.truncate(self._length)
            raise InputError(f"{place(self._path)}: {reason(error)}") from None
        self._length += len(line)

    def _read(self, head: dict[str, Any]) -> int:
        """Read the rows, line by line; return the length of all lines that are whole."""
        rows: list[Row] = []
        length = 0
        with open_input(self._path, self.largest) as file:
            for number in count(1):
                line = file.readline(self.longest + 1)
                where = place(self._path, number)
                if len(line) <= self.longest and not line.endswith(b"\n"):
                    if number == 1 and not _line(head).startswith(line):
                        raise InputError(self._another(where))
                    break
                if number == 1 and len(line) > self.longest:
                    raise InputError(self._another(where))
                value = self._parsed(line, where)
                if number == 1:
                    self._same(value, head, where)
                else:
                    rows.append(self._row(value, where))
                length += len(line)
        self.rows = tuple(rows)
        return length

    def _another(self, where: str) -> str:
        return f"{where}: not a {self.what}'s file, and not overwritten; name another file"

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
