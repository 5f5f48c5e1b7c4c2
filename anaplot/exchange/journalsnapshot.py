"""Snapshots in a journal: what the events before led to, and a checksum of all that stands before.

A snapshot is a record `snapshot` behind its `snapshot-part` records, which hold its text in pieces.
Whoever trusts one has read every byte before it: they are what they were when it was written, by a
writer that had verified them. One that is torn, damaged, of another version or of another block is
passed over: the events say the same.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from anaplot.exchange.recordline import (
    JOURNAL_FORMAT,
    MAX_LINE,
    DamagedLineError,
    JournalRecord,
    decode_line,
)
from anaplot.textfiles.inputfile import open_input, read_bytes

__all__ = [
    "PART",
    "SNAPSHOT",
    "VERSION",
    "VERSIONS",
    "Before",
    "Snapshot",
    "parts_of",
    "said_of",
    "snapshots_of",
    "text_of",
]

SNAPSHOT = "snapshot"
PART = "snapshot-part"

VERSION = 4
"""Of what the text says; it rises when the state that it stands for has another form."""

VERSIONS = (3, VERSION)
"""Those that are read. 3: models computed anew stand with all models of the block."""

_PART_CHARACTERS = 500_000
_MAX_TEXT = 200_000_000
_MARK = b'"kind":"snapshot"'
_CHUNK = 1 << 20

Before = tuple[int, int]
"""Length and CRC-32 of a file, or of what of it stands before a record."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One snapshot, and where the journal goes on behind it.

    Attributes
    ----------
    text
        What it says.
    block
        Digest of the block of which it says it.
    events
        How many events stand before it.
    size, lines, crc
        Length of the file up to its end, number of lines, CRC-32.
    seq
        Its sequence number.
    before
        Length and checksum of the files before its own.
    """

    text: str
    block: str
    events: int
    size: int
    lines: int
    crc: int
    seq: int
    before: tuple[Before, ...]


def parts_of(text: str) -> list[tuple[str, dict[str, Any]]]:
    """Return the records that hold a text."""
    packed = base64.b64encode(zlib.compress(text.encode("ascii"), 1)).decode("ascii")
    cuts = range(0, len(packed), _PART_CHARACTERS)
    return [(PART, {"text": packed[at : at + _PART_CHARACTERS]}) for at in cuts]


def text_of(parts: Sequence[JournalRecord]) -> str | None:
    """Return the text that records hold; None when it is none."""
    pieces = [record.payload.get("text") for record in parts]
    try:
        packed = base64.b64decode("".join(str(piece) for piece in pieces), validate=True)
        unpacking = zlib.decompressobj()
        data = unpacking.decompress(packed, _MAX_TEXT)
        return data.decode("ascii") if unpacking.eof else None
    except (zlib.error, binascii.Error, ValueError):
        return None


def said_of(
    block: str, events: int, parts: int, part_bytes: int, lines: int, before: Sequence[Before]
) -> dict[str, Any]:
    """Return the payload of a snapshot.

    Parameters
    ----------
    block
        Digest of the block.
    events
        How many events stand before it.
    parts, part_bytes
        Number and length of the lines right before it that hold its text.
    lines
        Number of lines before it in its file.
    before
        Length and checksum of every file before, and of its own up to it.
    """
    return {
        "version": VERSION,
        "format": JOURNAL_FORMAT,
        "block": block,
        "events": events,
        "parts": parts,
        "part_bytes": part_bytes,
        "lines": lines,
        "before": [list(one) for one in before],
    }


def snapshots_of(paths: Sequence[Path], max_bytes: int) -> Iterator[Snapshot]:
    """Yield the snapshots of a journal that can be trusted, youngest first.

    Parameters
    ----------
    paths
        The files, in order.
    max_bytes
        Largest file that is read.

    Raises
    ------
    OSError, InputError
        A file cannot be read.
    """
    sums: list[list[int]] = []
    for count in range(len(paths), 0, -1):
        yield from _of_last(paths[:count], max_bytes, sums)


def _of_last(paths: Sequence[Path], max_bytes: int, sums: list[list[int]]) -> Iterator[Snapshot]:
    """Yield those of the last of some files; `sums` are those of files, made when first needed."""
    data = read_bytes(paths[-1], max_bytes)
    end = len(data)
    while (at := data.rfind(_MARK, 0, end)) >= 0:
        begin = end = data.rfind(b"\n", 0, at) + 1
        stop = data.find(b"\n", at) + 1
        record = _record(data[begin : stop - 1]) if 0 < stop - begin <= MAX_LINE else None
        if record is None or record.kind != SNAPSHOT or not _of_this_form(record):
            continue
        sums += [_summed(path, max_bytes) for path in paths[len(sums) : -1]]
        found = _trusted(record, data, begin, stop, sums[: len(paths) - 1])
        if found is not None:
            yield found


def _of_this_form(record: JournalRecord) -> bool:
    said = record.payload
    return bool(said.get("version") in VERSIONS and said.get("format") == JOURNAL_FORMAT)


def _trusted(
    record: JournalRecord, data: bytes, begin: int, stop: int, earlier: list[list[int]]
) -> Snapshot | None:
    said = record.payload
    numbers = [said.get(key) for key in ("events", "parts", "part_bytes", "lines")]
    events, parts, length, lines = (n if type(n) is int and n >= 0 else -1 for n in numbers)
    block = said.get("block")
    if min(events, parts, length, lines) < 0 or length > begin or not isinstance(block, str):
        return None
    crc = zlib.crc32(memoryview(data)[:begin])
    if said.get("before") != [*earlier, [begin, crc]]:
        return None
    records = [_record(raw) for raw in data[begin - length : begin].splitlines()]
    held = [part for part in records if part is not None and part.kind == PART]
    if len(held) != parts or len(records) != parts:
        return None
    text = text_of(held)
    if text is None:
        return None
    return Snapshot(
        text=text,
        block=block,
        events=events,
        size=stop,
        lines=lines + 1,
        crc=zlib.crc32(memoryview(data)[begin:stop], crc),
        seq=record.seq,
        before=tuple((size, crc) for size, crc in earlier),
    )


def _record(raw: bytes) -> JournalRecord | None:
    try:
        return decode_line(raw, "", 0)[0]
    except DamagedLineError:
        return None


def _summed(path: Path, max_bytes: int) -> list[int]:
    size = crc = 0
    with open_input(path, max_bytes) as file:
        while chunk := file.read(_CHUNK):
            size, crc = size + len(chunk), zlib.crc32(chunk, crc)
    return [size, crc]
