"""The records of a verified journal, read from the disk where they are asked for."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.journalread import MAX_FILE_BYTES, FileScan, scan_journal
from anaplot.exchange.recordline import (
    MAX_LINE,
    OPENING,
    DamagedLineError,
    JournalRecord,
    Keep,
    decode_line,
)
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, reason

__all__ = ["StoredRecords"]


class StoredRecords:
    """The records of a journal, of which one at a time is there; those of headers are kept.

    Parameters
    ----------
    path
        A block folder, its folder `sessions`, or a single file of it. It is verified now; what is
        added afterwards is none of it.
    keep
        Says that a kind is known; all are.

    Attributes
    ----------
    openings
        Those of headers.
    remarks
        What of the journal was left out: a torn end, files that are none of it.

    Raises
    ------
    InputError
        As `read_journal`.
    """

    def __init__(self, path: Path, keep: Keep) -> None:
        openings: list[JournalRecord] = []

        def take(record: JournalRecord) -> None:
            if record.kind in OPENING:
                openings.append(record)

        scan = scan_journal(path, keep, take)
        self._files: Sequence[FileScan] = scan.files
        self.openings: Sequence[JournalRecord] = openings
        self.remarks = scan.remarks

    def __len__(self) -> int:
        return sum(file.lines for file in self._files)

    def __iter__(self) -> Iterator[JournalRecord]:
        """Yield them in order; raises InputError where a file is not what it was."""
        for file in self._files:
            yield from _records(file)


def _records(file: FileScan) -> Iterator[JournalRecord]:
    name = place(file.path)
    line, left = 0, file.good_bytes
    try:
        with open_input(file.path, MAX_FILE_BYTES) as lines:
            for line in range(1, file.lines + 1):
                raw = lines.readline(min(MAX_LINE, left))
                left -= len(raw)
                record, _ = decode_line(raw.removesuffix(b"\n"), name, line)
                yield record
    except DamagedLineError as damage:
        raise InputError(f"{name} line {line}: changed while it was read: {damage}") from None
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {reason(error)}") from error
