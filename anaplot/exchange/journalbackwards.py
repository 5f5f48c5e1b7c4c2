"""The latest records of some kinds in a journal, without reading what stands before them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

from anaplot.errors import InputError
from anaplot.exchange.journalread import MAX_FILE_BYTES, numbered_files
from anaplot.exchange.recordline import SESSIONS, DamagedLineError, JournalRecord, decode_line
from anaplot.textfiles.inputfile import read_bytes
from anaplot.textfiles.wording import place, reason

__all__ = ["latest_records"]


def latest_records(folder: Path, kinds: Iterable[str]) -> Iterator[JournalRecord]:
    """Yield the records of some kinds of a block's journal, the latest first.

    Lines that are none are passed over: whoever opens the journal has verified it.

    Parameters
    ----------
    folder
        The block folder.
    kinds
        Wanted.

    Raises
    ------
    InputError
        A file cannot be read.
    """
    wanted = tuple(kinds)
    numbered, _ = numbered_files(folder / SESSIONS)
    for number in sorted(numbered, reverse=True):
        yield from _backwards(numbered[number], wanted)


def _backwards(path: Path, kinds: tuple[str, ...]) -> Iterator[JournalRecord]:
    name = place(path)
    try:
        data = read_bytes(path, MAX_FILE_BYTES)
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {reason(error)}") from error
    marks = [b'"kind":"%s"' % kind.encode("ascii") for kind in kinds]
    found = [data.rfind(mark) for mark in marks]
    while (at := max(found, default=-1)) >= 0:
        begin = data.rfind(b"\n", 0, at) + 1
        stop = data.find(b"\n", at)
        # each is looked for again before the line only where it was found in it
        found = [
            there if there < begin else data.rfind(mark, 0, begin)
            for there, mark in zip(found, marks, strict=True)
        ]
        try:
            line = data.count(b"\n", 0, begin) + 1
            record, _ = decode_line(data[begin : stop if stop >= 0 else None], name, line)
        except DamagedLineError:
            continue
        if record.kind in kinds:
            yield record
