"""The journal of a block: what the operator was told is on disk first."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import threading
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple, Self

from anaplot.errors import InputError
from anaplot.exchange.journalread import (
    Begin,
    Choice,
    FileScan,
    Recovered,
    event_of,
    numbered_files,
    read_journal,
    scan_folder,
)
from anaplot.exchange.journalsnapshot import SNAPSHOT, Before, parts_of, said_of
from anaplot.exchange.lockfile import FolderLock
from anaplot.exchange.recordline import (
    JOURNAL_FORMAT,
    SESSIONS,
    JournalError,
    JournalRecord,
    Keep,
    encode_line,
)
from anaplot.textfiles.ownfile import check_own, is_same, open_own
from anaplot.textfiles.wholefile import sync_folder, write_all
from anaplot.textfiles.wording import place, quoted, reason
from anaplot.version import __version__

__all__ = [
    "Journal",
    "JournalError",
    "JournalRecord",
    "Recovered",
    "event_of",
    "read_journal",
]

ROLL_BYTES = 64_000_000
"""Length from which the next record begins a new file."""

_HEADER_KEYS = frozenset(("program", "version", "format", "goes_on"))
_NO_SPACE = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))
_COPY_BYTES = 1 << 20
_BINARY: int = getattr(os, "O_BINARY", 0)


class _Place(NamedTuple):
    """The end of the journal: open file, its length, sequence number of the last record.

    Also what a snapshot says of all before it: number of lines and CRC-32 of the file.
    """

    descriptor: int
    path: Path
    size: int
    seq: int
    lines: int
    crc: int


class Journal:
    """The one writer of a block's journal; a context manager, and safe to use from many threads.

    Made by `Journal.open`. A record is either in the journal or refused with `JournalError`;
    after a refusal for want of space the journal serves again when there is space.
    """

    def __init__(
        self,
        folder: Path,
        header: Mapping[str, Any],
        clock: Callable[[], float],
        roll_bytes: int,
        lock: FolderLock,
    ) -> None:
        self._folder = folder
        self._header = {
            "program": "anaplot",
            "version": __version__,
            "format": JOURNAL_FORMAT,
            **header,
        }
        self._clock = clock
        self._roll_bytes = roll_bytes
        self._lock = lock
        self._mutex = threading.RLock()
        self._end: _Place | None = None
        self._before: list[Before] = []
        self._unusable = ""

    @classmethod
    def open(
        cls,
        folder: Path,
        header: Mapping[str, Any],
        *,
        clock: Callable[[], float] = time.time,
        keep: Keep | None = None,
        accept: Callable[[Recovered], Mapping[str, Any] | None] | None = None,
        choose: Choice | None = None,
        begin: Begin | None = None,
        roll_bytes: int = ROLL_BYTES,
    ) -> tuple[Self, Recovered]:
        """Lock a block, verify its journal, mend a torn tail and go on where the journal ends.

        Parameters
        ----------
        folder
            The block folder; its folder `sessions` is made when there is none.
        header
            What the header says beyond program, version and format: block, profile and its hash,
            link parameters, operator, start.
        clock
            Seconds since 1970 in UTC, for the records' times.
        keep
            Which kinds of records are wanted in what is recovered (all, when left out).
        accept
            Called with what is recovered before anything is written; what it raises leaves the
            journal as it was, and what it returns is said in the header, too.
        choose
            Chooses the snapshot behind which records are wanted; None: all records are.
        begin
            Is asked before they are read what takes them, one by one; what was recovered then has
            none.
        roll_bytes
            Length of a file from which the next record begins a new one.

        Returns
        -------
        tuple[Journal, Recovered]
            The journal, and what it held before it was opened.

        Raises
        ------
        InputError
            The block is open elsewhere, the journal is damaged where it was on disk already, is
            not what it seems (a link, a pipe) or was written by a newer version (nothing is
            changed then), or it cannot be written.
        """
        for key in header:
            if key in _HEADER_KEYS:
                raise JournalError(f"journal header: the key {quoted(key)} is the journal's own")
        sessions = folder / SESSIONS
        _make_sessions(sessions)
        lock = FolderLock(sessions / "lock")
        journal = cls(sessions, header, clock, roll_bytes, lock)
        try:
            _check_files(sessions)
            _sync_entries(folder)
            scan = scan_folder(sessions, keep, choose, begin=begin)
            if accept is not None:
                with _telling_tail(scan.files):
                    said = accept(Recovered(scan.records, ()))
                journal._header |= said or {}
            remarks = [*scan.remarks, *journal._begin(scan.files)]
        except BaseException:
            journal._leave()
            raise
        return journal, Recovered(scan.records, tuple(remarks))

    @property
    def path(self) -> Path:
        """The file that is written now."""
        return self._place().path

    @property
    def seq(self) -> int:
        """Sequence number of the last record."""
        return self._place().seq

    def append(self, kind: str, payload: Mapping[str, Any], *, durable: bool) -> int:
        """Write one record, and return its sequence number.

        Parameters
        ----------
        kind
            What it is: lower-case letters, digits and hyphens.
        payload
            A JSON object without the keys seq, t, kind, crc.
        durable
            Return only when it is on disk, with all records before it.

        Raises
        ------
        JournalError
            It was refused; the journal is as it was before.
        """
        return self.append_many([(kind, payload)], durable=durable)

    def append_many(
        self, records: Iterable[tuple[str, Mapping[str, Any]]], *, durable: bool
    ) -> int:
        """Write records of given kinds and payloads, all or none.

        Returns
        -------
        int
            Sequence number of the last record of the journal.

        Raises
        ------
        JournalError
            They were refused; the journal is as it was before.
        """
        with self._mutex:
            end = self._place()
            self._check_usable(end)
            if end.size >= self._roll_bytes:
                end = self._roll(end, goes_on=True)
            stamp = self._stamp()
            batch = tuple(records)
            if not batch:
                return end.seq
            data = bytearray()
            seq = end.seq
            for kind, payload in batch:
                seq += 1
                # What comes last is told to be on disk: with all before it.
                last = durable and seq == end.seq + len(batch)
                data += encode_line(seq, stamp, kind, payload, last)
            self._put(end, bytes(data), seq, durable)
            return seq

    def append_snapshot(self, text: str, block: str, events: int) -> None:
        """Write what the records so far led to.

        Parameters
        ----------
        text
            That, in ASCII.
        block
            Digest of the block of which it is said.
        events
            How many events there are so far.

        Raises
        ------
        JournalError
            It was refused; parts that stand alone say nothing.
        """
        with self._mutex:
            parts = parts_of(text)
            self.append_many([], durable=False)  # begin the next file first, when it is time
            start = self._place()
            self.append_many(parts, durable=False)
            end = self._place()
            before = [*self._before, (end.size, end.crc)]
            said = said_of(block, events, len(parts), end.size - start.size, end.lines, before)
            # behind its parts, in the same file
            line = encode_line(end.seq + 1, self._stamp(), SNAPSHOT, said, durable=False)
            self._check_usable(end)
            self._put(end, line, end.seq + 1, durable=False)

    def close(self) -> None:
        """Bring everything to disk and give the block free; a second call does nothing.

        Raises
        ------
        JournalError
            The last records that were not durable could not be brought to disk.
        """
        with self._mutex:
            end = self._end
            try:
                if end is not None:
                    _sync(end.descriptor)
            except OSError as error:
                raise JournalError(
                    f"{place(self._folder)}: the last records may not be on disk: {reason(error)}"
                ) from error
            finally:
                self._leave()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- opening -------------------------------------------------------------------------------

    def _begin(self, files: tuple[FileScan, ...]) -> list[str]:
        """Mend the last file and write the header, or that the journal was opened again."""
        if not files:
            self._end = self._new_file(1, 0)
            return []
        last = files[-1]
        self._before = [(file.good_bytes, file.crc) for file in files[:-1]]
        descriptor, size, remarks = _mended(last)
        crc = zlib.crc32(b"\n" * (size - last.good_bytes), last.crc)
        end = self._end = _Place(descriptor, last.path, size, last.last_seq, last.lines, crc)
        if size >= self._roll_bytes:
            self._roll(end)
        else:
            kind = "opened" if size else "header"
            line = encode_line(end.seq + 1, self._stamp(), kind, self._header, durable=True)
            self._put(end, line, end.seq + 1, durable=True)
        return remarks

    def _new_file(self, number: int, seq: int, goes_on: bool = False) -> _Place:
        """Return a new file that holds its header, on disk; there is none after an error."""
        path = self._file(number)
        header = self._header | ({"goes_on": True} if goes_on else {})
        line = encode_line(seq + 1, self._stamp(), "header", header, durable=True)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_EXCL | _BINARY
        try:
            descriptor = os.open(path, flags, 0o666)
            try:
                write_all(descriptor, line)
                _sync(descriptor)
                sync_folder(self._folder)
            except BaseException:
                os.close(descriptor)
                with contextlib.suppress(OSError):
                    path.unlink()
                raise
        except OSError as error:
            raise JournalError(f"{place(path)}: cannot be written: {reason(error)}") from error
        return _Place(descriptor, path, len(line), seq + 1, 1, zlib.crc32(line))

    # -- writing -------------------------------------------------------------------------------

    def _roll(self, end: _Place, *, goes_on: bool = False) -> _Place:
        """Begin the next file, in which the session goes on or another one begins."""
        try:
            # Before its successor exists: only the last file may have a torn tail.
            _sync(end.descriptor)
        except OSError as error:
            self._sync_failed(end, error)
            raise self._refusal(end, reason(error)) from error
        new = self._end = self._new_file(int(end.path.stem) + 1, end.seq, goes_on)
        self._before.append((end.size, end.crc))
        os.close(end.descriptor)
        return new

    def _put(self, end: _Place, data: bytes, seq: int, durable: bool) -> None:
        """Write lines behind the end, or raise and leave everything as it was."""
        syncing = False
        try:
            written = os.write(end.descriptor, data)
            if written != len(data):
                what = f"only {written} of {len(data)} bytes fitted (is the disk full?)"
                raise OSError(errno.ENOSPC, what)
            if durable:
                syncing = True
                _sync(end.descriptor)
            self._end = end._replace(
                size=end.size + len(data),
                seq=seq,
                lines=end.lines + seq - end.seq,
                crc=zlib.crc32(data, end.crc),
            )
        except BaseException as error:
            # Also when interrupted: what is not acknowledged must not hold a sequence number.
            self._take_back(end)
            if not isinstance(error, OSError):
                raise
            if syncing:
                self._sync_failed(end, error)
            raise self._refusal(end, reason(error)) from error

    def _take_back(self, end: _Place) -> None:
        self._end = end
        try:
            os.ftruncate(end.descriptor, end.size)
        except OSError as error:
            self._unusable = f"a refused record could not be removed ({reason(error)})"

    def _sync_failed(self, end: _Place, error: OSError) -> None:
        # A system that failed to write forgets what it failed with: only want of space is known
        # to leave the records before intact.
        if error.errno not in _NO_SPACE and not self._unusable:
            self._unusable = f"{end.path.name} could not be brought to disk ({reason(error)})"

    def _check_usable(self, end: _Place) -> None:
        if self._unusable:
            raise self._refusal(end, f"{self._unusable}; the block must be opened again")
        try:
            status = os.fstat(end.descriptor)
        except OSError as error:
            raise self._refusal(end, reason(error)) from error
        if status.st_nlink == 0:
            raise self._refusal(end, "the file was removed")
        if status.st_size != end.size:
            raise self._refusal(end, "the file was changed by another program")
        if not is_same(end.path, end.descriptor):
            raise self._refusal(end, "the file was moved away")
        self._check_lock(end)

    def _check_lock(self, end: _Place) -> None:
        """Refuse records when the lock's file was removed and another anaplot came in."""
        try:
            if self._lock.check():
                return
        except InputError as error:
            self._unusable = f"the lock was removed ({error})"
        else:
            if not os.path.lexists(self._file(int(end.path.stem) + 1)):
                return
            self._unusable = "the lock was removed, and another anaplot has written"
        raise self._refusal(end, f"{self._unusable}; the block must be opened again")

    def _file(self, number: int) -> Path:
        return self._folder / f"{number:04d}.jsonl"

    def _refusal(self, end: _Place, why: str) -> JournalError:
        return JournalError(f"{place(end.path)}: record refused: {why}")

    def _stamp(self) -> str:
        try:
            now = datetime.fromtimestamp(self._clock(), UTC)
        except (OverflowError, ValueError, OSError) as error:
            raise JournalError(f"record refused: the clock is wrong: {reason(error)}") from error
        return now.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"

    def _place(self) -> _Place:
        if self._end is None:
            raise JournalError(f"{place(self._folder)}: the journal is closed")
        return self._end

    def _leave(self) -> None:
        end, self._end = self._end, None
        try:
            if end is not None:
                os.close(end.descriptor)
        finally:
            self._lock.release()


