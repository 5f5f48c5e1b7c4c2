"""Reading a journal: every line verified, nothing changed."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import BinaryIO, NamedTuple

from anaplot.errors import InputError
from anaplot.exchange.eventcodec import event_from_payload
from anaplot.exchange.journalsnapshot import Snapshot, snapshots_of
from anaplot.exchange.recordline import (
    JOURNAL_FORMAT,
    MAX_LINE,
    OPENING,
    SESSIONS,
    DamagedLineError,
    JournalRecord,
    Keep,
    UnknownKindError,
    claimed_format,
    decode_line,
    was_confirmed,
)
from anaplot.session.events import Event
from anaplot.textfiles.inputfile import open_input
from anaplot.textfiles.wording import place, plain, reason

__all__ = [
    "MAX_FILE_BYTES",
    "Begin",
    "Choice",
    "FileScan",
    "Recovered",
    "Scan",
    "Tail",
    "Take",
    "check_format",
    "event_of",
    "folder_of",
    "journal_files",
    "numbered_files",
    "read_journal",
    "scan_folder",
    "scan_journal",
]

MAX_FILE_BYTES = 256_000_000
"""Largest file that is read: four times the length at which the next one is begun."""

_BEGINNING = b'{"seq":'
_FILE_NAME = re.compile(r"([0-9]{4,99})\.jsonl")


Choice = Callable[[Iterable[Snapshot]], Snapshot | None]
"""Chooses from snapshots that can be trusted, youngest first."""

Take = Callable[[JournalRecord], object]
"""Is given every wanted record as it is read: a long journal is never there as a whole."""


Begin = Callable[[Snapshot | None], Take]
"""Returns what takes the records behind a snapshot, or, of None, all of them."""


class _Behind(NamedTuple):
    """Up to where a file is known: its length, lines, CRC-32 there; the last sequence number."""

    size: int
    lines: int
    crc: int
    seq: int


@dataclass(frozen=True, slots=True)
class Recovered:
    """What a journal held.

    Attributes
    ----------
    records
        The records in order, those left out whose kind was not wanted.
    remarks
        Sentences for the operator: a torn tail, a file that does not belong here.
    """

    records: tuple[JournalRecord, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Tail:
    """What a power cut or a killed writer left behind the good lines of the last file.

    Attributes
    ----------
    line
        Where it begins.
    why
        What is wrong with the line there.
    whole
        How many whole records stand behind that line, of which nobody was told that they are
        on disk.
    """

    line: int
    why: str
    whole: int

    def __str__(self) -> str:
        behind = {0: "", 1: ", and with it 1 whole record that was never confirmed"}
        return self.why + behind.get(
            self.whole, f", and with it {self.whole} whole records that were never confirmed"
        )


@dataclass(frozen=True, slots=True)
class FileScan:
    """One verified file.

    Attributes
    ----------
    path
        The file.
    good_bytes
        Length of its good lines.
    total_bytes
        Its length when it was looked at.
    last_seq
        Sequence number of the last good record in it, or before it; 0 before the first.
    tail
        What follows the good lines, or None.
    lacks_end
        The last record is whole but for the end of its line.
    lines, crc
        Number and CRC-32 of its good lines.
    """

    path: Path
    good_bytes: int
    total_bytes: int
    last_seq: int
    tail: Tail | None
    lacks_end: bool
    lines: int
    crc: int


@dataclass(frozen=True, slots=True)
class Scan:
    """All files of a journal, verified."""

    files: tuple[FileScan, ...]
    records: tuple[JournalRecord, ...]
    remarks: tuple[str, ...]


def read_journal(path: Path, *, keep: Keep | None = None) -> Recovered:
    """Read a journal without a lock and without changing it, also while it is written.

    Parameters
    ----------
    path
        A block folder, its folder `sessions`, or a single file of it.
    keep
        Which kinds of records are wanted (all, when left out); the others are verified too.

    Raises
    ------
    InputError
        There is no journal, it is damaged where it was on disk already, a record or a file is
        missing, or a newer version wrote it; with file and line.
    """
    records: list[JournalRecord] = []
    scan = scan_journal(path, keep, records.append)
    return Recovered(tuple(records), scan.remarks)


def scan_journal(path: Path, keep: Keep | None, take: Take, known: Sequence[FileScan] = ()) -> Scan:
    """Read a journal as `read_journal` does, and hand its records on one by one.

    What is wrong behind them is found when they were handed on.

    Parameters
    ----------
    path, keep
        As `read_journal` has them.
    take
        Is given the wanted records.
    known
        The first files, as they were when they were read before: what is known of them is not read
        again.

    Returns
    -------
    Scan
        The files, without the records; the remarks tell of a torn tail, too.

    Raises
    ------
    InputError
        As `read_journal`.
    """
    folder = folder_of(path)
    if folder is None:
        reader = _FileReader(path, None, keep, take)
        behind = _end_of(known[0]) if known else None
        scan = Scan((reader.scan(is_last=True, behind=behind),), (), ())
    else:
        scan = scan_folder(folder, keep, begin=lambda _: take, known=known)
        if not scan.files:
            raise InputError(f"{place(folder)}: holds no journal (0001.jsonl): it was never opened")
    last = scan.files[-1]
    if last.tail is None:
        return scan
    torn = f"{place(last.path, last.tail.line)}: {last.tail}: left out"
    return replace(scan, remarks=(*scan.remarks, torn))


def _end_of(file: FileScan) -> _Behind:
    return _Behind(file.good_bytes, file.lines, file.crc, file.last_seq)


def event_of(record: JournalRecord) -> Event:
    """Return the session event that a record is.

    Raises
    ------
    InputError
        It is no such event, with file and line.
    """
    try:
        return event_from_payload(record.kind, record.payload)
    except InputError as error:
        raise InputError(f"{record.file} line {record.line}: {error}") from None


def folder_of(path: Path) -> Path | None:
    """Return the folder of the journal that a path stands for; None for a single file.

    Raises
    ------
    InputError
        There is nothing of that name.
    """
    try:
        folder = path / SESSIONS if (path / SESSIONS).is_dir() else path
        if folder.is_dir():
            return folder
        if path.exists():
            return None
    except (OSError, ValueError) as error:
        raise InputError(f"{place(path)}: cannot be read: {reason(error)}") from error
    raise InputError(f"{place(path)}: no such journal")


def journal_files(path: Path) -> tuple[Path, ...]:
    """Return the files of the journal that a path stands for; errors as `folder_of` has them."""
    folder = folder_of(path)
    return (path,) if folder is None else tuple(numbered_files(folder)[0].values())


def numbered_files(folder: Path) -> tuple[dict[int, Path], tuple[str, ...]]:
    """Return the files of a journal by their numbers, and remarks on others that look like them.

    Raises
    ------
    InputError
        The folder cannot be read.
    """
    try:
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise InputError(f"{place(folder)}: cannot be read: {reason(error)}") from error
    numbered: dict[int, Path] = {}
    remarks: list[str] = []
    for name in names:
        match = _FILE_NAME.fullmatch(name)
        if match is not None and name == f"{int(match[1]):04d}.jsonl":
            numbered[int(match[1])] = folder / name
        elif name.endswith(".jsonl"):
            remarks.append(
                f"{plain(str(folder / name), 120)}: not a file of this journal, not read"
            )
    return numbered, tuple(remarks)


def scan_folder(
    folder: Path,
    keep: Keep | None,
    choose: Choice | None = None,
    *,
    begin: Begin | None = None,
    known: Sequence[FileScan] = (),
) -> Scan:
    """Verify all files of a journal in order.

    What stands before a snapshot that is chosen is verified by its checksum, and no record of it
    returned.

    Parameters
    ----------
    folder
        The folder `sessions`.
    keep, known
        As `scan_journal` has them.
    choose
        Chooses the snapshot behind which records are wanted.
    begin
        Is asked before they are read what takes them; where nobody does, they are returned.

    Raises
    ------
    InputError
        As `read_journal`, but that a folder without files is fine.
    """
    numbered, remarks = numbered_files(folder)
    files = list(known[:-1])
    records: list[JournalRecord] = []
    last_number = max(numbered, default=0)
    for expected, number in enumerate(sorted(numbered), 1):
        if number != expected:
            missing = place(folder / f"{expected:04d}.jsonl")
            raise InputError(f"{missing}: is missing, but there is {numbered[number].name}")
    chosen = _chosen([numbered[number] for number in sorted(numbered)], choose)
    behind = _end_of(known[-1]) if known else None
    if chosen is not None:
        paths = (numbered[number] for number in sorted(numbered))
        files = [_known(*pair) for pair in zip(paths, chosen.before, strict=False)]
        behind = _Behind(chosen.size, chosen.lines, chosen.crc, chosen.seq)
    take = records.append if begin is None else begin(chosen)
    seq = 0
    for number in sorted(numbered)[len(files) :]:
        reader = _FileReader(numbered[number], seq, keep, take)
        files.append(reader.scan(is_last=number == last_number, behind=behind))
        seq, behind = files[-1].last_seq, None
    return Scan(tuple(files), tuple(records), remarks)


def _chosen(paths: list[Path], choose: Choice | None) -> Snapshot | None:
    if choose is None or not paths:
        return None
    try:
        return choose(snapshots_of(paths, MAX_FILE_BYTES))
    except (OSError, InputError):
        return None  # whoever reads the lines says what is wrong


def _known(path: Path, before: tuple[int, int]) -> FileScan:
    """Return what is known of a file before that of a snapshot: only its bytes were looked at."""
    size, crc = before
    return FileScan(path, size, size, 0, None, False, 0, crc)


def check_format(number: object, file: str, line: int) -> None:
    """Refuse a journal of a format that is not read; raises InputError."""
    if not isinstance(number, int) or isinstance(number, bool) or number < JOURNAL_FORMAT:
        raise InputError(f"{file} line {line}: not a journal of a known format")
    if number > JOURNAL_FORMAT:
        raise InputError(
            f"{file} line {line}: written by a newer version of anaplot: this one reads journals "
            f"of format {JOURNAL_FORMAT}"
        )


def _nothing(kind: str) -> bool:
    """Want no payload."""
    return False


class _Wanted(dict[str, bool]):
    """Of which kinds the payload is wanted: each is asked about once, not with every line.

    Parameters
    ----------
    keep
        Says which kinds are wanted; None: all.
    """

    def __init__(self, keep: Keep | None) -> None:
        super().__init__()
        self._keep = keep

    def __missing__(self, kind: str) -> bool:
        wanted = self._keep is None or kind in OPENING or self._keep(kind)
        return self.setdefault(kind, wanted)


class _FileReader:
    """One pass through one file.

    Parameters
    ----------
    path
        The file.
    seq
        Sequence number before its first record; None when any will do.
    keep
        Which kinds are wanted.
    take
        Is given the wanted records.
    """

    def __init__(self, path: Path, seq: int | None, keep: Keep | None, take: Take) -> None:
        self._path = path
        self._name = place(path)
        self._seq = seq
        self._keep = keep
        self._wanted: Keep = _Wanted(keep).__getitem__
        self._take = take

    def scan(self, *, is_last: bool, behind: _Behind | None = None) -> FileScan:
        try:
            with open_input(self._path, MAX_FILE_BYTES) as file:
                return self._scan(file, is_last, behind)
        except OSError as error:
            raise InputError(f"{self._name}: cannot be read: {reason(error)}") from error

    def _scan(self, file: BinaryIO, is_last: bool, behind: _Behind | None) -> FileScan:
        # The length now is the end: whoever writes meanwhile is not half seen.
        size = os.fstat(file.fileno()).st_size
        good = line = crc = 0
        if behind is not None:
            good, line, crc, self._seq = behind.size, behind.lines, behind.crc, behind.seq
            os.lseek(file.fileno(), good, os.SEEK_SET)  # nothing of it was read yet
        whole = line
        tail: Tail | None = None
        lacks_end = False
        while good < size:
            raw = file.readline(min(MAX_LINE, size - good))
            line += 1
            lacks_end = not raw.endswith(b"\n")
            try:
                record, wanted = decode_line(
                    raw if lacks_end else raw[:-1], self._name, line, self._wanted
                )
            except DamagedLineError as damage:
                claimed = claimed_format(raw) if line == 1 else None
                if claimed is not None:
                    check_format(claimed, self._name, line)
                if not is_last:
                    raise self._damaged(line, damage) from None
                tail, lacks_end = self._tail(file, raw, line, size - good, damage), False
                break
            except UnknownKindError as error:
                raise self._fail(line, str(error)) from None
            seq, kind = record.seq, record.kind
            if line == 1 or kind in OPENING:
                self._check_opening(record)
            if self._seq is not None and seq != self._seq + 1:
                raise self._fail(line, f"record {seq} where {self._seq + 1} should follow")
            self._seq = seq
            if wanted and (kind not in OPENING or self._keep is None or self._keep(kind)):
                self._take(record)
            good += len(raw)
            crc = zlib.crc32(raw, crc)
            whole = line
        if line == 0 and not is_last:
            raise InputError(f"{self._name}: is empty, but files follow it")
        return FileScan(self._path, good, size, self._seq or 0, tail, lacks_end, whole, crc)

    def _check_opening(self, record: JournalRecord) -> None:
        """Check the first record, and those that say in which format what follows is."""
        if record.line == 1 and record.kind != "header":
            raise self._fail(record.line, "the header is missing")
        if record.line > 1 and record.kind == "header":
            raise self._fail(record.line, "a second header")
        check_format(record.payload.get("format", 0), self._name, record.line)

    def _tail(
        self, file: BinaryIO, raw: bytes, line: int, left: int, damage: DamagedLineError
    ) -> Tail:
        """Return what follows the good lines, when nobody was told that it is on disk.

        Records are written one behind the other, each after the one before was acknowledged. A
        record that says that it is durable is therefore on disk, with all before it, when
        anything stands behind it. When it is the last, a power cut may have come before it was
        acknowledged: such a cut leaves zeros, where another damage leaves other bytes.
        Records of older versions do not say it and count as durable. A line that was changed,
        neither torn nor zeros, is damage whatever whole record stands behind it, and, where it was
        durable or has been given another end, also where none does.

        Parameters
        ----------
        file, raw, line
            The file, and the first line that is no record, just read from it; its number.
        left
            Length of the file from the beginning of that line.
        damage
            What is wrong with it.
        """
        if line == 1 and not (raw.startswith((_BEGINNING, b"\0")) or _BEGINNING.startswith(raw)):
            raise self._fail(line, "not a journal: left as it is")
        left -= len(raw)
        whole, zeros, changed = 0, True, False
        for number in count(line):
            raw, left, has_zeros = self._to_its_end(file, raw, left)
            record = self._record(raw, number)
            if isinstance(record, DamagedLineError):
                whole_text = raw.endswith(b"\n") and not has_zeros
                if whole_text and (was_confirmed(raw[:-1]) or raw.endswith(b"\r\n")):
                    raise self._damaged(line, damage)
                zeros = zeros and has_zeros
                changed = changed or (record.changed and not has_zeros)
                # The beginning of a line may be zeros, and a record stand whole behind them.
                record = self._record(raw.rpartition(b"\0")[2], number)
            if isinstance(record, JournalRecord):
                whole += 1
                known = record.durable is not False and (left > 0 or not zeros)
                if known or changed:
                    raise self._damaged(line, damage)
            if left <= 0:
                break
            raw = file.readline(min(MAX_LINE, left))
            left -= len(raw)
        return Tail(line, str(damage), whole)

    def _record(self, raw: bytes, line: int) -> JournalRecord | DamagedLineError:
        try:
            return decode_line(raw.removesuffix(b"\n"), self._name, line, _nothing)[0]
        except DamagedLineError as error:
            return error

    @staticmethod
    def _to_its_end(file: BinaryIO, raw: bytes, left: int) -> tuple[bytes, int, bool]:
        """Read a line to its end; return its last bytes, what is left, and whether it has zeros."""
        zeros = b"\0" in raw
        while left > 0 and not raw.endswith(b"\n"):
            more = file.readline(min(MAX_LINE, left))
            if not more:
                return raw, 0, zeros  # shorter than it was
            left -= len(more)
            zeros = zeros or b"\0" in more
            raw = (raw + more)[-MAX_LINE:]
        return raw, left, zeros

    def _damaged(self, line: int, damage: DamagedLineError) -> InputError:
        return self._fail(
            line,
            f"damaged: {damage}; nothing was changed "
            "(anaplot replay --salvage brings over what can be read)",
        )

    def _fail(self, line: int, message: str) -> InputError:
        return InputError(f"{self._name} line {line}: {message}")
