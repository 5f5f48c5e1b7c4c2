"""The file in which a simulation keeps the chunks that are done: JSON, one line each.

The first line says what is simulated, every other one holds the sums of a chunk. A line that was
torn off by a crash is cut; a line that is damaged in another way, or holds sums that the simulation
cannot have, is refused by its number. A file that does not begin with the first line of this
simulation, or a part of it, is left as it is.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from anaplot.errors import InputError
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.kinds import Items, Keys, ListOf, Number, Text, Whole, WrongValueError
from anaplot.textfiles.wording import place, plain, quoted, reason

__all__ = ["RUNS_FORMAT", "KeptChunk", "KeptSums", "RunsFile"]

RUNS_FORMAT = 1
_LARGEST = 256 * 1024 * 1024
_LONGEST = 4 * 1024 * 1024
_ROUNDING = 1e-9
_NAME, _SUM = Text(200), Number(0.0)

Name = tuple[str, str, str]


class KeptSums(NamedTuple):
    """A case's, a method's and a quantity's number of runs, sum and sum of squares."""

    case: str
    method: str
    quantity: str
    runs: int
    total: float
    squares: float


class KeptChunk(NamedTuple):
    """A chunk that is done."""

    number: int
    runs: int
    sums: tuple[KeptSums, ...]


class RunsFile:
    """A file of chunks, open for more; use it as a context manager.

    Parameters
    ----------
    path
        The file; made when it does not exist, else a regular file.
    what
        What is simulated; an existing file must say the same.
    largest
        What every chunk holds sums of, (case, method, quantity), and the largest value of a run;
        None: no bound. No value is negative.
    chunk
        The largest number of runs of a chunk.

    Raises
    ------
    InputError
        The file cannot be read or written, is damaged, or belongs to another simulation.
    """

    def __init__(
        self, path: Path, what: dict[str, Any], largest: Mapping[Name, float | None], chunk: int
    ) -> None:
        self._path, self._largest = path, largest
        runs = Whole(1, chunk)
        row = Items(_NAME, _NAME, _NAME, runs, _SUM, _SUM)
        self._line_kind = Keys(
            {"chunk": Whole(0, 2**53), "runs": runs, "sums": ListOf(row, "sums")}
        )
        head = {"format": RUNS_FORMAT, **what}
        self.chunks: tuple[KeptChunk, ...] = ()
        length = 0
        try:
            if path.exists():
                data = read_bytes(path, _LARGEST)
                length = data.rfind(b"\n") + 1
                if length == 0 and not _line(head).startswith(data):
                    raise InputError(
                        f"{place(path, 1)}: not a simulation's file, and not overwritten; "
                        "name another file"
                    )
                self.chunks = self._chunks(data[:length], head)
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

    def __enter__(self) -> RunsFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def keep(self, chunk: KeptChunk) -> None:
        """Write a chunk; it is on disk when this returns.

        Raises
        ------
        InputError
            It could not be written.
        """
        self._write(
            {"chunk": chunk.number, "runs": chunk.runs, "sums": [list(s) for s in chunk.sums]}
        )

    def _write(self, value: dict[str, Any]) -> None:
        try:
            self._file.write(_line(value))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise InputError(f"{place(self._path)}: {reason(error)}") from None

    def _chunks(self, data: bytes, head: dict[str, Any]) -> tuple[KeptChunk, ...]:
        chunks = []
        for number, line in enumerate(data.splitlines(keepends=True), 1):
            value = self._parsed(line, number)
            if number == 1:
                self._same(value, head)
            else:
                chunks.append(self._chunk(value, number))
        return tuple(chunks)

    def _parsed(self, line: bytes, number: int) -> dict[str, Any]:
        where = place(self._path, number)
        if len(line) > _LONGEST:
            raise InputError(f"{where}: longer than {_LONGEST} bytes")
        try:
            value = json.loads(line.decode("utf-8"))
        except (ValueError, RecursionError):
            raise InputError(f"{where}: not a line of a simulation's file") from None
        if not isinstance(value, dict):
            raise InputError(f"{where}: not a line of a simulation's file")
        return value

    def _same(self, value: dict[str, Any], head: dict[str, Any]) -> None:
        for key, expected in head.items():
            if value.get(key) != expected:
                said = plain(json.dumps(value.get(key)), 60)
                wanted = plain(json.dumps(expected), 60)
                raise InputError(
                    f"{place(self._path, 1)}: belongs to another simulation: "
                    f"{key} is {said}, asked is {wanted}; name another file"
                )

    def _chunk(self, value: dict[str, Any], number: int) -> KeptChunk:
        where = place(self._path, number)
        try:
            read = self._line_kind.of(value)
        except WrongValueError as error:
            raise InputError(f"{where}: {plain(error.placed(), 200)}") from None
        index, runs = read["chunk"], read["runs"]
        found = tuple(KeptSums(*row) for row in read["sums"])
        names = [of[:3] for of in found]
        for of in found:
            if of[:3] not in self._largest:
                said = ", ".join(quoted(part) for part in of[:3])
                raise InputError(f"{where}: sums of {said}, which is not in this simulation")
            if of.runs != runs:
                raise InputError(f"{where}: {of.runs} is not the chunk's {runs} runs")
            if not _possible(of, self._largest[of[:3]]):
                values = quoted(json.dumps([of.total, of.squares]))
                raise InputError(f"{where}: {values} are no sums of values of {runs} runs")
        if len(names) != len(set(names)) or len(names) != len(self._largest):
            raise InputError(
                f"{where}: {len(names)} sums, {len(set(names))} of them different; "
                f"this simulation has {len(self._largest)}"
            )
        return KeptChunk(index, runs, found)


def _possible(of: KeptSums, largest: float | None) -> bool:
    """Tell whether there are values of 0 to `largest` with this sum and sum of squares."""
    more = 1.0 + _ROUNDING
    if of.total * of.total > of.runs * of.squares * more:
        return False
    return largest is None or (
        of.total <= of.runs * largest * more and of.squares <= largest * of.total * more
    )


def _line(value: dict[str, Any]) -> bytes:
    return json.dumps(value, allow_nan=False, separators=(",", ":")).encode() + b"\n"
