"""The file that keeps what was computed of many blocks: JSON, one line a block.

The first line says what is computed, every other one holds the answer of a block and a digest of
that block: one that has changed meanwhile is computed again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.keptlines import KeptLines
from anaplot.textfiles.kinds import AnyTable, Flag, Keys, Text, WrongValueError
from anaplot.textfiles.wording import plain, quoted

__all__ = ["ANSWERS_FORMAT", "AnswersFile", "KeptAnswer"]

ANSWERS_FORMAT = 1

_LINE = Keys({"digest": Text(64, empty=False), "flagged": Flag(), "answer": AnyTable()})


class KeptAnswer(NamedTuple):
    """The digest of a block, whether something is flagged in it, and what `--json` prints."""

    digest: str
    flagged: bool
    answer: dict[str, Any]


class AnswersFile(KeptLines[KeptAnswer]):
    """A file of answers, open for more; see `KeptLines`."""

    what = "computation"
    longest = 256 * 1024 * 1024
    largest = 4 * 1024 * 1024 * 1024

    def __init__(self, path: Path, what: dict[str, Any]) -> None:
        super().__init__(path, {"format": ANSWERS_FORMAT, **what})

    def keep(self, one: KeptAnswer, block: str) -> None:
        """Write an answer; it is on disk when this returns. `block`: what messages call it.

        Raises
        ------
        InputError
            It could not be written, or is too large.
        """
        self._write(one._asdict(), f"the answer of {quoted(block)}")

    def _row(self, value: dict[str, Any], where: str) -> KeptAnswer:
        try:
            return KeptAnswer(**_LINE.of(value))
        except WrongValueError as error:
            raise InputError(f"{where}: {plain(error.placed(), 200)}") from None