def _make_sessions(sessions: Path) -> None:
    try:
        if not os.path.lexists(sessions):
            sessions.mkdir()
        if not stat.S_ISDIR(sessions.lstat().st_mode):
            raise InputError(f"{place(sessions)}: not a folder of its own (a file or a link)")
    except (OSError, ValueError) as error:
        raise InputError(f"{place(sessions)}: cannot be made: {reason(error)}") from error


def _sync_entries(folder: Path) -> None:
    """Bring the folder `sessions` itself to disk, which the one who made it may not have done."""
    try:
        sync_folder(folder)
    except OSError as error:
        raise InputError(f"{place(folder)}: cannot be brought to disk: {reason(error)}") from error


def _check_files(sessions: Path) -> None:
    """Refuse journal files that are links, or no files."""
    try:
        for path in numbered_files(sessions)[0].values():
            check_own(path)
    except OSError as error:
        raise InputError(f"{place(sessions)}: cannot be read: {reason(error)}") from error


@contextlib.contextmanager
def _telling_tail(files: Sequence[FileScan]) -> Iterator[None]:
    """Say of what contradicts a journal that its end is torn: that may be why."""
    try:
        yield
    except InputError as error:
        last = files[-1] if files else None
        if last is None or last.tail is None:
            raise
        torn = f"{place(last.path, last.tail.line)}: {last.tail}"
        raise InputError(
            f"{error}; but the journal ends torn ({torn}): the file may be the newer of the two; "
            "anaplot replay BLOCK --salvage NEWBLOCK keeps both"
        ) from error


