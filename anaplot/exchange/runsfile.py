"""The file in which a simulation keeps the chunks that are done: JSON, one line each.

The first line says what is simulated, every other one holds the sums of a chunk; sums that the
simulation cannot have are refused by the number of their line.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.keptlines import KeptLines
from anaplot.textfiles.kinds import Items, Keys, ListOf, Number, Text, Whole, WrongValueError
from anaplot.textfiles.wording import plain, quoted

__all__ = ["RUNS_FORMAT", "KeptChunk", "KeptSums", "RunsFile"]

RUNS_FORMAT = 1
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


class RunsFile(KeptLines[KeptChunk]):
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

    what = "simulation"

    def __init__(
        self, path: Path, what: dict[str, Any], largest: Mapping[Name, float | None], chunk: int
    ) -> None:
        self._largest = largest
        runs = Whole(1, chunk)
        row = Items(_NAME, _NAME, _NAME, runs, _SUM, _SUM)
        self._line_kind = Keys(
            {"chunk": Whole(0, 2**53), "runs": runs, "sums": ListOf(row, "sums")}
        )
        super().__init__(path, {"format": RUNS_FORMAT, **what})

    @property
    def chunks(self) -> tuple[KeptChunk, ...]:
        """What was done before."""
        return self.rows

    def keep(self, chunk: KeptChunk) -> None:
        """Write a chunk; it is on disk when this returns.

        Raises
        ------
        InputError
            It could not be written.
        """
        self._write(
            {"chunk": chunk.number, "runs": chunk.runs, "sums": [list(s) for s in chunk.sums]},
            f"chunk {chunk.number}",
        )

    def _row(self, value: dict[str, Any], where: str) -> KeptChunk:
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
