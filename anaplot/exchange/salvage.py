"""What can still be read of a damaged journal, and what cannot.

`read_journal` takes a journal whole or not at all; here every line stands for itself.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from anaplot.errors import InputError
from anaplot.exchange.journalkinds import is_known
from anaplot.exchange.journalread import MAX_FILE_BYTES, check_format, folder_of, numbered_files
from anaplot.exchange.recordline import (
    MAX_LINE,
    OPENING,
    DamagedLineError,
    JournalRecord,
    UnknownKindError,
    claimed_format,
    decode_line,
)
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, reason

__all__ = ["Gap", "Readable", "read_what_can_be_read"]


@dataclass(frozen=True, slots=True)
class Gap:
    """Something that is missing from a journal.

    Attributes
    ----------
    file
        The file, or the one that is not there.
    first_line, last_line
        The lines that cannot be read; None where records are missing and no line is damaged.
    first_seq, last_seq
        The records that are missing; None behind the last one that can be read, where nobody
        knows how many there were.
    why
        What is wrong.
    """

    file: str
    first_line: int | None
    last_line: int | None
    first_seq: int | None
    last_seq: int | None
    why: str

    def __str__(self) -> str:
        lines = _range("line", self.first_line, self.last_line)
        records = _range("record", self.first_seq, self.last_seq)
        where = f"{self.file} {lines}" if lines else self.file
        return f"{where}: {self.why}" + (f": {records} missing" if records else "")


@dataclass(frozen=True, slots=True)
class Readable:
    """What can be read: the records of every file, and what is missing, in order."""

    files: tuple[tuple[JournalRecord, ...], ...]
    gaps: tuple[Gap, ...]

    @property
    def lost_before(self) -> frozenset[int]:
        """Sequence numbers of the records before which others are missing."""
        return frozenset(gap.last_seq + 1 for gap in self.gaps if gap.last_seq is not None)


def read_what_can_be_read(path: Path) -> Readable:
    """Read every whole record of a journal, whatever stands between them.

    Parameters
    ----------
    path
        A block folder, its folder `sessions`, or a single file of it.

    Raises
    ------
    InputError
        There is no journal, nothing of it can be read, or a newer version wrote it.
    """
    folder = folder_of(path)
    gaps: list[Gap] = []
    if folder is None:
        paths = [path]
    else:
        numbered, _ = numbered_files(folder)
        paths = [numbered[number] for number in sorted(numbered)]
        for number in sorted(numbered):
            if number > 1 and number - 1 not in numbered:
                missing = place(folder / f"{number - 1:04d}.jsonl")
                gaps.append(Gap(missing, None, None, None, None, "the file is missing"))
    files: list[tuple[JournalRecord, ...]] = []
    seq = 0
    for file in paths:
        records, found = _read(file, seq)
        files.append(records)
        gaps.extend(found)
        seq = records[-1].seq if records else seq
    if not any(files):
        raise InputError(f"{place(path)}: no record of a journal can be read in it")
    return Readable(tuple(files), tuple(gaps))


def _read(path: Path, seq: int) -> tuple[tuple[JournalRecord, ...], list[Gap]]:
    """Read a file that follows upon a record of given number."""
    name = place(path)
    records: list[JournalRecord] = []
    gaps: list[Gap] = []
    bad: list[tuple[int, str]] = []  # lines that cannot be read since the last one that can
    try:
        with open_input(path, MAX_FILE_BYTES) as file:
            for line, raw in _lines(file):
                record, why = _whole(raw, name, line)
                if why:
                    bad.append((line, why))
                if record is None:
                    continue
                if record.seq <= seq:
                    bad.append((line, f"record {record.seq} where {seq + 1} should follow"))
                    continue
                if bad or record.seq != seq + 1:
                    gaps.append(_gap(name, bad, seq + 1, record.seq - 1))
                    bad = []
                records.append(record)
                seq = record.seq
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {reason(error)}") from error
    if bad:
        gaps.append(_gap(name, bad, None, None))
    return tuple(records), gaps


def _lines(file: BinaryIO) -> Iterator[tuple[int, bytes]]:
    """Yield number and content of each line; of one that is too long for a record, its end."""
    left = os.fstat(file.fileno()).st_size
    line = 0
    while left > 0:
        line += 1
        raw = b""
        while left > 0 and not raw.endswith(b"\n"):
            more = file.readline(min(MAX_LINE, left))
            left = left - len(more) if more else 0
            raw = (raw + more)[-MAX_LINE:]
        yield line, raw


def _whole(raw: bytes, name: str, line: int) -> tuple[JournalRecord | None, str]:
    """Return the record of a line, and what is wrong with the line."""
    raw = raw.removesuffix(b"\n").removesuffix(b"\r")
    why = ""
    # A record may stand whole behind the zeros of those before it.
    for part in (raw, raw.rpartition(b"\0")[2]):
        try:
            record, _ = decode_line(part, name, line)
        except DamagedLineError as damage:
            why = why or str(damage)
            continue
        if record.kind in OPENING:
            check_format(record.payload.get("format", 0), name, line)
        try:
            is_known(record.kind)
        except UnknownKindError as error:
            raise InputError(f"{name} line {line}: {error}") from None
        return record, why
    claimed = claimed_format(raw) if line == 1 else None
    if claimed is not None:
        check_format(claimed, name, line)
    return None, why


def _gap(name: str, bad: list[tuple[int, str]], first_seq: int | None, last_seq: int | None) -> Gap:
    if first_seq is not None and last_seq is not None and last_seq < first_seq:
        first_seq = last_seq = None
    if not bad:
        return Gap(name, None, None, first_seq, last_seq, "a part is not there")
    return Gap(name, bad[0][0], bad[-1][0], first_seq, last_seq, bad[0][1])


def _range(what: str, first: int | None, last: int | None) -> str:
    if first is None or last is None:
        return ""
    return f"{what} {first}" if first == last else f"{what}s {first} to {last}"