def _mended(last: FileScan) -> tuple[int, int, list[str]]:
    """Open the last file for appending, cut behind its good lines; also its size and remarks."""
    try:
        descriptor = open_own(last.path, os.O_RDWR | os.O_APPEND)
        try:
            size, remarks = last.good_bytes, []
            if os.fstat(descriptor).st_size != last.total_bytes:
                raise InputError(f"{place(last.path)}: was changed while it was opened")
            if last.tail is not None:
                aside = _set_aside(descriptor, last)
                os.ftruncate(descriptor, size)
                remarks.append(
                    f"{place(last.path, last.tail.line)}: {last.tail}: moved to {aside.name}"
                )
            elif last.lacks_end:
                write_all(descriptor, b"\n")
                size += 1
                remarks.append(f"{place(last.path)}: the end of the last line was missing: added")
            elif size == 0:
                remarks.append(f"{place(last.path)}: was empty: begun anew")
            # Also when nothing was mended: what was read may be in memory only, and its name too,
            # when the one who wrote it was killed.
            os.fsync(descriptor)
            sync_folder(last.path.parent)
        except BaseException:
            os.close(descriptor)
            raise
    except OSError as error:
        raise InputError(f"{place(last.path)}: cannot be written: {reason(error)}") from error
    return descriptor, size, remarks


def _set_aside(descriptor: int, last: FileScan) -> Path:
    """Copy what follows the good lines into a file of its own, on disk; raises OSError."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | _BINARY
    number = 1
    while True:
        aside = last.path.with_name(f"{last.path.name}.torn-{number}")
        try:
            target = os.open(aside, flags, 0o666)
            break
        except FileExistsError:
            number += 1
    try:
        os.lseek(descriptor, last.good_bytes, os.SEEK_SET)
        while chunk := os.read(descriptor, _COPY_BYTES):
            write_all(target, chunk)
        os.fsync(target)
        sync_folder(aside.parent)
    except BaseException:
        with contextlib.suppress(OSError):
            aside.unlink()
        raise
    finally:
        os.close(target)
    return aside


def _sync(descriptor: int) -> None:
    """Bring a file's content to disk; raises OSError."""
    getattr(os, "fdatasync", os.fsync)(descriptor)
