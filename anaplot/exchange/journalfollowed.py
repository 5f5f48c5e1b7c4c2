"""A journal that is read again and again while it goes on: each time what was added alone."""

from __future__ import annotations

from pathlib import Path

from anaplot.exchange.journalread import FileScan, Take, scan_journal
from anaplot.exchange.recordline import Keep

__all__ = ["FollowedJournal"]

_Seen = tuple[int, int, int, int]  # device, number, length, time: a file that is the same still


class FollowedJournal:
    """Reads a journal from where it was read last.

    What was read is taken to stand: whoever has a block open adds to its journal, and changes
    nothing in it. A file that another one has taken the place of, or that is shorter than it was,
    is no such journal: it is read from its beginning.

    Parameters
    ----------
    path
        A block folder, its folder `sessions`, or a single file of it.
    keep
        Which kinds of records are wanted; the others are verified too.
    """

    def __init__(self, path: Path, keep: Keep) -> None:
        self._path = path
        self._keep = keep
        self._files: tuple[FileScan, ...] = ()
        self._seen: tuple[_Seen, ...] = ()

    def goes_on(self) -> bool:
        """Whether the next reading begins behind what was read; else it begins anew."""
        if self._files and not self._stands():
            self._files = self._seen = ()
        return bool(self._files)

    def read(self, take: Take) -> tuple[str, ...]:
        """Hand on the records behind those that were read, and return the remarks.

        Raises
        ------
        InputError
            As `read_journal`; the next reading begins where this one did.
        """
        scan = scan_journal(self._path, self._keep, take, self._files)
        try:
            seen = tuple(_seen(file.path) for file in scan.files)
        except OSError:
            seen = ()  # removed meanwhile
        self._files, self._seen = scan.files, seen
        return scan.remarks

    def _stands(self) -> bool:
        if len(self._seen) != len(self._files):
            return False
        try:
            now = [_seen(file.path) for file in self._files]
        except OSError:
            return False
        last, was, here = self._files[-1], self._seen[-1], now[-1]
        whole = not last.lacks_end and here[:2] == was[:2] and here[2] >= last.good_bytes
        return whole and now[:-1] == list(self._seen[:-1])


def _seen(path: Path) -> _Seen:
    """Return by what a file is known again; raises OSError."""
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns
